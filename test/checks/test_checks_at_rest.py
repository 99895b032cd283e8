"""By what weighs on it a wrench tells that its frame, axes or units are not those of a model."""

from forcecal_ros.checks.hypotheses import judge, Known
from forcecal_ros.checks.messages import Stated
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_about, rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.sim.rig.file import load_rig
from longer import first
import numpy as np
import pytest
from rig_recordings import own_recording

T = np.arange(0.0, 40.0, 0.02)
G = np.array([0.0, 0.0, -9.80665])
MASS, COM = 1.3, np.array([0.005, -0.012, 0.06])


def recorded(seed, change=lambda w, R: w, noise=0.3):
    """Return reorientations of a gripper, pushed for a quarter of the time."""
    rng = np.random.default_rng(seed)
    ways = rng.standard_normal((14, 3)).repeat(2, axis=0)
    times = np.sort(np.concatenate([3.0 * np.arange(14) - 0.8, 3.0 * np.arange(14) + 0.8]))
    R = rotation_from_vector(np.stack([np.interp(T, times, way) for way in ways.T], axis=1))
    force = MASS * (G @ R)
    wrench = np.hstack([force, np.cross(COM, force)]) + [3.0, -2.0, 5.0, 0.1, 0.2, -0.1]
    wrench[T % 6.0 < 1.5] += rng.standard_normal(6) * [5.0, 5.0, 5.0, 0.5, 0.5, 0.5]
    wrench += noise * rng.standard_normal((len(T), 6)) * [1.0, 1.0, 1.0, 0.05, 0.05, 0.05]
    return Recording(wrench=Stream(T, change(wrench, R)),
                     pose=PoseStream(T, np.zeros((len(T), 3)), R))


def refuse_other_axes(recording):
    assert all('centre of mass' in note for note in judge(
        recording, G, Stated(by='rig'), Known(MASS, COM)))


def turned(degrees):
    Q = rotation_about('z', np.radians(degrees))
    return lambda w, R: np.hstack([w[:, :3] @ Q.T, w[:, 3:] @ Q.T])


def lifted(w, R):
    """Pull most of the weight up, as a spring above the tool does."""
    return w - np.hstack([0.8 * MASS * (G @ R), np.zeros((len(R), 3))])


@pytest.mark.parametrize('change', first([
    lifted, lambda w, R: w.clip([-8.0] * 6, [12.0] * 6), lambda w, R: 0.4 * w, turned(1.0)], 2))
def test_pushes_gains_biases_and_small_turns_are_left_to_whoever_looks_for_them(change):
    refuse_other_axes(recorded(0, change))


@pytest.mark.parametrize('change, said', [
    (lambda w, R: w * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0], r'the model has it at \(0.005 -0.012 '),
    (lambda w, R: w * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0], 'its forces are in kN; multiply by')])
def test_other_frames_axes_and_units_are_refused_by_cause(change, said):
    with pytest.raises(DataError, match=said):
        refuse_other_axes(recorded(0, change))


def test_a_sensor_that_hardly_turns_says_nothing():
    still = np.broadcast_to(np.eye(3), (len(T), 3, 3))
    one = recorded(0, lambda w, R: -w)
    refuse_other_axes(Recording(wrench=one.wrench, pose=PoseStream(
        T, np.zeros((len(T), 3)), still)))


def test_a_diagnosis_names_the_unit_before_it_looks_for_effects():
    one = own_recording(20)
    scaled = Recording(**{**vars(one), 'wrench': Stream(one.wrench.t, one.wrench.values / 9.80665,
                                                        one.wrench.frame)})
    diagnosis = RigSource(load_rig()).diagnose(scaled).diagnosis
    assert diagnosis.verdict == 'invalid_data'
    assert 'its forces are in kgf; multiply by 9.8066' in diagnosis.reason
