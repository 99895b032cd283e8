"""The second rig: its physics, and that it shares nothing with the package it checks."""

from pathlib import Path
import re

from blind import outside
from blind.cases import draw, kinds, LIBRARY, OUTSIDE, Runner
from blind.motion import Path as Trajectory
from blind.motion import TOUCH
from blind.noise import draw_colours
from blind.rig import Commands, nominal, run
from blind.sensors import record
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

EFFECTS = {**LIBRARY, **OUTSIDE}


IMPORT = re.compile(r'^\s*(?:from|import) (\w+)', re.MULTILINE)


@pytest.mark.parametrize('one, other', [
    ('benchmark/blind', 'forcecal_ros'), ('forcecal_ros', 'blind')])
def test_second_rig_and_package_never_import_each_other(one, other):
    imports = {name for path in (ROOT / one).rglob('*.py')
               for name in IMPORT.findall(path.read_text())}
    assert 'numpy' in imports and other not in imports


def test_nominal_run_meets_that_of_another_implementation(rig_sample):
    with np.load(rig_sample / 'clean.npz') as data:
        truth = run(nominal(), Commands(data['target_position'], data['target_rotation'], ()))
        i = np.round(data['t'][:-1] / 0.00025).astype(int)
        sensors = nominal().sensors
        pairs = {
            'force': (truth.felt.wrench[i, :3] + sensors.bias[:3], data['wrench'][:-1, :3], 1e-3),
            'torque': (truth.felt.wrench[i, 3:] + sensors.bias[3:], data['wrench'][:-1, 3:],
                       2e-4),
            'volts': (truth.felt.specific[i] * sensors.accel_gain + sensors.accel_offset,
                      data['volts'][:-1], 5e-5),
            'slide': (truth.felt.slide[i], data['optidrive'][:-1], 2e-7),
            'position': (truth.motion.position[i], data['position'][:-1], 1e-9)}
    # both are converged to 1e-4 N; contact begins within one step of either, with a jump
    for name, (mine, theirs, tolerance) in pairs.items():
        assert np.sqrt(np.mean((mine - theirs)**2)) < tolerance, name


@pytest.fixture(scope='module')
def short():
    path = Trajectory()
    path.hold('settle', 0.3)
    path.go('move', 0.6, np.array([1.05, 0.03, 1.0]), np.array([0.3, 0.4, 0.0]))
    path.go('approach', 0.5, np.array([TOUCH + 0.015, 0.03, 1.0]), np.array([0.0, 0.1, 0.0]))
    path.go('contact', 0.3, np.array([TOUCH + 0.02, 0.05, 1.0]))
    path.go('retract', 0.4, np.array([1.0, 0.0, 1.0]), np.zeros(3))
    return path.commands()


def _signals(rig, commands):
    recorded = record(rig, run(rig, commands), None, 1)
    # in units of the nominal noise
    return np.concatenate([one.ravel() for one in (
        recorded.wrench / [0.25, 0.25, 0.25, 0.02, 0.02, 0.02], recorded.volts / 0.01,
        recorded.slide / 20e-6, recorded.position / 20e-6, recorded.wrench_t / 1e-3,
        recorded.volts_t / 1e-3)])


@pytest.fixture(scope='module')
def without(short):
    """Return what the nominal rig says on the way, which is compared with every effect."""
    return _signals(nominal(), short)


@pytest.mark.long
# messages are missing after a dropout; a stop is a place; a screen of no mass is still on a spring
@pytest.mark.parametrize('name', [
    name for name in EFFECTS if name not in ('dropouts', 'slide_stop', 'screen_mode')])
def test_effect_vanishes_with_its_size_and_shows_at_its_largest(name, short, without):
    effect = EFFECTS[name]

    def change(size):
        rig = effect.apply(nominal(), size, np.random.default_rng(4))
        return np.abs(_signals(rig, short) - without).max()

    assert change(1e-6 * effect.low) < 0.05
    assert change(effect.high) > (1.0 if name != 'clock_skew' else 0.1)


def test_whitened_noise_is_white_with_unit_variance():
    rng = np.random.default_rng(0)
    for colour in (one for _ in range(8) for one in draw_colours(rng)['wrench']):
        white = colour.whiten(colour.draw(20000, 0.25, rng), 0.25)[100:]
        assert abs(white.std() - 1) < 4 / np.sqrt(2 * len(white))
        assert abs(np.mean(white[1:] * white[:-1])) < 4 / np.sqrt(len(white))


def test_cases_come_in_the_mix_that_was_agreed():
    assert [kinds(400).count(kind) for kind in ('single', 'pair', 'none', 'outside', 'lazy')
            ] == [180, 60, 80, 60, 20]
    assert kinds(240, 100).count('none') == 100 and len(kinds(240, 100)) == 240


def test_same_seed_makes_the_same_case_and_effects_leave_the_noise_alone(second_rig):
    # the fixture has compiled the rig for all workers
    case, again = (draw('single', 3, 20.0, 'accel_bias', 0.5) for _ in range(2))
    runner = Runner(case)
    one, clean = runner.recording(0), runner.recording(0, ())
    assert np.array_equal(one.volts, Runner(again).recording(0).volts)
    assert np.array_equal(one.wrench, clean.wrench)
    steps = (one.volts - clean.volts).std(axis=0)
    assert steps.max() < 1e-12 and np.abs(one.volts - clean.volts).max() > 0.01


def test_effects_outside_the_library_are_those_that_were_fixed():
    results = ROOT / 'benchmark' / 'blind' / 'RESULTS.md'
    if not results.exists():
        pytest.skip('nothing has been opened yet')
    assert outside.fingerprint()['outside.yaml'] in results.read_text()
