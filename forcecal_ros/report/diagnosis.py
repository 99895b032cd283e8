"""The report of a diagnosis as one HTML page: its answer in words, pictures and tables."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log
import re
import shlex
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import fit_autoregression
from forcecal_ros.core.quantity import beside, pair, rounded, scaled, size, with_error
from forcecal_ros.core.streams import Phase
from forcecal_ros.diagnose.dataset import CHANNELS, STAGES, units
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.judge.named_effects import (
    AT_BOUND,
    in_time,
    instants,
    NamedEffect,
    std_of,
)
from forcecal_ros.diagnose.localise import BANDS, time_frequency_bins, TimeFrequencyBin
from forcecal_ros.diagnose.model.gates import kind_of
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.verdict import percent, WITHIN
from forcecal_ros.effects import EFFECTS
from forcecal_ros.report.effect_words import phrase, sentence, sizes, VERDICTS, WORDS
from forcecal_ros.report.figures import axes_grid, COLOURS, headed, joined, Line, Panel, Shown
from forcecal_ros.report.page import docs_link, Fact, Picture, picture, render_page, Step
from forcecal_ros.sim.signals import BLOCK, block_means, JOINTS, Signals
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy import signal

SEEN = 4.0
"""Standard deviations above which a time-frequency bin is coloured."""

FAINT = 0.05
"""Excess, in noise RMS, below which a bin is not worth looking at however sure it is."""

_INDEX = {c.name: i for i, c in enumerate(CHANNELS)}


@dataclass(frozen=True)
class View:
    """
    A diagnosis and the signals of the recording it was judged on, in block means.

    Attributes
    ----------
    advice : str
        What to record next; empty where nothing is missing.
    units : dict of str to str
        Of the channels.
    times : ndarray, shape (n,)
    groups : ndarray of int, shape (n,)
        0 at rest.
    present : ndarray of bool, shape (n, channels)
    measured : ndarray, shape (n, channels)
    nominal, recalibrated, explained : ndarray, shape (n, channels)
        Measured less simulated.
    cells : tuple of Cell
        Excess of the recalibrated residual.
    """

    diagnosis: Diagnosis
    advice: str
    units: dict[str, str]
    times: Array
    phases: tuple[Phase, ...]
    groups: NDArray[np.intp]
    present: NDArray[np.bool_]
    measured: Array
    nominal: Array
    recalibrated: Array
    explained: Array
    cells: tuple[TimeFrequencyBin, ...]

    def focus(self) -> TimeFrequencyBin | None:
        """Return the strongest place of the channel that differs most; None where all is noise."""
        worst = _INDEX.get(differs_most(self.diagnosis))
        places = [TimeFrequencyBin(_INDEX[w.channel], w.phase, w.band_hz, w.excess, SEEN)
                  for w in self.diagnosis.localisation
                  if any(p.name == w.phase for p in self.phases)]
        if places or self.diagnosis.verdict != 'no_gap':
            places += sorted((c for c in self.cells if c.z > SEEN and c.excess > FAINT),
                             key=lambda c: -c.z)
        return min(places, key=lambda c: c.channel != worst, default=None)

    def span(self) -> Phase | None:
        """Return when the residual of the focus is largest: a phase, or the worst part of it."""
        place = self.focus()
        # what is shown at most of a phase that is twice as long [s]: some 500 block means
        return None if place is None else self._worst(place.channel, [
            part for phase in joined(self.phases) if phase.name == place.phase
            for part in _parts(phase, 2.0)])

    def closer(self) -> Phase | None:
        """Return the worst part of that span, so short that single periods show; None: all."""
        span, place = self.span(), self.focus()
        if span is None or place is None or place.band[0] <= 0.0:
            return None
        parts = _parts(span, 8 / place.band[0])
        return self._worst(place.channel, parts) if len(parts) > 1 else None

    def _worst(self, channel: int, parts: list[Phase]) -> Phase | None:
        """Return the part that the effects change most, or else of the largest residual."""
        change = self.recalibrated[:, channel] - named(self) * self.explained[:, channel]
        square = np.where(self.present[:, channel], change ** 2, 0.0)
        total = np.concatenate([[0.0], np.cumsum(square)])

        def energy(part: Phase) -> float:
            first, last = np.searchsorted(self.times, [part.start, part.end])
            return float(total[last] - total[first])

        return max(parts, key=energy, default=None)

    def channels(self, count: int) -> list[int]:
        """Return the channels that changed most or, where none did, the first ones."""
        place = self.focus()
        listed = [] if place is None else [place.channel]
        listed += [_INDEX[w.channel] for w in self.diagnosis.localisation]
        listed += [i for i in range(len(CHANNELS)) if self.present[:, i].any()]
        return list(dict.fromkeys(listed))[:count]


def _parts(phase: Phase, length: float) -> list[Phase]:
    """Cut a phase that is twice as long as ``length``, or longer, into parts that overlap."""
    halves = int((phase.end - phase.start) / (0.5 * length))
    if halves < 4:
        return [phase]
    starts = np.linspace(phase.start, phase.end - length, halves)
    return [Phase(phase.name, float(start), float(start) + length) for start in starts]


def view_without_signals(diagnosis: Diagnosis) -> View:
    """Show a diagnosis of data that cannot answer: its verdict is all there is."""
    nothing = np.zeros((0, len(CHANNELS)))
    return View(diagnosis, '', units(), np.zeros(0), (), np.zeros(0, np.intp),
                np.zeros(nothing.shape, np.bool_), nothing, nothing, nothing, nothing, ())


def view_of(outcome: Outcome, advice: str, of_channels: dict[str, str]) -> View:
    """
    Show a diagnosis.

    Parameters
    ----------
    of_channels : dict of str to str
        Their units.
    """
    if not outcome.datasets:
        return view_without_signals(outcome.diagnosis)
    dataset = outcome.datasets[-1]
    present = dataset.measured.present
    nominal = dataset.measured.residual(dataset.nominal)
    measured = np.where(present, _means(dataset.nominal) + nominal, np.nan)
    before, after = outcome.recalibrated[-1], outcome.explained[-1]
    noise = fit_autoregression(after, present, dataset.groups)
    return View(outcome.diagnosis, advice, of_channels, dataset.times, dataset.phases,
                dataset.groups, present, measured, nominal, before, after,
                tuple(time_frequency_bins(dataset, noise, before)))


def _means(s: Signals) -> Array:
    """Block means of what noise-free sensors say; turns, which are differences, as zero."""
    joints = np.zeros((len(s.wrench), JOINTS)) if s.joints is None else s.joints
    return block_means(np.column_stack([
        s.wrench, s.volts, s.optidrive, s.position, np.zeros_like(s.position), joints]))


NAMED = ('identified', 'ambiguous', 'partial')
"""Verdicts that name effects: of these alone an explained fraction is stated."""

HEADS = {
    'no_gap': 'The simulation explains this recording down to its noise.',
    'unknown': 'Recording and simulation differ, and no known effect explains this.',
    'not_excited': 'No verdict: ',
    'invalid_data': 'Nothing can be compared: ',
}
"""First sentence of the verdicts that name no effect; the reason follows a colon."""

UNDECIDED = {
    'not_excited': ('Not known: the motion is too small to show a difference.',
                    'Not at all: an effect of its usual size may be hidden.'),
    'invalid_data': ('Not known: nothing was compared.',
                     'No effect was tested: the data cannot be compared.'),
}
"""How large and how sure a gap is that was not searched."""

SHARE = ' of the residual'
"""A verdict of effects that show in stamps and values alone has no explained fraction."""

INSTEAD = 'may be the cause instead'
"""How the verdict ends of an effect that others could replace."""

COMPLETE = (SHARE, INSTEAD, 'explains the recording down to its noise')
"""A verdict that ends so adds nothing to its first sentence on the page."""

_CHANNELS = {c.name for c in CHANNELS}


def headline(d: Diagnosis) -> str:
    """
    Say what was found, how large it is, how sure that is, and how much it explains.

    Returns
    -------
    str
        ``The measured wrench lags the simulated one: delay 4.000 ± 0.014 ms (probability 92 %).
        Adding it explains 94 ± 5 % of the residual.``
    """
    if d.verdict not in NAMED:
        head = HEADS[d.verdict].replace('down to its noise', (
            WITHIN if WITHIN in d.reason else 'down to its noise'))
        return f'{head}{_cause_and_remedy(d)[0]}.' if head.endswith(' ') else head
    found = ' '.join(f'{sentence(e)} (probability {percent(e.probability)}).' for e in d.effects)
    return ' '.join(part for part in (found, explained(d), *_but(d)) if part)


def differs_most(d: Diagnosis) -> str:
    """Return the channel that effects change most, in its noise, or that differs most, if any."""
    if d.verdict == 'no_gap':
        return ''
    effects = d.verdict in NAMED
    changes = {name: (before - effects * after) / (noise or inf) for name, (
        _, before, after, noise) in (d.gap.channels if d.gap else {}).items()}
    return max((name for name in changes if changes[name] > 0.0), key=lambda one: changes[one],
               default='')


def _cause_and_remedy(d: Diagnosis) -> tuple[str, str]:
    """Part the reason of a recording that identifies nothing into what is wrong and what to do."""
    cause, _, remedy = d.reason.rpartition('; ')
    apart = cause and remedy.count('(') == remedy.count(')')  # not within parentheses
    remedy, mark, name = remedy.partition(' [FC')  # the id ends the message
    return (f'{cause}{mark}{name}', remedy) if apart and HEADS[d.verdict].endswith(' ') else (
        d.reason, '')


def explained(d: Diagnosis) -> str:
    """State the explained fraction; empty where that is not known."""
    if d.verdict not in NAMED or d.gap is None or SHARE not in d.reason:
        return ''
    low, high = (min(1.0, max(0.0, end)) for end in d.gap.closed_ci95)
    share, half = percent(d.gap.closed), round(50.0 * (high - low))
    if half and share[0].isdigit():
        share = share.replace(' %', f' ± {half} %')
    them = 'it' if len(d.effects) == 1 else 'them'
    # what differs is a number of the model
    do = 'Changing' if all('differs' in phrase(e.name) for e in d.effects) else 'Adding'
    return f'{do} {them} explains {share}{SHARE}.'


def _but(d: Diagnosis) -> Iterator[str]:
    others = [n for n, _ in d.candidates if n not in {e.name for e in d.effects} | {'unknown'}]
    if d.verdict == 'ambiguous' and others:
        these = 'this' if len(others) == 1 else 'each of these'
        named = '; '.join(map(_explained_name, others))
        yield f'But {these} may be the cause instead: {named}.'
    if d.verdict == 'partial':
        yield 'The residual has another cause, too.'


def facts(view: View, step: Step) -> list[Fact]:
    """Return the lines below the first sentence."""
    d = view.diagnosis
    what = '; '.join(_explained_name(e.name) for e in d.effects if e.name != 'unknown')
    return [one for one in (
        Fact('What', _begun(what)), Fact('How large', _begun(_how_large(view))),
        Fact('How sure', _how_sure(d)), Fact('Where', _begun(_where(view))),
        Fact('When', _begun(_when(view))), _in_full(d),
        Fact('Next', step.words, step.command)) if one.words]


def _begun(words: str) -> str:
    """Begin a sentence with a capital, unless it begins with the name of a channel or number."""
    first = words.partition(' ')[0]
    named = first in _CHANNELS or {'_', '['} & set(first)
    return words if named else words[:1].upper() + words[1:]


def _in_full(d: Diagnosis) -> Fact:
    """Return the verdict's own sentence, as far as it adds to what stands above."""
    sudden = [e for e in d.effects if instants(e)] if len(d.effects) == 1 else []
    reason = d.reason.replace(in_time(sudden), '')  # stands at When
    if HEADS.get(d.verdict, '').endswith(' ') or reason.endswith(COMPLETE):
        return Fact('In full', '')
    _, share, more = reason.partition(SHARE)
    if d.verdict == 'ambiguous':  # the first sentence names the others
        more = more.partition(INSTEAD)[2]
    if share and d.verdict in NAMED:
        return Fact('In addition', _begun(f'{more.lstrip(",; ")}.'))
    return Fact('In full', _begun(f'{reason}.'))


