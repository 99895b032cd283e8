"""Claims about effects inside the integration: spring, friction, play, cable, spindle, robot."""

from effects_runs import (
    AIM,
    BIAS,
    clean,
    GRAVITY,
    having,
    HOME,
    pressing,
    resting,
    RIG,
    RIGID,
)
from forcecal_ros.core.geometry import rotation_about
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.plant import Plant, same_motion
from forcecal_ros.sim.rig.simulator import checked_commands
import numpy as np
import pytest

STIFFNESS, DAMPING = RIG.optidrive.stiffness, RIG.optidrive.damping
WEIGHT = RIG.tool.mass * 9.80665


def tilted(angle):
    """Let x of S point downwards by an angle."""
    return rotation_about('y', angle) @ AIM


def sag(rig, angle):
    """Displacement at rest, x of S pointing downwards by an angle."""
    return clean(rig, resting(tilted(angle))).optidrive.values[-1, 0]


def tilting(angle):
    """Turn S slowly about Y, so that its weight along the slide changes."""
    return PoseStream(0.004 * np.arange(len(angle)), np.tile(HOME, (len(angle), 1)),
                      np.array([tilted(a) for a in angle]))


def along(position):
    """Move S without turning it."""
    n = len(position)
    return PoseStream(0.004 * np.arange(n), position, np.tile(AIM, (n, 1, 1)))


def plant_motion(rig, target):
    """Motion of S at the nodes of the integration, and the time between them."""
    plant = Plant(rig)
    positions, xyzw = checked_commands(target.position, target.R_base_sensor)
    plant.rest(positions[0], xyzw[0])
    return plant.move(positions, xyzw), rig.robot.period / plant.steps / 2.0


@pytest.mark.parametrize('angle', [-0.4, 0.1, 0.4])
def test_stiffening_spring_carries_the_weight_by_k_s_and_cubic_s3(angle):
    s = sag(having('tool_stiffening', cubic=2e7), angle)
    assert STIFFNESS * s + 2e7 * s ** 3 == pytest.approx(WEIGHT * np.sin(angle), abs=1e-5)


