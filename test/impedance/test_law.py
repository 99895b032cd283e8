"""Design and step of the impedance law: what it promises, what it refuses, what it survives."""

from dataclasses import replace
from math import inf, nan

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.impedance.law import (
    design,
    DesignSettings,
    loop,
    Measurement,
    Reference,
    Regulator,
    relation,
    TargetImpedance,
)
from forcecal_ros.impedance.plant import load_plant, Plant, process, Robot, Slide, Wall
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import Simulator
import numpy as np
import pytest
from scipy.integrate import solve_ivp

PLANT = load_plant()
WANTED = TargetImpedance(mass=13.0, damping=250.0, stiffness=1000.0)
SETTINGS = DesignSettings()


@pytest.fixture(scope='module')
def designed():
    return design(PLANT, WANTED, SETTINGS)


def exact(value, unit='1'):
    return Estimate(value, 0.0, unit)


def follow(law, plant, seconds, *, reference=0.0, push=0.0, sent=lambda command: command):
    """Close the loop around the model itself; return the tool's positions and the commands."""
    X, regulator, tool, commands = np.zeros(len(law.B)), Regulator(law), [], []
    for _ in range(round(seconds / law.period)):
        force = push + plant.wall @ X
        s = (plant.tool - plant.robot) @ X
        commands.append(sent(regulator(
            Reference(reference), Measurement(plant.robot @ X, s, force))))
        regulator.sent(commands[-1])
        tool.append(plant.tool @ X)
        X = plant.A @ X + plant.B * commands[-1] + plant.F * push
    return np.array(tool), np.array(commands)


def test_process_slides_as_eq_29_says():
    # a robot that does at once what it is told: S goes to 1 mm in one period
    robot = Robot(0.004, 1, exact([0.0]), exact([1.0]))
    free = process(Plant(robot, PLANT.slide), wall=Wall(3000.0, 40.0))
    X = free.A @ (free.B * 1e-3)
    m, k, d = (float(one) for one in vars(PLANT.slide).values())

    def moved(start, begin, end):
        def rate(t, y):
            x_rb, v_rb = begin + (end - begin) * t / 0.004, (end - begin) / 0.004
            pull = k * (x_rb - y[0]) + d * (v_rb - y[1]) - 3000.0 * y[0] - 40.0 * y[1]
            return [y[1], pull / m]
        return solve_ivp(rate, (0.0, 0.004), start, rtol=1e-10, atol=1e-15).y[:, -1]

    # in the second period the command has gone back to 0, and so does S
    x, v = moved(moved((0.0, 0.0), 0.0, 1e-3), 1e-3, 0.0)
    assert free.tool @ X == pytest.approx(x, rel=1e-6)
    assert free.velocity @ X == pytest.approx(v, rel=1e-6)
    assert free.wall @ X == pytest.approx(-3000.0 * x - 40.0 * v, rel=1e-6)


def test_impedance_relation_vanishes_for_a_tool_that_moves_as_wanted():
    # at rest under 10 N the wanted tool is 10 mm off its reference
    free = process(PLANT)
    e = relation(free, WANTED, PLANT.robot.period)
    n = len(e.C)
    s = 10.0 / float(PLANT.slide.stiffness)
    command = (0.01 - s) / PLANT.robot.static_gain
    X = np.linalg.solve(np.eye(n) - free.A, free.B * command + free.F * 10.0)
    assert free.tool @ X == pytest.approx(0.01, rel=1e-6)
    assert e.C @ X + e.D * command + e.F * 10.0 == pytest.approx(0.0, abs=1e-6)


def test_steady_force_gives_way_by_the_wanted_stiffness(designed):
    tool, _ = follow(designed.law, process(PLANT), 4.0, push=5.0)
    assert tool[-1] == pytest.approx(5.0 / WANTED.stiffness, rel=1e-4)


def test_steady_reference_is_reached(designed):
    tool, _ = follow(designed.law, process(PLANT), 4.0, reference=0.02)
    assert tool[-1] == pytest.approx(0.02, rel=1e-4)