def _replaced(options: Sequence[str], option: str, value: str) -> list[str]:
    """Return options with another value of one of them, if it is there."""
    return [value if before == option else word
            for before, word in zip(('', *options), options)]


def next_step(d: Diagnosis, bag: str, folder: str, files: Sequence[str],
              how: Sequence[str] = (), against: Sequence[str] = ()) -> Step:
    """
    Say what to do with a diagnosis.

    Parameters
    ----------
    bag, folder : str
        The recording that was diagnosed, and where the results are.
    files : sequence of str
        What lies there beside the report.
    how, against : sequence of str
        Options by which a command reads the recording alike, and by which a diagnosis does so
        and compares it with the same model.
    """
    again = shlex.join(('forcecal', 'diagnose', 'NEW_BAG', *against, '-o', folder))
    anew = _replaced(against, '--simulated', 'NEW_SIM_BAG')
    simulate = ', simulate the same commands,' if '--simulated' in against else ','
    plan = shlex.join(('forcecal', 'plan', '--after', folder, '-o', 'plan.yaml'))
    planned = {name for name, _ in d.candidates} & EFFECTS.keys()
    if d.verdict == 'ambiguous' and planned:
        return Step(f'Record what separates these; diagnose it with --prior {folder}:', plan)
    if d.verdict == 'invalid_data':
        remedy = _cause_and_remedy(d)[1] or 'fix what is named above'
        if sign := re.search(r'(--[\w-]*wrench-sign) (-?1)\b', remedy):  # of the same recordings
            at = (*against, sign[1]).index(sign[1])
            anew = [*against[:at], *sign.groups(), *against[at + 2:]]
        if sign or 'simulated' in d.reason:  # the robot's recording is in order
            again = shlex.join(('forcecal', 'diagnose', bag, *anew, '-o', folder))
        return Step(f'{_begun(remedy)}. Then diagnose again:', again)
    rig, calibration, model = (
        next((f'{folder.rstrip("/")}/{f}' for f in files if f.startswith(kind)), '')
        for kind in ('rig', 'calibration_patched', 'model_patched'))
    if calibration and d.at_tolerance and d.verdict in NAMED:
        return Step('Check that this tool and sensor are the calibrated ones; if they are not, '
                    'calibrate them:', shlex.join(('forcecal', 'calibrate', bag, *how)))
    if d.verdict in NAMED and (remedy := _at_the_sensor(d)):
        return Step(f'{remedy} Then record the same motion, and diagnose again:', again)
    if d.verdict in NAMED and model:
        return Step('Confirm the corrected model (put it next to yours if that has meshes):',
                    shlex.join(('forcecal', 'diagnose', bag, *_replaced(
                        against, '--mujoco', model), '-o', 'confirmed')))
    if d.verdict in NAMED and rig:
        return Step('Simulate the same commands with the corrected rig, and compare:', shlex.join(
            ('forcecal', 'simulate', '--rig', rig, '--commands', bag, *how, '-o', 'corrected')))
    if d.verdict in NAMED and calibration:
        return Step('Estimate the contact force with the corrected calibration:', shlex.join(
            ('forcecal', 'estimate', bag, '--calibration', calibration, *how, '-o', 'contact')))
    if d.remarks and d.verdict in ('unknown', 'partial'):
        return Step(f'{_begun(d.remarks[0])}. Move more slowly, or give the model the limit that '
                    'the robot has, and diagnose again:', again)
    if d.verdict == 'no_gap' and d.at_tolerance:
        return Step(f'Check {" and ".join(d.at_tolerance)}: the recording is explained only at '
                    'the limit of the tolerance.')
    if d.verdict == 'no_gap' and d.not_compared:
        return Step('Nothing has to be changed in what was compared. Not compared: '
                    f'{" and ".join(d.not_compared)}.')
    if d.verdict == 'unknown' and planned:
        return Step('Nothing was added to the model. Record a motion that separates the '
                    f'candidates; diagnose it with --prior {folder}:', plan)
    return {
        'no_gap': Step('Nothing has to be changed.'),
        'unknown': Step('Nothing was added to the model. Record the same motion again: a residual '
                        'that repeats belongs to the robot or its model.', again),
        'not_excited': Step('Record a motion that shows what a diagnosis needs:',
                            'forcecal plan -o plan.yaml'),
    }.get(d.verdict, Step(f'{_correction(d)}{simulate} and diagnose again:', shlex.join(
        ('forcecal', 'diagnose', bag, *anew, '-o', folder))))


