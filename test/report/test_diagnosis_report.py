"""The first screen of a diagnosis says what, how large, how sure, where, when and what next."""

from dataclasses import replace
import json
from pathlib import Path
import re
import sys

from browser import cut_on_a_phone, NEEDED
from forcecal_ros.core.quantity import beside, HALF, quantity, rounded
from forcecal_ros.core.streams import Phase, Recording, Stream
from forcecal_ros.diagnose.dataset import CHANNELS, units
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.judge.named_effects import in_time, NamedEffect, Parameter
from forcecal_ros.diagnose.localise import BANDS, Location, TimeFrequencyBin
from forcecal_ros.diagnose.result import Diagnosis, to_document
from forcecal_ros.diagnose.verdict import percent
from forcecal_ros.effects.library import EFFECTS
from forcecal_ros.report import diagnosis as figures
from forcecal_ros.report import page as pages
from forcecal_ros.report.diagnosis import (
    facts,
    headline,
    next_step,
    render,
    TONES,
    View,
    view_without_signals,
)
from forcecal_ros.report.effect_words import sentence, VERDICTS, WORDS
from forcecal_ros.report.figures import (
    background,
    between,
    drawn,
    Line,
    live,
    MOST_POINTS,
    Panel,
    Shown,
)
from forcecal_ros.report.page import origin, Step
import numpy as np
import pytest

LATE = NamedEffect('wrench_delay', {'delay': Parameter(0.00400042, 0.000141, 's')}, 0.973)
GAP = Gap(1.3, 1.2, 0.02, 0.9834, (0.9712, 0.9913),
          {'force.y': (0.4, 0.38, 0.01, 0.25)}, (0.5, 0.53, 0.012))
PLACES = (Location('wrench_sensor', 'force.y', 'step', (8.0, 16.0), 12.3, 1e-9),
          Location('wrench_sensor', 'torque.x', 'contact', (4.0, 8.0), 3.0, 1e-9))
IDENTIFIED = Diagnosis('identified', 'wrench_delay explains 98 % of the residual', (LATE,),
                       (('wrench_delay', 0.973),), PLACES, GAP)
NEXT = Step('Simulate the same:', 'forcecal simulate')
NO_REASON = 'nothing to see'


def _view(diagnosis, n=6000):
    t = 0.004 * (0.5 + np.arange(n))
    measured = np.sin(t)[:, np.newaxis] * np.ones(len(CHANNELS))
    residual = 0.1 * np.cos(t)[:, np.newaxis] * np.ones(len(CHANNELS))
    residual[2600] = 9.0
    phases = (Phase('measure', 0.0, 2.0), Phase('step', 2.0, 4.0), Phase('move', 4.0, 10.0),
              Phase('step', 10.0, 12.0), Phase('contact', 12.0, 24.0))
    named = 0.0 if diagnosis.effects and diagnosis.verdict == 'identified' else 1.0
    return View(diagnosis, '', units(), t, phases, np.ones(n, int), np.ones(residual.shape, bool),
                measured, residual, residual, named * residual, ())


def words(diagnosis, view=view_without_signals):
    """Return what the first screen says, by its labels."""
    return {one.label: one.words for one in facts(view(diagnosis), NEXT)}


@pytest.fixture(scope='module')
def page():
    joints = tuple(f'left_shoulder_pan_joint_{i}' for i in range(len(CHANNELS)))
    return render(replace(_view(replace(IDENTIFIED, joints=joints)), cells=tuple(
        TimeFrequencyBin(i, phase, band, 160.0 / (i + 1), 9.0) for i in range(len(CHANNELS))
        for phase in ('step', 'contact') for band in BANDS[:-1])), ['bag'], NEXT)


@pytest.mark.parametrize(('value', 'half', 'unit', 'said'), [
    (0.00400042, 0.000141, 's', '4.00 ± 0.14 ms'), (0.0501693, 0.00082, '1', '5.02 ± 0.08 %'),
    (0.03, 0.0011, 'rad', '1.72 ± 0.06 deg'),
    (1.234e7, 2e5, 'N/m^3', '(1.234 ± 0.020) x 10^7 N/m^3'),
    (2e-4, 1e-5, '1', '200 ± 10 ppm'), (13.0, float('nan'), 'kg', '13.0 kg'),
    (0.0, 0.2, 'N', '0.00 ± 0.20 N'), (0.6059, 0.00785, 'N', '0.606 ± 0.008 N')])
