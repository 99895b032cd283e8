"""Recordings that cannot be compared, or not all of the time, are told from gaps."""

from dataclasses import replace
import re
from types import SimpleNamespace
import warnings

from changed import later, with_values
from forcecal_ros.checks.clocks import clocks, dropouts, skew_between
from forcecal_ros.checks.signals import silences
from forcecal_ros.core.geometry import rotation_about
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose import recordings
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.coverage import not_compared
from forcecal_ros.diagnose.judge.named_effects import from_checks
from forcecal_ros.diagnose.recordings import bridge_pauses, Corrected
from forcecal_ros.diagnose.sources.rig import RigSource, ToolSource
from forcecal_ros.io.bags import read_recording
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
import numpy as np
import pytest

STREAMS = ('wrench', 'accelerometer', 'optidrive', 'pose', 'target')


def paused(recording, *pauses):
    """Leave parts out of all streams."""
    for start, end in pauses:
        recording = replace(recording, **{
            name: (s := getattr(recording, name)).rows((s.t <= start) | (s.t >= end))
            for name in STREAMS})
    return recording


@pytest.fixture(scope='module')
def recording():
    """Ten seconds of slow turns and a slide in front of noise; no rig would say just that."""
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(10_000)
    grid = 4e-3 * np.arange(2500)
    R = np.stack([rotation_about('x', 0.5 * np.sin(x)) for x in grid])
    pose = PoseStream(grid, np.outer(0.01 * grid, [1.0, 0.0, 0.0]), R)
    return Recording(
        wrench=Stream(t, rng.standard_normal((len(t), 6))), pose=pose, target=pose,
        accelerometer=Stream(t, rng.standard_normal((len(t), 3))),
        optidrive=Stream(t, 1e-5 * rng.standard_normal((len(t), 1))))