def _correction(d: Diagnosis) -> str:
    """Say which value parameters of a simulator should have, and which effects to add to it."""
    values, effects = [], []
    for e in d.effects:
        value = e.parameters.get('value')
        if value is None or kind_of(e.name) in WORDS:
            effects.append(f'{e.name} ({sizes(e)})')
        else:
            unit = '' if value.unit == '1' else value.unit
            values.append(f'{e.name} to {with_error(value.value, value.std)[0]} {unit}'.strip())
    return '; '.join(filter(None, (
        f'Set {" and ".join(values)} in parameters()' if values else '',
        f'Add {" and ".join(effects)} to the simulation' if effects else '')))


SENSOR_REMEDIES = {
    'wrench_delay': 'Shorten the delay of the force sensor: filters in its driver, its bus, or '
                    'stamps that are set on arrival.',
    'wrench_lowpass': "Raise the corner of the force sensor's filter, or switch it off.",
    'wrench_bias_drift': 'Let the force sensor warm up, and tare it before the motion.',
    'wrench_saturation': 'Move with less force, or choose a larger range of the force sensor.',
    'wrench_quantisation': 'Choose a finer resolution or a smaller range of the force sensor.',
    'accel_delay': 'Shorten the delay of the accelerometer: filters in its driver, or stamps that '
                   'are set on arrival.',
    'accel_misalignment': "Correct the accelerometer's orientation, or calibrate again.",
    'accel_resonance': 'Mount the accelerometer more rigidly.',
    'accel_saturation': 'Choose a larger range of the accelerometer.',
    'clock_skew': 'Synchronise the clocks of the drivers.',
    'dropouts': 'Find where messages are lost: network, queue depth, load of the computer.',
}
"""What to do about effects of sensors and stamps, which no model of the robot should contain."""