def test_a_number_has_the_digits_that_are_known_and_a_handy_unit(value, half, unit, said):
    assert quantity(value, half / HALF, unit) == said


def test_a_share_is_all_or_nothing_only_where_it_is():
    assert [percent(x) for x in (0.0, 0.004, 0.43, 0.996, 1.0)] == [
        '0 %', 'under 1 %', '43 %', 'over 99 %', '100 %']
    assert rounded(0.000012345) == '1.23e-05' and rounded(12345.6) == '12300'
    assert beside((4.1e-5, 2e-5), 'm') == ('µm', ['41.0', '20.0'])


@pytest.mark.parametrize('name', [*EFFECTS, 'wrench_bias_step'])
def test_every_effect_has_words_and_shows_its_numbers(name):
    quantities = EFFECTS[name].parameters if name in EFFECTS else ()
    numbers = {q.name: Parameter(q.typical, 1e-3 * abs(q.typical), q.unit) for q in quantities
               } or {'fy': Parameter(0.6, 0.01, 'N')}
    said = sentence(NamedEffect(name, numbers, 0.9))
    assert name in WORDS
    assert '±' in said and 'nan' not in said


def test_a_sentence_leaves_out_what_is_chance():
    gain = NamedEffect('wrench_gain', {'fx': Parameter(0.05, 0.001, '1'),
                                 'fy': Parameter(0.001, 0.001, '1')}, 0.9)
    assert sentence(gain).endswith('channel differs: fx +5.00 ± 0.20 %')
    limit = NamedEffect('wrench_saturation', {'limit': Parameter(60.0, 0.5, 'N'),
                                        'torque_limit': Parameter(1e3, 1.0, 'N m')}, 0.9)
    assert sentence(limit).endswith('saturates: limit 60.0 ± 1.0 N')


def test_a_number_of_somebodys_simulator_is_called_by_its_name():
    friction = NamedEffect('friction', {'value': Parameter(0.4213, 0.004, '1', nominal=0.5)}, 0.9)
    assert sentence(friction) == 'friction 0.5 -> 0.421 ± 0.008'
    said = words(replace(
        IDENTIFIED, effects=(friction,), candidates=(('friction', 0.9), ('kp', 0.1))))
    assert said['What'] == 'Friction differs from the simulator'
    assert said['How sure'] == '90 % friction, 10 % kp.'
    gain = replace(IDENTIFIED, effects=(replace(friction, name='kp[lift]'),))
    assert words(gain)['What'] == 'kp[lift] differs from the simulator'


def test_a_number_at_its_bound_says_so_and_has_no_error():
    stiff = NamedEffect('wrench_lowpass', {
        'time_constant': Parameter(0.2, 0.0, 's', at_bound=True),
        'second_order': Parameter(1.5, 0.1, '1')}, 0.9)
    d = replace(IDENTIFIED, effects=(stiff,))
    assert sentence(stiff).endswith('measured wrench: time constant 200 ms (at its bound)')
    page = render(view_without_signals(d), [], NEXT)
    assert 'at its bound' in page and '± 0 ' not in page
    document = to_document(d, units(), None)
    written = document['effects'][0]['parameters']
    assert written['time_constant']['at_bound'] is True
    assert 'at_bound' not in written['second_order']
    friction = NamedEffect('friction', {'value': Parameter(
        0.0, 0.01, 'N m', at_bound=True, nominal=0.2)}, 0.9)
    assert sentence(friction) == 'friction 0.2 -> 0 N m (at its bound)'


def test_other_causes_are_explained_and_an_ambiguous_verdict_says_what_tells_them_apart():
    two = replace(IDENTIFIED, verdict='ambiguous', candidates=(
        ('wrench_delay', 0.7), ('wrench_lowpass', 0.3)),
        reason='wrench_delay explains 98 % of the residual, but wrench_lowpass may be the '
               'cause instead')
    said = words(two)
    assert said['How sure'] == ('70 % wrench_delay, 30 % wrench_lowpass (a low-pass filter '
                                'smooths the measured wrench).')
    assert 'In full' not in said and 'In addition' not in said  # the first sentence says it
    for one in (two, IDENTIFIED):
        said = words(replace(one, reason=f'{one.reason}; residual: force.x in step'))
        assert said['In addition'] == 'Residual: force.x in step.'
    several = replace(two, verdict='unknown', effects=(), candidates=(
        ('unknown', 0.73), ('wrench_crosstalk', 0.28), ('wrench_saturation', 0.27)))
    assert words(several)['How sure'].endswith('; several may act at once.')
    one = replace(several, candidates=several.candidates[:2])
    assert 'at once' not in words(one)['How sure']