def test_the_way_there_is_that_of_the_wanted_mass_damper_and_spring(designed):
    tool, _ = follow(designed.law, process(PLANT), 1.5, push=5.0)
    t = np.arange(len(tool)) * designed.law.period
    wanted = solve_ivp(lambda _, y: (y[1], (5.0 - WANTED.damping * y[1]
                                            - WANTED.stiffness * y[0]) / WANTED.mass),
                       (0.0, t[-1]), (0.0, 0.0), t_eval=t, rtol=1e-8).y[0]
    assert np.abs(tool - wanted).max() < 0.03 * wanted[-1]


def test_the_compliance_is_within_two_percent_of_the_wanted_one_up_to_1_hz(designed):
    law, free = designed.law, process(PLANT)
    open_loop, n = loop(law, free, SETTINGS.force_lag), len(designed.law.B)
    A = open_loop.A + np.outer(open_loop.B, open_loop.C)
    passed = 1.0 - np.exp(-law.period / SETTINGS.force_lag)
    B = np.concatenate([free.F, [passed], np.zeros(n)])
    for omega in 2.0 * np.pi * np.linspace(0.02, 1.0, 50):
        states = np.linalg.solve(np.exp(1j * omega * law.period) * np.eye(len(B)) - A, B)
        wanted = WANTED.stiffness + 1j * omega * WANTED.damping - WANTED.mass * omega ** 2
        assert abs(states[:n] @ free.tool * wanted - 1.0) < 0.02


@pytest.mark.parametrize('latency', [0, 3])
def test_loop_predicted_unstable_diverges_and_stable_one_does_not(latency):
    settings = replace(SETTINGS, latency=latency, wall_stiffness=(100.0, 1000.0),
                       effort=3000.0)
    made = design(PLANT, WANTED, settings)
    assert 1000.0 < made.unstable_from < inf
    for stiffness, grows in ((0.5 * made.unstable_from, False), (2.0 * made.unstable_from, True)):
        closed = loop(made.law, process(PLANT, latency, Wall(stiffness)), settings.force_lag)
        x = np.random.default_rng(1).standard_normal(len(closed.B))
        A = closed.A + np.outer(closed.B, closed.C)
        assert (np.linalg.norm(np.linalg.matrix_power(A, 2500) @ x)
                > 1e3 * np.linalg.norm(x)) == grows


def test_a_design_unstable_against_the_stated_walls_is_refused_with_the_number():
    with pytest.raises(ConfigError, match=r'unstable against a wall of \d+ N/m, within the '
                                          r'stated range of 100 to 50000 N/m'):
        design(PLANT, WANTED, replace(SETTINGS, effort=1e4, wall_stiffness=(100.0, 5e4)))


@pytest.mark.parametrize(('gains', 'named'), [
    ({'force_gain': 0.05}, 'design.force_gain'),
    ({'state_gain': (1e6,) * 7}, 'design.state_gain'),
])
def test_gains_that_make_it_unstable_are_refused_by_name(gains, named):
    with pytest.raises(ConfigError, match=rf'unstable .*leave out {named}') as caught:
        design(PLANT, WANTED, replace(SETTINGS, **gains))
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('wrong', [
    {'effort': -1.0}, {'latency': -1}, {'wall_stiffness': (2e4, 1e2)}, {'force_lag': nan},
    {'force_gain': inf}])
def test_settings_without_sense_are_refused_by_name(wrong):
    with pytest.raises(ConfigError, match='design'):
        replace(SETTINGS, **wrong)


def test_an_impedance_without_damping_is_refused():
    with pytest.raises(ConfigError, match='impedance.damping is 0.0'):
        TargetImpedance(damping=0.0)


def test_a_state_gain_of_the_wrong_length_is_refused():
    with pytest.raises(ConfigError, match='has 2 numbers; this plant has 7 states'):
        design(PLANT, WANTED, replace(SETTINGS, state_gain=(1.0, 2.0)))