SENSOR_PREFIXES = ('wrench_', 'accel_')
"""Of effects of a sensor; others of them are corrected by a new calibration."""


def _at_the_sensor(d: Diagnosis) -> str:
    """Return what to do if all that is named belongs to sensors or stamps; else nothing."""
    names = [e.name for e in d.effects if e.name != 'unknown']
    if not names or not all(name in SENSOR_REMEDIES or name.startswith(SENSOR_PREFIXES)
                            for name in names):
        return ''
    return ' '.join(dict.fromkeys(SENSOR_REMEDIES.get(
        name, 'Calibrate the sensor again, and use that calibration.') for name in names))


def _how_large(view: View) -> str:
    d, parts = view.diagnosis, []
    if d.verdict in UNDECIDED:
        return UNDECIDED[d.verdict][0]
    if d.gap is None:
        return ''
    named = [e for e in d.effects if e.name != 'unknown']
    _, before, after = d.gap.contact_force
    if before > 0.0:
        parts.append(f'an error of {_change(before, after, "N", "contact force", named)}')
    if name := differs_most(d):
        _, apart, left, noise = d.gap.channels[name]
        change = _change(apart, left, view.units[name], d.label(name), named)
        parts.append(f'a residual of {change}, whose '
                     f'noise is {size(noise, view.units[name], 2, apart)}')
    found = [f'{e.name}: {sizes(e)}' if len(named) > 1 and kind_of(e.name) in WORDS else sizes(e)
             for e in named]
    consequence = [f'Beyond noise: {" and ".join(parts)}'] if parts else []
    return ' '.join(f'{_begun(words)}.' for words in ('; '.join(found), *consequence) if words)