@pytest.mark.parametrize('gap', [0.0005, 0.003])
def test_dead_zone_of_the_spring_is_as_wide_as_the_gap(gap):
    rig = having('tool_backlash', gap=gap)
    down, up = sag(rig, 0.1), sag(rig, -0.1)
    assert down - up == pytest.approx(gap + 2.0 * WEIGHT * np.sin(0.1) / STIFFNESS, abs=1e-9)
    assert sag(rig, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_within_its_play_the_tool_floats_freely():
    """A level tool that starts to move keeps back until the spring takes it along."""
    t = 0.004 * np.arange(100)
    position = HOME - np.outer(0.5 * 0.05 * t ** 2, [1.0, 0.0, 0.0])
    rig = with_effects(RIG, {'tool_backlash': {'gap': 0.004}, 'tool_damping': {'change': -0.99}})
    recording = clean(rig, along(position))
    s, force = recording.optidrive.values[:, 0], recording.wrench.values[:, 0] - BIAS[0]
    free = s < 0.0019
    assert free.sum() > 200 and s.max() > 0.0021
    assert np.abs(force[free]).max() < 0.1
    assert np.abs(force[s > 0.0021]).max() > 0.4


def test_friction_lags_by_its_force_on_either_way():
    coulomb = 4.0
    recording = clean(having('tool_friction', force=coulomb, velocity_scale=2e-4),
                      tilting(0.3 * np.sin(0.008 * np.arange(1200))))
    s, force = recording.optidrive.values[:, 0], recording.wrench.values[:, 0] - BIAS[0]
    v = np.gradient(s, 0.001)
    held, moving = force - STIFFNESS * s - DAMPING * v, np.abs(v) > 2e-3
    assert held[moving] == pytest.approx(coulomb * np.sign(v[moving]), abs=0.02)
    assert {-1.0, 1.0} <= set(np.sign(v[moving]))


def test_friction_holds_what_is_less_than_its_force():
    coulomb, creep = 4.0, 1e-4
    # 2.5 N of weight along the slide
    target = tilting(0.02 * np.minimum(0.02 * np.arange(400), 1.0))
    rig = having('tool_friction', force=coulomb, velocity_scale=creep)
    s, free = (clean(r, target).optidrive.values[:, 0] for r in (rig, RIG))
    late = WEIGHT * np.sin(0.02)
    assert free[-1] == pytest.approx(late / STIFFNESS, rel=1e-2)
    assert np.diff(s)[400:].max() / 0.001 < 1.01 * creep * np.arctanh(late / coulomb)
    assert s[-1] < 0.4 * free[-1]


def test_friction_with_presliding_bends_by_its_stiffness_and_does_not_creep():
    coulomb, presliding = 4.0, 5e-5
    # 2.5 N of weight along the slide
    target = tilting(0.02 * np.minimum(0.004 * np.arange(1000), 1.0))
    s = clean(having('tool_friction', force=coulomb, presliding=presliding),
              target).optidrive.values[:, 0]
    assert s[-1] == pytest.approx(
        WEIGHT * np.sin(0.02) / (STIFFNESS + coulomb / presliding), rel=1e-2)
    assert np.ptp(s[-400:]) < 1e-9


@pytest.mark.parametrize('rig', [RIG, RIGID], ids=['compliant', 'rigid'])
def test_cable_pulls_at_its_point_with_a_force_fixed_in_base(rig):
    pull, point = np.array([2.0, -3.0, 4.0]), np.array([0.1, 0.02, -0.05])
    values = {**dict(zip('xyz', pull)),
              **{f'point_{axis}': x for axis, x in zip('xyz', point)}}
    R = tilted(0.2)
    recording = clean(having('cable_force', rig, **values), resting(R))
    s = recording.optidrive.values[0, 0] if rig is RIG else 0.0
    weight, force, slide = RIG.tool.mass * R.T @ GRAVITY, R.T @ pull, np.array([s, 0.0, 0.0])
    torque = np.cross(RIG.tool.com + slide, weight) + np.cross(point + slide, force)
    wrench = recording.wrench.values - BIAS
    assert wrench[:, :3] == pytest.approx(np.tile(weight + force, (20, 1)), abs=1e-5)
    assert wrench[:, 3:] == pytest.approx(np.tile(torque, (20, 1)), abs=1e-5)
    if rig is RIG:
        assert STIFFNESS * s == pytest.approx((weight + force)[0], abs=1e-5)
    assert not recording.contact_truth.values.any()


def test_cable_as_a_spring_pulls_back_to_where_its_point_is_at_home():
    rig = having('cable_force', RIGID, stiffness=100.0)
    away = HOME + [-0.05, 0.02, 0.03]
    home, moved = (clean(rig, resting(position=p)).wrench.values[0] for p in (HOME, away))
    assert home == pytest.approx(clean(RIGID, resting()).wrench.values[0], abs=1e-6)
    assert (moved - home)[:3] == pytest.approx(-100.0 * AIM.T @ (away - HOME), abs=1e-6)
    compliant = with_effects(RIG, {'cable_force': {'stiffness': 100.0}})
    s = sag(compliant, 0.0)
    assert s == pytest.approx(0.0, abs=1e-9)
    s = clean(compliant, resting(position=away)).optidrive.values[0, 0]
    assert s == pytest.approx(5.0 / (STIFFNESS + 100.0), abs=1e-9)


def test_spindle_shakes_the_wire_with_its_force_frequency_and_phase():
    rig = having('spindle_vibration', RIGID, sine_x=3.0, cosine_y=-2.0, frequency=37.0)
    target = resting(n=250)
    shaken, still = (clean(r, target).wrench for r in (rig, RIGID))
    angle = 2.0 * np.pi * 37.0 * shaken.t
    force = np.stack([3.0 * np.sin(angle), -2.0 * np.cos(angle), 0.0 * angle], axis=1)
    off = shaken.values - still.values
    assert off[:, :3] == pytest.approx(force, abs=1e-9)
    assert off[:, 3:] == pytest.approx(np.cross([0.20, 0.0, 0.10], force), abs=1e-9)


@pytest.mark.parametrize('frequency', [1.0, 3.1, 20.0])
def test_spindle_shakes_the_slide_as_a_damped_mass_on_a_spring(frequency):
    rig = having('spindle_vibration', sine_x=3.0, frequency=frequency)
    s = clean(rig, resting(n=1500)).optidrive
    late = s.t > s.t[-1] - 3.0 / frequency if frequency > 1.0 else s.t > 4.0
    w = 2.0 * np.pi * frequency
    basis = np.stack([np.sin(w * s.t[late]), np.cos(w * s.t[late])], axis=1)
    sine, cosine = np.linalg.lstsq(basis, s.values[late, 0], rcond=None)[0]
    response = 3.0 / (STIFFNESS - RIG.tool.mass * w * w + 1j * DAMPING * w)
    assert sine + 1j * cosine == pytest.approx(response, rel=1e-3)


@pytest.mark.parametrize('delay', [0.0049, 0.002, 0.0173])
@pytest.mark.long
def test_delayed_robot_does_the_same_later(delay):
    target = pressing(150)
    (late, dt), (plain, _) = (plant_motion(rig, target) for rig in (
        having('robot_delay', delay=delay), RIG))
    t = dt * np.arange(len(plain.position))
    for one, other, size in ((late.position, plain.position, 1e-7),
                             (late.acceleration, plain.acceleration, 1e-2),
                             (late.omega, plain.omega, 5e-6)):
        for axis in range(3):
            expected = np.interp(t - delay, t, other[:, axis])
            assert one[:, axis] == pytest.approx(expected, abs=size)
    turned = np.swapaxes(late.R_base_sensor, 1, 2) @ late.R_base_sensor
    assert turned == pytest.approx(np.tile(np.eye(3), (len(t), 1, 1)), abs=1e-9)


@pytest.mark.parametrize('frequency, damping', [(8.0, 0.05), (20.0, 0.02)])
def test_ringing_robot_has_a_mode_of_its_frequency_and_damping(frequency, damping):
    t = 0.004 * np.arange(600)
    s = np.clip((t - 0.1) / 0.05, 0.0, 1.0)
    step = 0.01 * s ** 3 * (10.0 - 15.0 * s + 6.0 * s ** 2)
    target = along(HOME + np.outer(step, [0.0, 0.0, 1.0]))
    rig = having('robot_resonance', gain=1.0, frequency=frequency, damping=damping)
    (ringing, dt), (plain, _) = plant_motion(rig, target), plant_motion(RIG, target)
    time, d = dt * np.arange(len(plain.position)), (ringing.position - plain.position)[:, 2]
    w = 2.0 * np.pi * frequency
    free, damped = time > 0.5, w * np.sqrt(1.0 - damping ** 2)
    basis = np.stack([np.exp(-damping * w * time) * f(damped * time) for f in (np.sin, np.cos)])
    fitted = np.linalg.lstsq(basis[:, free].T, d[free], rcond=None)[0] @ basis
    assert np.abs(d[free]).max() > 1e-4
    assert d[free] == pytest.approx(fitted[free], abs=2e-6)


def test_ringing_robot_moves_as_its_velocity_and_acceleration_say():
    motion, dt = plant_motion(having('robot_resonance', gain=0.7, frequency=15.0), pressing(200))
    for value, rate in ((motion.position, motion.velocity),
                        (motion.velocity, motion.acceleration)):
        integral = np.cumsum(0.5 * dt * (rate[1:] + rate[:-1]), axis=0)
        assert value[1:] - value[0] == pytest.approx(integral, abs=1e-4 * np.abs(value).max())


def test_a_mode_damped_within_the_arm_does_not_lag_behind_a_steady_motion():
    t = 0.004 * np.arange(750)
    target = along(HOME + np.outer(0.05 * np.maximum(t - 0.2, 0.0), [0.0, 0.0, 1.0]))
    behind = {}
    for grounded in (0.0, 1.0):
        rig = having('robot_resonance', gain=1.0, frequency=10.0, damping=0.2, grounded=grounded)
        (ringing, _), (plain, _) = plant_motion(rig, target), plant_motion(RIG, target)
        behind[grounded] = (ringing.position - plain.position)[-1, 2]
    lag = 0.05 * 2.0 * 0.2 / (2.0 * np.pi * 10.0)
    assert behind[1.0] == pytest.approx(-lag, rel=1e-3)
    assert abs(behind[0.0]) < 1e-3 * lag


def test_motion_is_the_same_for_every_tool_and_wall():
    heavier = with_effects(RIG, {'tool_mass': {'change': 0.1}, 'tool_friction': {'force': 2.0}})
    assert same_motion(heavier) == same_motion(RIG)
    assert same_motion(having('robot_delay', delay=0.01)) != same_motion(RIG)
    assert np.array_equal(clean(heavier, pressing(50)).pose.position,
                          clean(RIG, pressing(50)).pose.position)


def test_contact_effects_change_the_wall_and_nothing_before_it():
    for name, values in (('contact_stiffness', {'change': 0.5}),
                         ('contact_damping', {'change': 2.0}), ('wall_position', {'shift': 1e-3})):
        target = pressing(200)
        other, plain = (clean(rig, target) for rig in (having(name, **values), RIG))
        touching = (np.abs(plain.contact_truth.values).max(axis=1) > 0.0) | (
            np.abs(other.contact_truth.values).max(axis=1) > 0.0)
        first = np.argmax(touching)
        off = np.abs(other.wrench.values - plain.wrench.values).max(axis=1)
        assert 50 < first < 700
        assert off[:first].max() < 1e-9 and off[first:].max() > 0.5