def test_a_report_without_a_gap_says_which_effects_would_not_have_shown():
    none = replace(IDENTIFIED, verdict='no_gap', effects=(), not_excited=())
    hidden = replace(none, not_excited=tuple('abcdefgh'))
    shown = 'Each effect would have been detected at its typical size'
    assert [words(d)['How sure'] for d in (none, hidden)] == [
        f'{shown}.', f'{shown}, except a, b, c, d, e, f, and 2 more.']


def test_the_facts_name_place_time_and_next_command():
    said = {one.label: one for one in facts(_view(IDENTIFIED), NEXT)}
    assert said['What'].words == 'The measured wrench lags the simulated one (wrench_delay)'
    assert said['How large'].words == (
        'Delay 4.00 ± 0.28 ms. Beyond noise: an error of 0.53 N RMS in the contact force '
        '(0.012 N after correction) and a residual of 0.38 N RMS in force.y (0.010 N after '
        'correction), whose noise is 0.25 N.')
    assert said['How sure'].words == 'This cause 97 %, all others 3 %.'
    assert said['Where'].words == ('In force.y, phase step, mostly 8 to 16 Hz: 12 times the '
                                   'noise at rest; then torque.x in contact.')
    place = TimeFrequencyBin(1, 'step', (8.0, 16.0), 17.0, 9.0)
    there = facts(replace(_view(IDENTIFIED), cells=(place,)), NEXT)
    assert any('17 times the noise at rest' in one.words for one in there)
    # of two steps the one with the largest residual
    assert said['When'].words == 'Most visible from 10.00 to 12.00 s, in phase step.'
    assert said['Next'].command == 'forcecal simulate' and 'In full' not in said


def test_an_effect_that_began_says_when():
    begun = replace(IDENTIFIED, effects=(replace(LATE, begin=12.3005, begin_ci95=(12.29, 12.31)),))
    said = words(begun, _view)
    assert said['When'] == 'From 12.300 ± 0.010 s on.'
    twice = replace(begun, reason=f'{begun.reason}{in_time(begun.effects)}')
    assert '12.300' in twice.reason and 'In addition' not in words(twice, _view)
    assert figures.closest(_view(begun)).instants == (12.3005,)
    ended = replace(IDENTIFIED, effects=(replace(LATE, end=14.5, end_ci95=(14.46, 14.54)),))
    said = words(ended, _view)
    assert said['When'] == 'Until 14.50 ± 0.04 s.'


@pytest.mark.parametrize('verdict', ['unknown', 'not_excited', 'no_gap', 'invalid_data'])
def test_a_verdict_that_names_nothing_says_no_share_and_marks_no_channel(verdict):
    d = replace(IDENTIFIED, verdict=verdict, reason=NO_REASON,
                effects=(NamedEffect('unknown', {}, 0.9),) if verdict == 'unknown' else ())
    page = render(view_without_signals(d), ['bag'], NEXT)
    assert not re.search(r'explains \d+ % of the residual|explained</th>', page)
    assert NO_REASON in page.lower()
    assert VERDICTS[verdict] in page and '`' not in VERDICTS[verdict]
    if verdict == 'no_gap':
        assert 'class="worst"' not in page and 'in bold' not in page and '>force.y<' in page
    if verdict in ('not_excited', 'invalid_data'):
        said = words(d)
        assert said['How large'].startswith('Not known: ') and said['Next']
        assert said['How sure'].startswith(('Not at all', 'No effect'))


def test_an_effect_that_shows_in_stamps_alone_explains_no_share():
    lost = replace(IDENTIFIED, reason='dropouts shows in stamps and values', effects=(
        NamedEffect('dropouts', {'wrench': Parameter(0.02, 0.001, '1')}, 0.99),))
    assert headline(lost) == 'Messages are lost: wrench 2.00 ± 0.20 % (probability 99 %).'


def test_numbers_that_were_not_found_are_not_listed():
    d = replace(IDENTIFIED, effects=(NamedEffect('wrench_gain', {
        'fx': Parameter(0.02, 0.001, '1'), 'fy': Parameter(0.0, 0.0, '1')}, 0.9),))
    page = render(view_without_signals(d), ['bag'], NEXT)
    assert '>fx<' in page and '>fy<' not in page