def _change(before: float, after: float, unit: str, of: str, named: Sequence[NamedEffect]) -> str:
    """Write an RMS, and what named effects leave of it."""
    left = f' ({size(after, unit, 2, before)} after correction)' if named else ''
    return f'{size(before, unit, 2)} RMS in {"the " * (" " in of)}{of}{left}'


def _how_sure(d: Diagnosis) -> str:
    if d.verdict == 'no_gap':
        hidden = f', except {_few(d.not_excited)}' if d.not_excited else ''
        return f'Each effect would have been detected at its typical size{hidden}.'
    if d.verdict in UNDECIDED:
        return UNDECIDED[d.verdict][1]
    named = {e.name for e in d.effects}
    text = ', '.join(f'{percent(p)} {_called(name, named)}' for name, p in d.candidates)
    # what rounding adds to probabilities of which one alone is true
    if sum(p for _, p in d.candidates) > 1.0 + 0.02:
        text += '; several may act at once'
    if d.verdict in NAMED and named >= {name for name, _ in d.candidates}:  # the headline has them
        p, each = min(e.probability for e in d.effects), 'Each' * (len(d.effects) > 1) or 'This'
        text = f'{each} cause {percent(p)}, all others {percent(1.0 - p)}'
    hidden = f'. This motion cannot show {_few(d.not_excited)}' if d.not_excited else ''
    return f'{text}{hidden}.' if text else ''


