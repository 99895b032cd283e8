"""The first screen of a diagnosis: what, how large, how sure, where, when, and what to do next."""

from collections.abc import Collection, Iterator, Sequence
from math import inf
import shlex

from forcecal_ros.core.quantity import size
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.named_effects import instants
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.verdict import FIRST, FURTHER, percent
from forcecal_ros.report.diagnosis_view import View
from forcecal_ros.report.effect_words import phrase, sentence, WORDS
from forcecal_ros.report.words import Fact, Step

NAMED = ('identified', 'ambiguous', 'partial')
"""Verdicts that name effects: of these alone a share of the misfit is said."""

HEADS = {
    'no_gap': 'The simulation explains this recording down to its noise.',
    'unknown': 'Recording and simulation differ, and no known effect explains it.',
    'not_excited': 'No verdict: ',
    'invalid_data': 'This recording cannot be used: ',
}
"""First sentence of the verdicts that name no effect; the reason follows a colon."""

UNTOLD = {
    'not_excited': ('Not known: what hardly moves shows no gap.',
                    'Not at all: an effect of its usual size need not have shown.'),
    'invalid_data': ('Not known: nothing was compared.',
                     'No effect was weighed; the fault shows in the recording itself.'),
}
"""How large and how sure a gap is that was not looked for."""

SHARE = ' of the misfit'
"""A verdict of effects that show in stamps and values alone says no share, nor does its page."""

AS_WELL = 'explains it about as well'
"""How the verdict ends of an effect that others could replace."""

SAID = (SHARE, AS_WELL, 'explains the recording down to its noise')
"""A verdict that ends so says no more than its first sentence on the page."""

FEW = 6
"""Effects that one line of the first screen lists, and how many more there are."""

ROUNDED = 0.02
"""What rounding adds to probabilities of which one alone is true."""

_CHANNELS = {c.name for c in CHANNELS}


def headline(d: Diagnosis) -> str:
    """
    Say what was found, how large it is, how sure that is, and how much it explains.

    Returns
    -------
    str
        ``The wrench comes 4.000 ± 0.014 ms late (92 % sure). Adding it explains 94 % of the
        misfit (95 % interval: 87 to 98 %).``
    """
    if d.verdict not in NAMED:
        head = HEADS[d.verdict]
        return f'{head}{_cause_and_remedy(d)[0]}.' if head.endswith(' ') else head
    found = ' '.join(f'{sentence(e)} ({percent(e.probability)} sure).' for e in d.effects)
    return ' '.join(part for part in (found, explained(d), *_but(d)) if part)


def _cause_and_remedy(d: Diagnosis) -> tuple[str, str]:
    """Part the reason of a recording that tells nothing into what is wrong and what to do."""
    cause, _, remedy = d.reason.rpartition('; ')
    apart = cause and remedy.count('(') == remedy.count(')')  # not within parentheses
    return (cause, remedy) if apart and HEADS[d.verdict].endswith(' ') else (d.reason, '')


def explained(d: Diagnosis) -> str:
    """Say which share of the misfit the named effects explain; empty where that is not known."""
    if d.verdict not in NAMED or d.gap is None or SHARE not in d.reason:
        return ''
    low, high = d.gap.closed_ci95
    them = 'it' if len(d.effects) == 1 else 'them'
    # a name that is no effect's is a number of somebody's simulator
    do = 'Adding' if any(e.name in WORDS for e in d.effects) else 'Changing'
    return (f'{do} {them} explains {percent(d.gap.closed)} of the misfit (95 % interval: '
            f'{max(0.0, 100.0 * low):.0f} to {100.0 * high:.0f} %).')


def _but(d: Diagnosis) -> Iterator[str]:
    others = [n for n, _ in d.candidates if n not in {e.name for e in d.effects} | {'unknown'}]
    if d.verdict == 'ambiguous' and others:
        these = 'this' if len(others) == 1 else 'each of these'
        yield f'But {these} would explain it about as well: {_listed(others)}.'
    if d.verdict == 'partial':
        yield 'Part of the misfit is something else.'


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
    """Begin a sentence with a capital, unless it begins with the name of a channel."""
    first = words.partition(' ')[0]
    return words if first in _CHANNELS or '_' in first else words[:1].upper() + words[1:]


def _in_full(d: Diagnosis) -> Fact:
    """Return the verdict's own sentence, as far as it says more than what stands above."""
    if HEADS.get(d.verdict, '').endswith(' ') or d.reason.endswith(SAID):
        return Fact('In full', '')
    _, share, more = d.reason.partition(SHARE)
    if d.verdict == 'ambiguous':  # the first sentence names the others
        more = more.partition(AS_WELL)[2]
    if share and d.verdict in NAMED:
        return Fact('Besides', _begun(f'{more.lstrip(",; ")}.'))
    return Fact('In full', _begun(f'{d.reason}.'))


