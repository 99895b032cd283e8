"""Claims about rigs that are fitted to recordings of a robot that is none of this package's."""

from dataclasses import replace
from functools import cache
import re

from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose.sources.pair import shift_times
from forcecal_ros.diagnose.sources.rig import is_tracked
from forcecal_ros.effects.rig import Axis, Unexplained
from forcecal_ros.io.bags import write_recording
from forcecal_ros.rig_fit.fit import command_period, fit_rig, fit_tool, noise_of
from forcecal_ros.rig_fit.robot import at_ends, Followed, LIMITS
from forcecal_ros.sim.rig.file import dump_rig, load_rig
from forcecal_ros.sim.rig.plant import Plant
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from own_arm import simulated, TOLERANCES
import pytest
from scipy.signal import cont2discrete, lfilter

NOMINAL = load_rig('rigid_tool.yaml')
PERIOD, DELAY, W = 0.008, 0.011, 60.0
LAG = DELAY + 2.0 / W + PERIOD
"""Of the robot below: delay, two equal poles, and a period to interpolate commands [s]."""

SECONDS = 12.0
MASS, BIAS = 2.0, np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.1])
"""Of a tool whose mass is all in the origin of the sensor [kg], [N], [N m]."""


def followed(t, told, at, derivative=0):
    """Return what the robot makes of commands, interpolated: late, through two equal poles."""
    fine = np.arange(0.0, t[-1] + PERIOD, 0.0005)
    held = np.interp(fine - DELAY - PERIOD, t, told)
    num, den, _ = cont2discrete(([W ** 2], [1.0, 2.0 * W, W ** 2]), 0.0005, 'foh')
    y = lfilter(num.ravel(), den, held - told[0])
    if derivative == 2:
        speed = np.gradient(y, 0.0005)
        return np.interp(at, fine, W ** 2 * (held - told[0] - y) - 2.0 * W * speed)
    return np.interp(at, fine, y) + told[0]