def _few(names: Sequence[str]) -> str:
    # effects that one line of the first screen lists, and how many more there are
    few, more = 6, len(names) - 6
    return ', '.join((*names[:few], *((f'and {more} more',) if more > 0 else ())))


def _called(name: str, named: Collection[str]) -> str:
    """Call an effect by its name, and say what it is where that does not stand above."""
    if name == 'unknown':
        return 'none of the known effects'
    text = phrase(name)
    return name if name in named or name in text else f'{name} ({text})'


def _explained_name(name: str) -> str:
    text = phrase(name)
    return text if name in text else f'{text} ({name})'


def _where(view: View) -> str:
    place = view.focus()
    if place is None:
        return ''
    low, high = place.band
    band = f'below {high:g} Hz' if low <= 0.0 else f'{low:g} to {high:g} Hz'
    label = view.diagnosis.label
    more = [f'{label(w.channel)} in {w.phase}' for w in view.diagnosis.localisation
            if (_INDEX[w.channel], w.phase) != (place.channel, place.phase)][:2]
    then = f'; then {" and ".join(more)}' if more else ''
    shown = (c.excess for c in view.cells if c[:3] == place[:3] and c.z > SEEN)  # in the heat map
    return (f'in {label(CHANNELS[place.channel].name)}, phase {place.phase}, mostly {band}: '
            f'{rounded(next(shown, place.excess), 2)} times the noise at rest{then}.')


def _when(view: View) -> str:
    sudden = [(word, at, ci95) for e in view.diagnosis.effects for word, at, ci95 in instants(e)]
    if sudden:
        return '; '.join(_in_time(word, at, ci95) for word, at, ci95 in sudden) + '.'
    span = view.span()
    if span is None:
        return ''
    return f'Most visible from {span.start:.2f} to {span.end:.2f} s, in phase {span.name}.'


def _in_time(word: str, at: float, ci95: tuple[float, float]) -> str:
    when = f'{pair(at, std_of(ci95))} s'
    return f'from {when} on' if word == 'from' else f'until {when}'


TONES = {'no_gap': 'good', 'identified': 'known', 'ambiguous': 'warn', 'partial': 'warn',
         'unknown': 'bad', 'not_excited': 'plain', 'invalid_data': 'bad'}
"""Colour of each verdict."""

CAPTIONS = {
    'Where it shows most': 'The channel that differs most: its residual, measured - simulated; '
                           'below, the signals.',
    'Signals': 'Simulated: by the model whose parameters are re-estimated within their '
               'tolerances.',
    'Residuals': 'The same channels, measured - simulated.',
    'Spectra': 'Power of the residuals in motion, and of the noise at rest.',
}


WITH_EFFECTS = {'Signals': ' Explained: with the effects added.',
                'Residuals': ' Explained: with the effects added.'}
"""What follows where effects are named."""