def next_step(d: Diagnosis, bag: str, folder: str, files: Sequence[str], advice: str = '',
              how: Sequence[str] = ()) -> Step:
    """
    Say what to do with a diagnosis.

    Parameters
    ----------
    bag, folder : str
        The recording that was diagnosed, and where the results are.
    files : sequence of str
        What lies there beside the report.
    advice : str
        Which motion to record next; empty where none would tell more.
    how : sequence of str
        What a command has to say of the recording to find the same in it.
    """
    if d.verdict == 'ambiguous' and advice:
        return Step(_begun(f'{advice.partition(";")[0].rstrip(".")}.'))
    if d.verdict == 'invalid_data' and (remedy := _cause_and_remedy(d)[1]):
        return Step(f'{_begun(remedy)}. Then diagnose again.')
    rig, calibration, model = (
        next((f'{folder.rstrip("/")}/{f}' for f in files if f.startswith(kind)), '')
        for kind in ('rig', 'calibration_patched', 'model_patched'))
    if d.verdict in NAMED and model:
        return Step('Simulate with the model that has what was found; put it beside yours, '
                    'where its meshes are:', model)
    if d.verdict in NAMED and rig:
        return Step('Simulate the same commands with what was found, and compare:', shlex.join(
            ('forcecal', 'simulate', '--rig', rig, '--commands', bag, *how, '-o', 'corrected')))
    if d.verdict in NAMED and calibration:
        return Step('Estimate the contact force with what was found:', shlex.join(
            ('forcecal', 'estimate', bag, '--calibration', calibration, *how, '-o', 'contact')))
    if first := d.reason.partition(FIRST)[2]:
        return Step(f'{_begun(first)}. Move more slowly, or give the model the limit that the '
                    'robot has, and diagnose again.')
    if d.verdict == 'no_gap' and (held := _held(d)):
        return Step(f'Look at {held}: this recording is explained only with so much of it as its '
                    'tolerance allows. State by --priors how far it may be off.')
    return {
        'no_gap': Step('Nothing has to be changed.'),
        'unknown': Step('Record the same motion again: what comes again belongs to the rig or '
                        'its model, what does not was chance. Nothing was added to the rig.'),
        'not_excited': Step('Record a motion that shows what a diagnosis needs:',
                            'forcecal plan -o plan.yaml'),
        'invalid_data': Step('Mend what is named above, and diagnose again.'),
    }.get(d.verdict, Step('Give the simulation what was found, and compare again.'))


def _held(d: Diagnosis) -> str:
    """Name the numbers of a simulator that only their tolerance keeps from going further."""
    return next((note.partition(f' {FURTHER}')[0] for note in d.notes if FURTHER in note), '')


def _how_large(view: View) -> str:
    d, parts = view.diagnosis, []
    if d.verdict in UNTOLD:
        return UNTOLD[d.verdict][0]
    if d.gap is None:
        return ''
    _, before, after = d.gap.contact_force
    if d.verdict == 'no_gap':
        return f'{size(before, "N", 2)} RMS above the noise in the contact force.' if (
            before) else ''
    worst = max(d.gap.channels.items(), key=lambda one: one[1][1] / (one[1][3] or inf),
                default=None)
    if worst is not None:
        name, (_, apart, _, noise) = worst
        parts.append(f'by {size(apart, view.units[name], 2)} RMS in {name}, whose noise is '
                     f'{size(noise, view.units[name], 2)}')
    if before > 0.0:
        left = f' ({size(after, "N", 2)} with it added)' if d.verdict in NAMED else ''
        parts.insert(0, f'by {size(before, "N", 2)} RMS in the contact force{left}')
    return f'Beyond noise they differ {" and ".join(parts)}.' if parts else ''


def _how_sure(d: Diagnosis) -> str:
    if d.verdict == 'no_gap':
        hidden = f', except {_few(d.not_excited)}' if d.not_excited else ''
        return f'Every effect looked for would have shown at its usual size{hidden}.'
    if d.verdict in UNTOLD:
        return UNTOLD[d.verdict][1]
    if not d.candidates:
        return ''
    named = {e.name for e in d.effects}
    said = ', '.join(f'{percent(p)} {_called(name, named)}' for name, p in d.candidates)
    together = sum(p for _, p in d.candidates) > 1.0 + ROUNDED
    return f'{said}{"; several may act at once" if together else ""}.'


def _few(names: Sequence[str]) -> str:
    more = len(names) - FEW
    return ', '.join((*names[:FEW], *((f'and {more} more',) if more > 0 else ())))


def _called(name: str, named: Collection[str]) -> str:
    """Call an effect by its name, and say what it is where that does not stand above."""
    if name == 'unknown':
        return 'none of the known effects'
    said = phrase(name)
    return name if name in named or name in said else f'{name} ({said})'


def _listed(names: Sequence[str]) -> str:
    return '; '.join(map(_explained_name, names))


def _explained_name(name: str) -> str:
    said = phrase(name)
    return said if name in said else f'{said} ({name})'


def _where(view: View) -> str:
    place = view.focus()
    if place is None:
        return ''
    low, high = place.band
    band = f'below {high:g} Hz' if low <= 0.0 else f'{low:g} to {high:g} Hz'
    more = [f'{w.channel} in {w.phase}' for w in view.diagnosis.localisation[1:3]]
    then = f'; then {" and ".join(more)}' if more else ''
    return (f'{CHANNELS[place.channel].name} in phase {place.phase}, {band}: '
            f'{size(place.excess, "", 2).strip()} times the noise{then}.')


def _when(view: View) -> str:
    sudden = [(word, at, ci95) for e in view.diagnosis.effects for word, at, ci95 in instants(e)]
    if sudden:
        return '; '.join(_in_time(word, at, ci95) for word, at, ci95 in sudden) + '.'
    span = view.span()
    if span is None:
        return ''
    return f'Most visible from {span.start:.2f} to {span.end:.2f} s, in phase {span.name}.'


def _in_time(word: str, at: float, between: tuple[float, float]) -> str:
    interval = f'(95 %: {between[0]:.3f} to {between[1]:.3f} s)'
    return f'from {at:.2f} s on {interval}' if word == 'from' else f'until {at:.2f} s {interval}'