def test_estimator_finds_what_no_sensor_gives(designed):
    law, free, rng = designed.law, process(PLANT), np.random.default_rng(3)
    X, regulator = np.zeros(len(law.B)), Regulator(law)
    X[-1] = 0.1  # the tool moves already, which the law does not know
    errors = []
    for k in range(500):
        heard = Measurement(free.robot @ X + rng.normal(0.0, 2e-5),
                            (free.tool - free.robot) @ X + rng.normal(0.0, 2e-5), 0.0)
        command = regulator(Reference(0.01 * np.sin(0.02 * k)), heard)
        errors.append(free.velocity @ (regulator.estimate - X))
        X = free.A @ X + free.B * command
    assert abs(errors[0]) > 0.05
    assert np.std(errors[250:]) < 0.003


def test_the_gain_is_that_in_which_a_kalman_filter_ends(designed):
    law, free = designed.law, process(PLANT)
    G = np.column_stack([0.3 * free.F, 1e-5 * free.B]) / 2e-5  # errors over that of a position
    P = np.eye(len(law.B))
    for _ in range(3000):
        P = free.A @ P @ free.A.T + G @ G.T
        K = P @ law.C.T @ np.linalg.inv(law.C @ P @ law.C.T + np.eye(2))
        P = P - K @ law.C @ P
    np.testing.assert_allclose(law.K, K, atol=1e-6 * np.abs(K).max())


def test_a_command_that_limits_held_back_does_not_mislead_the_estimator(designed):
    tool, commands = follow(designed.law, process(PLANT), 6.0, reference=0.02,
                            sent=lambda command: min(max(command, -0.005), 0.015))
    assert commands.max() == 0.015
    assert tool[-1] == pytest.approx(0.015 * PLANT.robot.static_gain, rel=1e-3)


@pytest.mark.parametrize('bad', [nan, inf, -inf])
@pytest.mark.parametrize('field', Measurement._fields)
def test_a_sample_that_is_not_finite_is_coasted_over(designed, bad, field):
    regulator, good = Regulator(designed.law), Measurement(0.001, 0.0, -2.0)
    regulator(Reference(0.0), good)
    assert np.isfinite(regulator(Reference(0.0), good._replace(**{field: bad})))
    assert np.isfinite(regulator.estimate).all()


def test_a_reference_that_is_not_finite_leaves_the_last_one(designed):
    regulator, quiet = Regulator(designed.law), Measurement(0.0, 0.0, 0.0)
    regulator(Reference(0.01), quiet)
    regulator(Reference(nan), quiet)
    assert regulator.goal == 0.01


@pytest.mark.long
def test_simulated_rig_presses_on_its_wall_as_the_wanted_spring_does():
    rig, law = load_rig(), design(PLANT, WANTED, SETTINGS).law
    simulator, regulator = Simulator(rig, 'acc1', 4), Regulator(law)
    home, R, reference, forces = np.array(rig.home.position), rig.home.R_base_sensor, 0.1, []
    for k in range(1000):
        simulator.command(home + regulator.command * R[:, 0], R)
        samples = simulator.advance()
        forces += samples.contact[:, 0].tolist()
        goal = reference * min(1.0, k / 400.0)
        regulator(Reference(goal), Measurement(
            (samples.position[-1] - home) @ R[:, 0], samples.optidrive[-1],
            samples.contact[-1, 0]))
    # the wall stands at 80 mm, 20 mm before the reference, in series with its own stiffness
    expected = -0.02 / (1.0 / WANTED.stiffness + 1.0 / rig.wall.stiffness)
    pressed = np.array(forces[-1000:])
    assert pressed.mean() == pytest.approx(expected, rel=0.02)
    assert np.ptp(pressed) < 0.1 * abs(expected)


def test_slide_of_a_rigid_tool_is_refused():
    with pytest.raises(ConfigError, match='slide.stiffness.value is inf, expected a finite'):
        Slide(exact(13.0, 'kg'), exact(inf, 'N/m'), exact(130.0, 'N s/m'))