def test_the_first_sentence_says_what_how_large_how_sure_and_how_much_it_explains():
    assert headline(IDENTIFIED) == (
        'The measured wrench lags the simulated one: delay 4.00 ± 0.28 ms (probability 97 %). '
        'Adding it explains 98 ± 1 % of the residual.')
    page = render(view_without_signals(IDENTIFIED), ['bag'], NEXT)
    assert set(re.findall(r'explains ([\w± ]+ %)', page)) == {'98 ± 1 %'}
    assert 'class="said known"' in page and TONES.keys() >= {'no_gap', 'partial', 'ambiguous'}
    # a number of a simulator is changed and not added
    gripper = NamedEffect(
        'body_mass[gripper]', {'body_mass[gripper]': Parameter(1.26, 0.002, 'kg')}, 0.97)
    for effects, words in (((gripper,), 'Changing it'), ((MASS,), 'Changing it'),
                           ((MASS, LATE), 'Adding them')):
        assert f' {words} explains ' in headline(replace(IDENTIFIED, effects=effects))


STUCK = Diagnosis('invalid_data',
                  'force.z (x; y) never changes; check the cable, and record again [FC0304]')
SLOW = replace(IDENTIFIED, effects=(replace(LATE, name='robot_delay'),))
MASS = NamedEffect('tool_mass', {'change': Parameter(0.05, 0.001, '1')}, 0.97)
PAYLOAD = NamedEffect('payload', {'value': Parameter(1.25941, 0.0004, 'kg')}, 0.97)
UNKNOWN = Diagnosis('unknown', 'a gap', candidates=(('unknown', 0.6), ('tool_mass', 0.4)))
DRIVE = 'in the model the drive of wrist_3 is at its actuator_forcerange (28) for 0.4 s'
PLAN = 'forcecal plan --after out -o plan.yaml'
AGAIN = 'forcecal diagnose NEW_BAG -o out'
RIG, CALIBRATION = ('rig_patched.yaml',), ('calibration_patched.yaml',)
SIGN = '--simulated-wrench-sign'


@pytest.mark.parametrize(('diagnosis', 'given', 'words', 'command'), [
    (STUCK, {}, 'Check the cable, and record again. Then diagnose again:', AGAIN),
    (replace(STUCK, reason='too few samples (12; 300 are needed)'), {}, 'Fix what is named above',
     AGAIN),
    (replace(STUCK, reason='the sign is wrong; give --simulated-wrench-sign 1 [FC0802]'),
     {'against': ('--simulated', 'sim', SIGN, '-1', '--topic', 'wrench=/ft')}, '',
     'forcecal diagnose bag --simulated sim --simulated-wrench-sign 1 --topic wrench=/ft -o out'),
    (replace(STUCK, reason='the opposite sign; set wrench.sign to -1 (--wrench-sign -1), or '
             'record poses in more directions'),
     {'against': ('--rig', 'nominal')}, '',
     'forcecal diagnose bag --rig nominal --wrench-sign -1 -o out'),
    (replace(STUCK, reason='the commands of the simulated recording are not those of the robot; '
             'run the simulator with the recorded commands'),
     {'against': ('--simulated', 'sim')}, '',
     'forcecal diagnose bag --simulated NEW_SIM_BAG -o out'),
    (replace(IDENTIFIED, verdict='ambiguous'), {'files': RIG}, '--prior out', PLAN),
    (UNKNOWN, {}, 'with --prior out', PLAN),
    (replace(UNKNOWN, candidates=(('unknown', 1.0),)), {}, 'the same motion again', AGAIN),
    (replace(UNKNOWN, remarks=(DRIVE,)), {},
     f'In {DRIVE[3:]}. Move more slowly, or give the model the limit', AGAIN),
    (Diagnosis('no_gap', '', at_tolerance=('kp[elbow]',)), {}, 'Check kp[elbow]: ', ''),
    (Diagnosis('no_gap', ''), {}, 'Nothing has to be changed.', ''),
    (replace(IDENTIFIED, verdict='partial', at_tolerance=('tool.mass',)), {'files': CALIBRATION},
     'Check that this tool and sensor are the calibrated ones', 'forcecal calibrate bag'),
    (SLOW, {'bag': 'my bag', 'files': RIG, 'how': ('--topic', 'wrench=/ft')}, '',
     ("forcecal simulate --rig out/rig_patched.yaml --commands 'my bag' --topic wrench=/ft "
     '-o corrected')),
    (SLOW, {'files': ('model_patched.xml',), 'against': ['--mujoco', 'arm.xml']}, '',
     'forcecal diagnose bag --mujoco out/model_patched.xml -o confirmed'),
    (SLOW, {'files': CALIBRATION}, '',
     'forcecal estimate bag --calibration out/calibration_patched.yaml -o contact'),
    # what a sensor does is fixed at the sensor and not in the model
    (IDENTIFIED, {'files': RIG, 'against': ('--mujoco', 'my arm.xml', '--topic', 'wrench=/ft')},
     'Shorten the delay of the force sensor',
     "forcecal diagnose NEW_BAG --mujoco 'my arm.xml' --topic wrench=/ft -o out"),
    (replace(IDENTIFIED, effects=(MASS,)), {'against': ('--simulated', 'sim_bag', SIGN, '-1')},
     ('Add tool_mass (change +5.00 ± 0.20 %) to the simulation, simulate the same commands, and '
      'diagnose again:'),
     'forcecal diagnose bag --simulated NEW_SIM_BAG --simulated-wrench-sign -1 -o out'),
    (replace(IDENTIFIED, effects=(PAYLOAD,)), {'against': ('--simulator', 'my_robot:make')},
     'Set payload to 1.2594 kg in parameters(), and diagnose again:',
     'forcecal diagnose bag --simulator my_robot:make -o out')])