@cache
def recording(axes=(0, 1, 2), seed=0):
    """Record a robot told poses every 8 ms, which says its own every 10 ms with noise."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(round(SECONDS / PERIOD))
    rise = np.clip(np.minimum(t - 1.0, SECONDS - 1.0 - t), 0.0, 1.0)
    paths = np.zeros((len(t), 4))
    for column in (*axes, 3):
        for frequency in rng.uniform(0.2, 1.5, 4):
            paths[:, column] += rise * rng.uniform(0.3, 0.6) * np.sin(
                2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0)) / frequency
    paths *= [0.1, 0.1, 0.1, 0.8]
    at, seen = 0.01 * np.arange(round(SECONDS / 0.01)), 0.002 * np.arange(round(SECONDS / 0.002))
    about = np.array([0.6, 0.8, 0.0])

    def turned(angle):
        return np.diag([1.0, -1.0, -1.0]) @ rotation_from_vector(np.outer(angle, about))

    reached = np.stack([followed(t, path, at) for path in paths.T], axis=1)
    R = turned(followed(t, paths[:, 3], seen))
    a = np.stack([followed(t, path, seen, 2) for path in paths.T[:3]], axis=1)
    pull = -MASS * np.einsum('nji,nj->ni', R, a + [0.0, 0.0, 9.80665])
    wrench = np.hstack([pull, 0.0 * pull]) + BIAS
    return Recording(
        wrench=Stream(seen, wrench + rng.normal(size=wrench.shape) * ([0.1] * 3 + [0.005] * 3),
                      'ft_sensor'),
        pose=PoseStream(at, reached[:, :3] + 5e-5 * rng.normal(size=(len(at), 3)),
                        turned(reached[:, 3]) @ rotation_from_vector(
                            1e-4 * rng.normal(size=(len(at), 3)))),
        target=PoseStream(t, paths[:, :3], turned(paths[:, 3])), source='robot')


def test_old_rig_files_stay_as_they_are_and_new_ones_come_back_equal(tmp_path):
    assert 'unexplained' not in dump_rig(NOMINAL)
    axis = Axis(0.01, (0.5, 0.0, 0.0), (0.5, 0.0, 0.0), ((0.1, 0, 0, -0.1, 0, 0),) * 5)
    rig = replace(NOMINAL, robot=replace(NOMINAL.robot, y=axis,
                                         unexplained=Unexplained(1e-4, 2e-4)),
                  servo=replace(NOMINAL.servo, orientation_delay=0.02, orientation_damping=0.7))
    (tmp_path / 'rig.yaml').write_text(dump_rig(rig))
    assert load_rig(tmp_path / 'rig.yaml') == rig


def test_delays_of_axes_and_orientation_shift_their_motion_alone():
    p = np.cumsum(np.cumsum(np.random.default_rng(1).normal(size=(200, 3)), axis=0), axis=0) * 1e-5
    p[:30] = p[30]
    xyzw = np.zeros((200, 4))
    xyzw[:, 2], xyzw[:, 3] = np.sin(p[:, 0]), np.cos(p[:, 0])

    def moved(rig, parts):
        plant = Plant(rig)
        plant.rest(p[0], xyzw[0])
        blocks = [plant.move(a, b) for a, b in zip(np.split(p, parts), np.split(xyzw, parts))]
        every = 2 * plant.steps
        return [np.concatenate([getattr(m, name)[every::every] for m in blocks])
                for name in ('position', 'R_base_sensor')]

    robot = NOMINAL.robot
    late = Axis(3 * robot.period, robot.feedback, robot.feedforward)
    rig = replace(NOMINAL, robot=replace(robot, z=late),
                  servo=replace(NOMINAL.servo, orientation_delay=2 * robot.period))
    (position, R), (late_position, late_R) = moved(NOMINAL, [90]), moved(rig, [50, 51, 120])
    assert np.array_equal(late_position[:, :2], position[:, :2])
    # an axis of its own answers to the command of its period: one period earlier
    assert np.allclose(late_position[2:, 2], position[:-2, 2], rtol=0.0, atol=1e-15)
    assert np.allclose(late_R[2:], R[:-2], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('change, words', [
    (lambda r: replace(r, target=None), r'no messages of target_frame \(target\); record'),
    (lambda r: replace(r, pose=None), r'no messages of current_pose \(pose\); record'),
    (lambda r: replace(r, target=r.target.between(0.0, 0.9)),
     'overlap for 0.9 s, expected at least 10 s'),
    (lambda r: replace(r, target=r.target.between(0.0, 9.98)),
     r'overlap for 9\.9\d+ s, expected at least 10 s'),
    (lambda r: replace(r, target=replace(r.target, position=0.0 * r.target.position)),
     'the commands move by 0 mm, expected at least 1 mm')])
def test_what_cannot_tell_a_robot_is_refused_by_name(change, words):
    with pytest.raises(DataError, match=words):
        fit_rig([change(recording())], None, NOMINAL)


def test_commands_that_come_irregularly_are_refused():
    t = np.cumsum(np.random.default_rng(2).exponential(0.01, 500))
    with pytest.raises(DataError, match='are irregular'):
        command_period(t)
    assert command_period(np.delete(0.004002 * np.arange(500), [7, 90])) == 0.004


def test_noise_is_told_beside_a_motion():
    t = 0.004 * np.arange(5000)
    noise = 1e-5 * np.random.default_rng(4).normal(size=(5000, 3))
    assert noise_of(noise + np.sin(10.0 * t)[:, np.newaxis]) == pytest.approx(1e-5, rel=0.05)


def test_only_a_model_that_leaves_more_than_noise_gives_way_to_the_measured_motion():
    def rig(left):
        return replace(NOMINAL, robot=replace(NOMINAL.robot, unexplained=left))
    assert not is_tracked(NOMINAL)
    assert not is_tracked(rig(Unexplained(5e-6, 5e-6)))
    assert is_tracked(rig(Unexplained(5e-5, 0.0)))


@pytest.mark.parametrize('axes', [(0,), pytest.param((0, 1, 2), marks=pytest.mark.long)])
def test_the_command_writes_a_rig_of_other_rates_with_its_lag_that_leaves_little(
        axes, tmp_path, capsys):
    heldout = recording(axes, seed=3)
    for name, one in (('bag', recording(axes)), ('heldout', heldout),
                      ('untold', replace(heldout, target=None))):
        write_recording(tmp_path / name, one)
    file = str(tmp_path / 'rig.yaml')
    assert main(['fit-rig', str(tmp_path / 'untold'), '-o', file]) == 1
    assert 'no messages of target_frame (target)' in capsys.readouterr().err
    assert main(['fit-rig', str(tmp_path / 'bag'), '--heldout', str(tmp_path / 'heldout'),
                 '-o', file]) == 0
    out, err = capsys.readouterr()
    rig = load_rig(file)
    assert ('axis y never moved; it is given the model' in err) == (
        1 not in axes)
    assert rig.robot.x and (rig.robot.x == rig.robot.y == rig.robot.z) == (1 not in axes)
    assert rig.robot.period == PERIOD
    assert rig.wrench_sensor.rate == pytest.approx(500.0)
    # rates are whole multiples of the commands': 100 Hz beside 125 Hz is simulated at 125 Hz
    assert rig.pose_sensor.rate == pytest.approx(125.0)
    lags = [float(lag) for lag in re.findall(r': .*lag ([\d.]+) .*ms', out)]
    assert lags == pytest.approx([1e3 * LAG] * 4, abs=0.5)  # of three axes and the orientation
    assert rig.pose_sensor.position_noise == pytest.approx(5e-5, rel=0.1)
    assert rig.wrench_sensor.force_noise == pytest.approx(0.1, rel=0.05)
    assert rig.tool.mass == pytest.approx(MASS, rel=0.02)
    assert rig.wrench_sensor.bias == pytest.approx(BIAS, abs=0.1)
    # 0.5 m/s, of which a lag of 0.2 ms would leave 100 um
    left = rig.robot.unexplained
    assert left.position < 1e-4 and left.orientation < 1e-3
    assert 'held-out error of the robot model' in out and 'written to' in out
    again = simulate(rig, heldout.target, noise=False)
    apart = np.interp(again.pose.t, heldout.pose.t, heldout.pose.position[:, 0]
                      ) - again.pose.position[:, 0]
    assert apart[100:].std() < 2e-4


def test_without_static_poses_the_motion_tells_where_an_imu_sits():
    made = shift_times(simulated(imu=True), -1000.0)
    accelerometer = fit_tool(TOLERANCES, [made], IdentificationSettings())[0].accelerometer
    np.testing.assert_allclose(accelerometer.position, TOLERANCES.accelerometer.position,
                               atol=1e-3)
    assert accelerometer.acc1.gain == (1.0, 1.0, 1.0)
    np.testing.assert_allclose(accelerometer.acc1.offset, 0.0, atol=5e-3)
    imu = made.accelerometer
    turned = replace(made, accelerometer=replace(imu, values=imu.values[:, [1, 2, 0]]))
    with pytest.raises(DataError, match='its axes are rotated by 120 deg'):
        fit_tool(TOLERANCES, [turned], IdentificationSettings())


def test_any_orientation_that_is_tried_while_fitting_is_integrated_stably():
    t = 0.004 * np.arange(1000)
    R = rotation_from_vector(np.outer(np.sin(6.0 * t), [0.6, 0.8, 0.0]))
    place, all_rows = np.zeros((len(t), 3)), np.ones(len(t), dtype=bool)
    told = Followed(place, R, place, R, all_rows, all_rows)
    for w in (LIMITS[0][0], LIMITS[1][0]):
        rig = replace(NOMINAL, robot=replace(NOMINAL.robot, period=0.004), servo=replace(
            NOMINAL.servo, orientation_bandwidth=w, orientation_damping=LIMITS[1][1]))
        made = at_ends(rig, told).R_base_sensor
        assert np.abs(made @ np.swapaxes(made, 1, 2) - np.eye(3)).max() < 1e-6