def render(view: View, origin: list[str], step: Step) -> str:
    """
    Return a diagnosis as a page: its answer first, then where, how far, which and what next.

    Parameters
    ----------
    origin : list of str
        What was diagnosed, and what it was compared with, a line each.
    step : Step
        What to do next.

    Returns
    -------
    str
        HTML, one file without network; everything is escaped.
    """
    d = view.diagnosis
    named = d.verdict in NAMED
    kept = {'measured noise': 3, 'nominal': 0, 'before': 1, **({'after': 2} if named else {})}
    channels = d.gap.channels if d.gap else {}
    shown = [(name, rms) for name, rms in channels.items() if any(rms[:3])]
    worst = differs_most(d)
    return render_page(
        'diagnosis.html.j2', 'Sim-to-real gap', origin=origin, verdict=d.verdict.replace('_', ' '),
        tone=TONES[d.verdict], headline=headline(d), facts=facts(view, step),
        notes=[f'{_begun(note)}.' for note in d.notes],
        share=explained(d), effects=_numbers(d), meaning=VERDICTS[d.verdict],
        pages=[docs_link('reference/verdicts', d.verdict),
               *(docs_link('reference/errors', one) for one in re.findall(r'\bFC\d{4}', d.reason)),
               *(docs_link('reference/effects', e.name) for e in d.effects if e.name in WORDS
                 and e.name != 'unknown')],
        gap=None if d.gap is None else {
            'nominal': rounded(d.gap.nominal), 'recalibrated': rounded(d.gap.recalibrated),
            'explained': rounded(d.gap.explained) if named else ''},
        advice=view.advice if d.verdict not in ('identified', 'invalid_data') else '',
        candidates=[(name, percent(p), phrase(name), 100.0 * p) for name, p in d.candidates
                    ] if len(d.candidates) > 1 else [],
        head=('channel', *kept, 'unit'),
        channels=[_row(d.label(name), [*(rms[k] for k in kept.values()), rms[3]], view.units[name],
                       max(max(x) for other, x in shown if view.units[other] == view.units[name]))
                  for name, rms in shown],
        worst=next((i for i, (name, _) in enumerate(shown) if name == worst), -1),
        alike=[d.label(name) for name, rms in channels.items() if not any(rms[:3])],
        octaves=[f'{high:g}' for _, high in BANDS[:-1]], heat=heat(view),
        closest=list(_pictures(view, {'Where it shows most': closest})),
        figures=list(_pictures(view, {'Residuals': residuals, 'Spectra': spectra})),
        signals=list(_pictures(view, {'Signals': signals})))


def _row(channel: str, values: list[float], unit: str, largest: float) -> list[str]:
    """Write all but the last value, which is the noise, to its digits."""
    shown, cells = beside(values, unit, largest)
    return [channel, *cells[:-1], shown]


def _pictures(view: View, drawings: Mapping[str, Callable[[View], Any]]) -> Iterator[Picture]:
    for title, draw in drawings.items():
        if len(view.times) and (what := draw(view)):
            more = WITH_EFFECTS.get(title, '') if named(view) else ''
            yield picture(title, CAPTIONS[title] + more,
                          *(what if isinstance(what, list) else [what]))


def _numbers(d: Diagnosis) -> list[tuple[str, str, str, str, str]]:
    """Return every number that was found, in SI units, as a rig file requires them."""
    out = [(e.name, name, *((rounded(p.value), AT_BOUND) if p.at_bound else with_error(
        p.value, p.std)), '' if p.unit == '1' else p.unit)
           for e in d.effects for name, p in e.parameters.items()
           if p.value or p.std or p.at_bound]
    return out + [(e.name, word, *with_error(at, std_of(ci95)), 's')
                  for e in d.effects for word, at, ci95 in instants(e)]


SHOWN = 4
"""Number of channels that are drawn."""


class Cell(NamedTuple):
    """An excess over the noise, in its RMS, and how strong its colour is, of 100."""

    excess: str
    strength: int


def heat(view: View) -> list[tuple[str, list[tuple[str, list[Cell | None]]]]]:
    """
    List what exceeds the noise: phase by phase, each of its channels, in each octave.

    Returns
    -------
    list of (str, list of (str, list of Cell or None))
        Phase, channel and what each octave shows; None: no more than noise.
    """
    found = [c for c in view.cells if c.z > SEEN and c.excess > FAINT]
    most = log(max([1.0, *(c.excess for c in found)]) / FAINT)
    table: dict[str, dict[int, list[Cell | None]]] = {}
    for c in sorted(found, key=lambda one: (STAGES.index(CHANNELS[one.channel].stage),
                                            one.channel)):
        row = table.setdefault(c.phase, {}).setdefault(c.channel, [None] * len(BANDS[:-1]))
        row[BANDS.index(c.band)] = Cell(f'{c.excess:.{int(c.excess < 9.95)}f}',
                                        round(100.0 * log(c.excess / FAINT) / most))
    label = view.diagnosis.label
    return [(name, [(label(CHANNELS[i].name), row) for i, row in table[name].items()])
            for name in dict.fromkeys(p.name for p in view.phases) if name in table]