def test_the_next_step_is_a_remedy_and_a_command_that_a_shell_takes(
        diagnosis, given, words, command):
    given = {'bag': 'bag', 'folder': 'out', 'files': (), **given}
    step = next_step(diagnosis, **given)
    assert words in step.words and step.command == command


def test_a_recording_that_cannot_be_used_is_refused_in_the_first_sentence():
    assert headline(STUCK) == 'Nothing can be compared: force.z (x; y) never changes [FC0304].'
    cut = replace(STUCK, reason='too few samples (12; 300 are needed)')
    assert headline(cut) == 'Nothing can be compared: too few samples (12; 300 are needed).'
    assert 'FC0304</a>' in render(view_without_signals(STUCK), ['bag'], NEXT)


def test_a_quantity_has_one_unit_in_the_table_and_in_words():
    gap = GAP._replace(channels={'torque.x': (0.05, 0.04, 0.006, 0.001),
                                 'torque.y': (0.005, 0.004, 0.003, 0.001)})
    d = replace(IDENTIFIED, gap=gap)
    page = render(view_without_signals(d), ['bag'], NEXT)
    assert 'mN m' not in page and page.count('>N m</td>') == 2
    assert '(0.0060 N m after correction), whose noise is 0.0010 N m' in words(d)['How large']


def test_joints_are_called_as_the_model_calls_them_and_the_heat_map_has_rows_of_something():
    gap = GAP._replace(channels={'joint.1': (2e-4, 2e-4, 1e-5, 1e-5), 'joint.0': (0.0,) * 4})
    d = replace(IDENTIFIED, gap=gap, joints=('base', 'elbow'), localisation=(
        Location('robot', 'joint.1', 'step', (8.0, 16.0), 12.3, 1e-9),
        Location('robot', 'joint.0', 'contact', (4.0, 8.0), 3.0, 1e-9)))
    elbow = [channel.name for channel in CHANNELS].index('joint.1')
    view = replace(_view(d), cells=tuple(
        TimeFrequencyBin(channel, 'step', band, excess, 9.0) for channel, band, excess in (
            (elbow, (8.0, 16.0), 3.0), (1, (16.0, 32.0), 0.01), (2, (0.0, 1.0), 12.0))))
    said = {one.label: one.words for one in facts(view, NEXT)}
    assert said['Where'].startswith('In elbow, phase step') and 'base in contact' in said['Where']
    assert 'RMS in elbow (' in said['How large']
    assert figures.closest(view).panels[0].title == 'Δ elbow'
    page = render(view, ['bag'], NEXT)
    assert 'joint.' not in page and page.count('>elbow</td>') == 2  # table and heat map
    octaves = [f'{high:g}' for _, high in BANDS[:-1]]
    heat = re.sub(r'\s+', ' ', page.partition('<div class="heat">')[2].partition('</div>')[0])
    assert re.findall('<caption>(.+?)</caption>', heat) == ['step']
    assert re.findall('<th>(.+?)</th>', heat) == ['Hz', *octaves]
    rows = [re.findall('<td.*?>(.*?)</td>', row) for row in heat.split('<tr>')[2:]]
    assert [row[0] for row in rows] == ['elbow', CHANNELS[2].name]
    assert rows[0][1 + octaves.index('16')] == '3.0' and rows[1][1 + octaves.index('1')] == '12'
    assert heat.count('--strength: 100%') == 1  # one scale, whatever the scheme of colours