def both(recording):
    """Diagnose by commands and by motion; warnings are errors."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        rig = load_rig()
        found = [RigSource(rig).diagnose(recording).diagnosis,
                 ToolSource(rigid_tool_of_rig(rig)).diagnose(
                     replace(recording, target=None)).diagnosis]
    assert [d.verdict for d in found] == 2 * ['invalid_data']
    assert not any('\n' in d.reason for d in found)
    return [d.reason for d in found]


def from_6_s_on(values):
    values[6000:] = values[6000]
    return values


def every_20th_lost(values):
    values[::20] = np.nan
    return values


@pytest.mark.parametrize('spoil, said', [
    (lambda r: later(r, 1e4), r'wrench.* \+10000\.0 s.*PTP'),
    (lambda r: later(r, 1e4, 'accelerometer'), r'accelerometer.* \+10000\.0 s.*PTP'),
    (lambda r: with_values(r, every_20th_lost, 'optidrive'), r'^optidrive: 5\.0 % of the samples'),
    (lambda r: with_values(r, lambda v: 0.0 * v + v[0]), '^wrench: the values never change; c'),
    (lambda r: with_values(r, from_6_s_on),
     r'wrench: all channels are constant from 6\.00 s to 10\.00 s'),
    (lambda r: with_values(r, lambda v: np.where(np.arange(6) == 2, 7.0, v)),
     '^force.z is constant at 7; check')])
def test_what_no_sensor_can_have_said_is_invalid(recording, spoil, said):
    for reason in both(spoil(recording)):
        assert re.search(said, reason)


def minutes_apart(recording):
    """Let all streams pause for 100 s."""
    return replace(recording, **{name: replace(s, t=np.where(s.t < 5.5, s.t, s.t + 100.0))
                                 for name, s in ((n, getattr(recording, n)) for n in STREAMS)})


@pytest.mark.parametrize('change, said', [
    (lambda r: [later(r, -1e4, 'target')],
     r'^streams do not overlap with .+ target \(target_frame\) -10000.0 s; synchronise'),
    (lambda r: [Recording()], 'target_frame'),
    (lambda r: [replace(r, wrench=None, accelerometer=None)], 'neither wrench nor accelerometer'),
    (lambda r: [r, replace(r, wrench=None)], 'holds wrench'),
    (lambda r: [minutes_apart(r)], '--heldout')])
def test_what_cannot_be_compared_along_commands_is_invalid(recording, change, said):
    diagnosis = RigSource(load_rig()).diagnose(*change(recording)).diagnosis
    assert diagnosis.verdict == 'invalid_data'
    assert re.search(said, diagnosis.reason)


def test_a_missing_sensor_is_stated(recording):
    def said(of):
        return not_compared(SimpleNamespace(datasets=[SimpleNamespace(recording=of)], noise=[
            SimpleNamespace(sigma=np.ones((3, len(CHANNELS))))]))

    assert said(recording) == ''
    assert 'wrench_sensor and environment (no wrench' in said(replace(recording, wrench=None))


def test_a_pause_is_no_lost_samples_and_lost_samples_are_no_pause(recording):
    cut = paused(recording, (4.0, 6.0))
    found = clocks(cut)
    assert not dropouts(found) and not skew_between(found)
    assert tuple(silences(cut)) == ('all streams: nothing was recorded for 2.0 s from 4.0 s on',)
    own = tuple(silences(replace(recording, wrench=cut.wrench)))
    assert own == ('wrench: nothing was recorded for 2.0 s from 4.0 s on',)
    kept = np.random.default_rng(1).random(len(cut.wrench)) > 0.02
    lost = dropouts(clocks(replace(cut, wrench=cut.wrench.rows(kept))))
    assert lost == {'wrench': pytest.approx(0.02, abs=5.0 * np.sqrt(0.02 / len(kept)))}


def test_a_clock_is_judged_by_its_slope_although_it_starts_anew_after_a_pause(recording):
    t = recording.wrench.t
    t = np.where(t < 5.0, t, t + 2.0004) * (1.0 + 1e-4)
    clock, = clocks(Recording(wrench=replace(recording.wrench, t=t)))
    assert clock.skew == pytest.approx(1e-4, rel=1e-3) and clock.lost == 0.0


def test_over_a_pause_the_robot_is_led_from_the_last_command_to_the_next(recording):
    whole = bridge_pauses(paused(recording, (4.0, 6.0)))
    np.testing.assert_allclose(np.diff(whole.target.t), 4e-3, atol=1e-9)
    way = np.diff(whole.target.position[:, 0])
    assert (way > -1e-12).all() and way.max() < 5e-4
    assert not ((whole.wrench.t > 4.0) & (whole.wrench.t < 7.0)).any()


def test_a_limit_that_no_sensor_has_is_a_note_and_no_effect(recording):
    swing = 5e4 * np.sin(2.0 * recording.wrench.t)[:, np.newaxis]
    raw = with_values(recording, lambda v: np.clip(swing + v, -32767.0, 32767.0))
    model = load_rig().accelerometer.acc1
    effects, notes = from_checks([Corrected(raw, (), {}, {})], np.ones(16), model)
    assert not effects and any('is clipped at 3.277e+04' in note for note in notes)


@pytest.mark.long
def test_a_sound_recording_with_pauses_has_no_gap(second_rig):
    sample = paused(read_recording(second_rig / 'bag'), (1.5, 3.2), (15.0, 19.0))
    diagnosis = RigSource(load_rig()).diagnose(sample).diagnosis
    assert diagnosis.verdict == 'no_gap' and len(diagnosis.notes) == 2


def test_the_start_of_a_long_recording_is_chosen_by_its_first_motion(monkeypatch):
    """Replaying six minutes for each start took 1.5 s more and told no more."""
    rig, t = load_rig(), 4e-3 * np.arange(15_000)
    place = np.stack([0.1 * np.sin(2.0 * t), 0.05 * np.sin(3.1 * t), 0.0 * t], axis=1)
    place[t < 2.0] = place[500]
    target = PoseStream(t, place, np.tile(np.eye(3), (len(t), 1, 1)))
    late = Recording(target=target, pose=replace(target, t=t + 1.3e-3))
    ends = []

    def replayed(rig, commands, start, end, accelerometer):
        ends.append(end)
        return Replay(rig, commands, start, end, accelerometer)

    monkeypatch.setattr(recordings, 'Replay', replayed)
    assert recordings.estimate_start(late, rig, 'acc1') == pytest.approx(-2.7e-3, abs=4.1e-3)
    assert len(ends) == 3 and max(ends) == pytest.approx(22.0, abs=0.01)