def closest(view: View) -> Shown | None:
    """Show the channel and the time that the verdict speaks of; None where all is noise."""
    span, place, part = view.span(), view.focus(), view.closer()
    if span is None or place is None:
        return None
    margin = 0.25 * (span.end - span.start)
    start, end = span.start - margin, span.end + margin
    for at in begun(view):
        start, end = min(start, at - margin), max(end, at + margin)
    return Shown((_residuals(view, place.channel), _signals(view, place.channel)), view.phases,
                 max(start, float(view.times[0])), min(end, float(view.times[-1])), begun(view),
                 None if begun(view) or part is None else (part.start, part.end))


def signals(view: View) -> Shown:
    """Show measured, simulated and explained signals over each other."""
    return _whole(view, tuple(_signals(view, c) for c in view.channels(SHOWN)))


def residuals(view: View) -> Shown:
    """Show measured - simulated, before and after the effects."""
    return _whole(view, tuple(_residuals(view, c) for c in view.channels(SHOWN)))


def begun(view: View) -> tuple[float, ...]:
    """Return the instants at which effects began."""
    return tuple(at for e in view.diagnosis.effects for _, at, _ in instants(e))


def _whole(view: View, panels: tuple[Panel, ...]) -> Shown:
    return Shown(panels, view.phases, float(view.times[0]), float(view.times[-1]), begun(view))


def _signals(view: View, channel: int) -> Panel:
    measured = view.measured[:, channel]
    return _panel(view, channel, (
        ('measured', 'measured', measured, False),
        ('simulated', 'simulated', measured - view.recalibrated[:, channel], False),
        ('nominal', 'other', measured - view.nominal[:, channel], True),
        ('explained', 'explained', measured - view.explained[:, channel], False)))


def _residuals(view: View, channel: int) -> Panel:
    there = view.present[:, channel]
    title = f'Δ {view.diagnosis.label(CHANNELS[channel].name)}'
    return _panel(view, channel, tuple(
        (name, role, np.where(there, values[:, channel], np.nan), False)
        for name, role, values in (('measured - simulated', 'simulated', view.recalibrated),
                                   ('measured - explained', 'explained', view.explained))), title)


def _panel(view: View, channel: int, lines: tuple[tuple[str, str, Array, bool], ...],
           title: str = '') -> Panel:
    """Leave out what is explained where no effect is named."""
    name, there = CHANNELS[channel].name, view.present[:, channel]
    # of what is recorded more seldom than in every other block no two points are neighbours
    rows = there if there.mean() < 0.5 else np.ones(len(there), dtype=bool)
    shown = [one for one in lines if one[1] != 'explained' or named(view)]
    unit, factor = scaled(float(np.fmax.reduce(
        [np.abs(values[rows]) for _, _, values, _ in shown], axis=None, initial=0.0)),
        view.units[name])
    return Panel(title or view.diagnosis.label(name), unit, tuple(
        Line(called, role, view.times[rows], factor * values[rows], hidden)
        for called, role, values, hidden in shown))


def named(view: View) -> bool:
    """Tell whether effects change what is simulated."""
    return not np.array_equal(view.explained, view.recalibrated)


def spectra(view: View) -> list[Figure]:
    """Draw the residual's spectra before and after, and at standstill, a figure a channel."""
    drawn = []
    for c in view.channels(SHOWN):
        figure, (ax,) = axes_grid(1, 1, height=3.0)
        there = view.present[:, c]
        moving = there & (view.groups > 0)
        for values, role, label in (
                (view.recalibrated[moving, c], 'simulated', 'measured - simulated'),
                (view.explained[moving, c], 'explained', 'measured - explained'),
                (view.explained[there & (view.groups == 0), c], 'other', 'at rest')):
            if len(values) > 64 and (role != 'explained' or named(view)):
                f, power = signal.welch(values, _rate(there), nperseg=min(256, len(values)))
                ax.loglog(f[1:], power[1:], color=COLOURS[role], linewidth=1.0, label=label)
        name = CHANNELS[c].name
        unit = view.units[name]
        square = f'({unit})²' if ' ' in unit or '/' in unit else f'{unit}²'
        ax.set(xlabel='frequency [Hz]', ylabel=f'power [{square}/Hz]')
        headed(ax, view.diagnosis.label(name), 2)
        drawn.append(figure)
    return drawn


def _rate(there: NDArray[np.bool_]) -> float:
    """Rate of the blocks that hold samples [Hz]."""
    steps = np.diff(np.flatnonzero(there))
    return 1.0 / (BLOCK * max(1.0, float(np.median(steps)) if len(steps) else 1.0))