def test_a_panel_has_the_unit_of_the_table():
    view = _view(IDENTIFIED)
    view = replace(view, recalibrated=1e-6 * view.recalibrated, explained=1e-6 * view.explained)
    panel = figures.residuals(view).panels[0]
    assert panel.unit == 'mN'
    assert np.nanmax(np.abs(panel.lines[0].values)) == pytest.approx(9e-3)


def test_a_page_leads_to_its_verdict_and_effects_or_says_where_they_are(page, monkeypatch):
    assert VERDICTS['identified'] in page
    assert re.findall('<a href="file://[^"]+/(.+?)">(.+?)</a>', page) == [
        ('verdicts.md#:~:text=identified', 'identified'),
        ('effects.md#:~:text=wrench_delay', 'wrench_delay')]
    monkeypatch.setattr(pages, 'ROOT', Path('nowhere'))
    installed = render(view_without_signals(IDENTIFIED), ['bag'], NEXT)
    assert '<a ' not in installed
    assert 'docs/reference/effects.md in the sources of forcecal_ros' in installed


def test_a_recording_says_which_when_and_how_long():
    t = np.arange(100.0) / 10
    one = Recording(wrench=Stream(t, np.zeros((100, 6))), source='a/bag',
                    start_ns=1_700_000_000 * 10**9)
    assert origin([one]) == ['a/bag · 2023-11-14 22:13:20 UTC · 10 s']
    assert origin([replace(one, start_ns=5)]) == ['a/bag · on simulated time · 10 s']


def test_a_line_of_a_day_is_thinned_without_losing_its_peak():
    t = np.arange(10 ** 6) / 250
    values = np.where(np.arange(10 ** 6) == 654_321, 7.0, 0.0)
    values[:5000] = np.nan
    line = between(Line('measured', 'measured', t, values), 0.0, t[-1])
    assert len(line.t) <= MOST_POINTS + 2 and np.nanmax(line.values) == 7.0
    assert (np.diff(line.t) > 0).all()


def test_what_is_recorded_in_one_of_twelve_blocks_is_drawn_as_a_line_with_its_own_spectrum():
    every = replace(_view(Diagnosis('no_gap', '')), phases=())
    sparse = np.arange(len(every.times)) % 12 == 0
    view = replace(every, present=np.repeat(sparse[:, np.newaxis], len(CHANNELS), axis=1),
                   measured=np.where(sparse[:, np.newaxis], every.measured, np.nan))
    shown = figures.signals(view)
    assert len(shown.panels) == figures.SHOWN
    for line in shown.panels[0].lines:
        assert np.isfinite(line.values).all() and len(line.t) == sparse.sum()
    # samples 48 ms apart hold nothing above 10.4 Hz
    frequencies = figures.spectra(view)[0].axes[0].lines[0].get_xdata()
    assert frequencies.max() == pytest.approx(0.5 / 0.048)


def test_the_plot_that_zooms_shows_the_phase_and_channel_of_the_verdict():
    shown = figures.closest(_view(IDENTIFIED))
    assert 9.0 < shown.start < 10.0 and 12.0 < shown.end < 13.0
    plot = json.loads(json.dumps(live(shown), allow_nan=False))
    assert [axis['title']['text'] for key, axis in plot['layout'].items()
            if key.startswith('yaxis')] == ['Δ force.y [N]', 'force.y [N]']
    assert {one['name'] for one in plot['data'] if one['visible'] is True} >= {
        'measured', 'simulated', 'explained'}
    step, = (one for one in plot['layout']['shapes'] if one['fillcolor'] == 'var(exciting)')
    assert (step['x0'], step['x1']) == (10.0, 12.0)
    assert [one['name'] for one in plot['data'] if one['showlegend']] == [
        'measured - simulated', 'measured - explained', 'measured', 'simulated', 'nominal',
        'explained']
    assert background(shown) == 'Background: grey for move; blue for step; orange for contact.'


def test_a_phase_is_named_where_its_name_has_room():
    t = np.linspace(0.0, 100.0, 200)
    phases = (Phase('step', 0.0, 8.0), Phase('move', 8.0, 9.0), Phase('approach', 9.0, 18.0),
              Phase('contact', 18.0, 100.0))
    shown = Shown((Panel('force x', 'N', (Line('measured', 'measured', t, t),)),), phases,
                  0.0, 100.0)
    names = {'step', 'approach', 'contact'}  # and not move, the shortest
    # a figure is narrow
    assert {text.get_text() for text in drawn(shown).axes[0].texts} == names - {'approach'}
    assert {one['text'] for one in live(shown)['layout']['annotations']} == names


def test_the_legend_of_a_figure_covers_no_phase():
    figure = drawn(figures.closest(_view(IDENTIFIED)))
    figure.canvas.draw()
    names = [text.get_window_extent() for text in figure.axes[0].texts]
    assert names and figure.legends[0].get_window_extent().y0 > max(one.y1 for one in names)


@pytest.mark.parametrize('after, channel', [(0.36, 'torque.x'), (0.01, 'force.y')])
def test_picture_and_table_show_the_channel_that_the_effects_change_most(after, channel):
    gap = GAP._replace(channels={'force.y': (0.4, 0.38, after, 0.25),
                                 'torque.x': (0.02, 0.02, 0.01, 0.02)})
    view = _view(replace(IDENTIFIED, gap=gap))
    assert figures.closest(view).panels[1].title == channel
    page = render(view_without_signals(view.diagnosis), ['bag'], NEXT)
    assert re.findall(r'<tr class="worst"><td[^>]*>([^<]+)', page) == [channel]
    head = [*map(str.strip, re.findall(r'<th[^>]*>([^<]+)</th>', page))]
    assert head[:6] == ['channel', 'measured noise', 'nominal', 'before', 'after', 'unit']
    assert f'RMS in {channel} (' in words(view.diagnosis)['How large']


def test_without_plotly_the_page_shows_pictures_and_says_how_to_get_more(monkeypatch):
    monkeypatch.setitem(sys.modules, 'plotly', None)
    monkeypatch.setitem(sys.modules, 'plotly.offline', None)
    pages._plotly.cache_clear()
    page = render(_view(IDENTIFIED), ['bag'], NEXT)
    pages._plotly.cache_clear()
    assert page.count('<img') == 7 and '<script' not in page and '[plots]' in page
    assert len(page) < 1e6


def test_with_plotly_the_page_holds_it_once_and_needs_no_network(page):
    assert page.index('<h2>Residuals') < page.index('<summary>Signals')
    assert page.count('>Signals<') == 1
    pytest.importorskip('plotly')
    assert page.count('id="plotly"') == 1 and page.count('class="live"') == 3
    assert not re.search(r'(?:src|href)="(?!data:|file:)', page)
    assert len(page) < 5e6


def test_an_interval_is_made_in_one_place():
    for path in Path(figures.__file__).parents[1].rglob('*.py'):
        text = path.read_text()
        assert '+- {' not in text, f'{path}: use quantity() or pair(), which print 95 %'
        assert not re.search(r'\b(?:quantity|pair|with_error)\([^\n]*HALF', text), path


@NEEDED
def test_a_diagnosis_fits_a_phone(page, tmp_path):
    (tmp_path / 'report.html').write_text(page)
    assert cut_on_a_phone(tmp_path / 'report.html', tmp_path / 'browser') == []


def test_the_next_command_begins_as_the_program_was_started(monkeypatch):
    monkeypatch.setenv('FORCECAL_COMMAND', r'./a\ b/run')
    page = re.sub('</?span>', '', render(view_without_signals(IDENTIFIED), ['bag'], NEXT))
    assert r'<pre>./a\ b/run simulate</pre>' in page


def test_a_note_of_many_numbers_has_a_line_for_each():
    notes = ('recalibrated: a 1; b 2; c 3; d 4', 'one part; another')
    page = render(view_without_signals(replace(IDENTIFIED, notes=notes)), ['bag'], NEXT)
    assert 'Recalibrated: a 1;<br> b 2;<br> c 3;<br> d 4.</p>' in page
    assert '<p>One part; another.</p>' in page
