"""Somebody's simulator, run with recorded commands: the page's example, and what may be wrong."""

from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
import json
from pathlib import Path
import re
from runpy import run_path

from changed import with_values
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import matrix_from_quaternion, rotation_from_vector
from forcecal_ros.core.streams import JointStream, PoseStream, Recording, Stream
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.jacobian import nuisance_column
from forcecal_ros.diagnose.recordings import (
    keep_common_joints,
    missing_joint_notes,
    select_joints,
)
from forcecal_ros.diagnose.sources.simulator import SimulatorSource
from forcecal_ros.effects import EFFECTS
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.sim.protocol import Inputs, Parameter
from forcecal_ros.sim.rerun import (
    is_addable,
    library_of,
    MAX_POINTS,
    MAX_RUNS,
    refuse_too_many,
    Rerun,
    Runs,
    runs_short,
    simulated_robot,
)
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
from forcecal_ros.sim.third_party import load_simulator, third_party
from longer import first
import numpy as np
from own_arm import commands, SECONDS, TOLERANCES
import pytest
from rig_recordings import switched
from small_arm import mjcf, NAMES, told

PAGE = Path(__file__).resolve().parents[2] / 'docs/how-to/own-simulator.md'
INPUTS = Inputs(0.0, SECONDS, commands())


@pytest.fixture(scope='module')
def example(tmp_path_factory):
    """Return the module that the page shows, and its folder."""
    folder = tmp_path_factory.mktemp('example')
    source = re.search(r'```python\n(.+?)```', PAGE.read_text(), re.DOTALL).group(1)
    (folder / 'my_robot.py').write_text(source)
    spec = spec_from_file_location('example_of_the_page', folder / 'my_robot.py')
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, folder


@pytest.fixture
def robot(example):
    return third_party('my_robot', example[0].make())


def measured(simulator, payload, lag):
    """Return what a robot with other numbers has, its wrench and poses noisy and not zeroed."""
    made, rng = simulator.run(INPUTS, (payload, lag)), np.random.default_rng(5)
    wrench, pose = made.wrench, made.pose
    noisy = wrench.values + rng.normal(size=wrench.values.shape) * np.repeat([0.15, 0.006], 3)
    turned = rotation_from_vector(2e-4 * rng.normal(size=(len(pose), 3)))
    return replace(
        made, target=commands(),
        wrench=replace(wrench, values=noisy + [3.0, -1.0, 2.0, 0.1, 0.0, -0.2]),
        pose=replace(pose, position=pose.position + 1e-4 * rng.normal(size=pose.position.shape),
                     R_base_sensor=pose.R_base_sensor @ turned), start_ns=10**18)


def test_the_commands_of_the_page_say_what_to_change(example, monkeypatch, capsys):
    monkeypatch.chdir(example[1])
    diagnose = re.search('^    forcecal (diagnose .+make -o .+)$', PAGE.read_text(),
                         re.MULTILINE).group(1).split()
    check = [*diagnose, '--check']
    run_path(PAGE.parents[2] / 'examples' / 'record_my_robot.py')
    assert main(check) == 0
    said = capsys.readouterr().out
    assert re.search(r'payload +0\.1\d+ N', said)
    assert 'the search adds seconds to minutes' in said
    assert main(diagnose) == 0
    document = json.loads((example[1] / 'why' / 'diagnosis.json').read_text())
    assert document['explained_by'] == 'my_robot:make'
    assert document['effects'][0]['name'] == 'payload'
    changed, = (one for one in document['parameters'] if one['name'] == 'payload')
    assert changed['before'] == 1.2
    assert changed['after'] == pytest.approx(1.26, abs=4 * changed['std'])
    assert changed['std'] < 0.005
    assert document['recomputed'] > 0.5
    said = capsys.readouterr()
    assert re.search(r'^payload 1\.2 -> 1\.2[67]\d* ± 0\.00\d+ kg', said.out, re.MULTILINE)
    assert re.search(r'^next: Set payload to 1\.2[67]\d* kg in parameters\(\)', said.out,
                     re.MULTILINE)
    assert 'note: searching for effects\n' in said.err


@pytest.mark.long
def test_a_payload_that_is_picked_up_on_the_way_is_found_with_its_instant(robot):
    light, heavy = measured(robot, 1.2, 0.07), measured(robot, 1.35, 0.07)
    effect, = SimulatorSource(robot, TOLERANCES).diagnose(
        switched(light, heavy, 8.0)).diagnosis.effects
    found = effect.parameters['value']
    assert effect.name == 'payload' and effect.begin == pytest.approx(8.0, abs=4e-3)
    assert found.value == pytest.approx(1.35, abs=4 * found.std) and found.std < 0.005


@pytest.mark.parametrize('factor, said', first([
    (-1.0, 'it has the opposite sign'), (1.0 / 9.80665, 'its forces are in kgf')]))
def test_units_and_sign_of_the_robots_wrench_are_asked_before_effects(robot, factor, said):
    wrong = with_values(measured(robot, 1.2, 0.07), lambda values: factor * values)
    found = SimulatorSource(robot, TOLERANCES).diagnose(wrong).diagnosis
    assert found.verdict == 'invalid_data'
    assert said in found.reason


def test_what_checks_of_the_data_may_find_is_known_beside_any_simulator():
    library = library_of((Parameter('payload', 1.2, 0.02, stands_for=('tool_mass',)),))
    assert set(EFFECTS) - set(library) == {'tool_mass'}
    added = {name for name, effect in library.items() if is_addable(effect, accelerated=False)}
    assert {'payload', 'robot_delay', 'tool_com', 'wrench_gain'} <= added
    assert added.isdisjoint({'accel_saturation', 'clock_skew', 'tool_friction'})
    assert is_addable(library['accel_saturation'], accelerated=True)


def test_between_runs_its_streams_are_those_of_a_line(robot):
    runs = Runs(robot, INPUTS, commands())
    runs.try_all(robot.nominal)
    assert runs.count == 3
    linear, exact = runs.at((1.26, 0.072)), robot.run(INPUTS, (1.26, 0.072))
    np.testing.assert_allclose(linear.wrench.values, exact.wrench.values, atol=1e-9)
    later, own = runs.at((1.2, 0.073)), robot.run(INPUTS, (1.2, 0.073))
    moved = np.abs(own.pose.position - runs.exact(robot.nominal).pose.position).max()
    assert np.abs(later.pose.position - own.pose.position).max() < 0.05 * moved
    runs.refuse_unsteady()


class Product:
    """Its force is the product of two numbers, and a third is added."""

    def parameters(self):
        return [Parameter(name, 1.0, 0.1) for name in 'abc']

    def simulate(self, inputs, parameters):
        a, b, c = parameters.values()
        return {'wrench': (T, np.full((len(T), 6), a * b + c)), 'pose': POSE}


class Square(Product):
    """Its force is the square of a number."""

    def simulate(self, inputs, parameters):
        return {'wrench': (T, np.full((len(T), 6), parameters['a'] ** 2)), 'pose': POSE}


class Humming(Product):
    """Its force varies faster than poses are clear of a real robot's noise."""

    def simulate(self, inputs, parameters):
        hum = parameters['a'] * (np.sin(20.0 * np.pi * T) + np.sin(44.0 * np.pi * T))
        return {'wrench': (T, np.repeat(hum[:, np.newaxis], 6, axis=1)), 'pose': POSE}


def test_a_parameter_changes_what_a_simulation_is_meant_for_and_leaves_what_is_faster():
    simulator, tool = third_party('humming', Humming()), rigid_tool_of_rig(TOLERANCES)
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    runs.try_all((1.0,) * 3)
    rerun, robot = Rerun(runs, 1.0, 500, tool), simulated_robot(tool, simulator.parameters)
    first, other = (rerun.signals(replace(robot, numbers=(a, 1.0, 1.0))).wrench[:, 2]
                    for a in (1.0, 1.5))
    t = 1.001 + 0.001 * np.arange(2000)
    slower, faster = (np.sin(2.0 * np.pi * rate * t) / 1000.0 for rate in (10.0, 22.0))
    assert first @ slower == pytest.approx(1.0, abs=0.01) and first @ faster > 0.6
    assert (other - first) @ slower == pytest.approx(0.5, abs=0.02)
    assert abs((other - first) @ faster) < 0.05


def test_lines_are_secants_at_first_and_tangents_where_a_fit_led():
    simulator = third_party('square', Square())
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    for tried, a, force in ((runs.try_all, 1.0, 1.21), (runs.try_about, 2.0, 4.0 + 0.1 * 4.01)):
        tried((a, 1.0, 1.0))
        assert runs.at((a + 0.1, 1.0, 1.0)).wrench.values[0, 0] == pytest.approx(force)


def test_where_a_fit_settles_it_is_run_and_what_went_far_is_tried_anew():
    simulator = third_party('product', Product())
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    runs.try_all((1.0,) * 3)
    there, beyond = (2.0, 1.5, 1.05), (2.1, 1.6, 1.1)

    def force(numbers):
        return runs.at(numbers).wrench.values[0, 0]

    assert force(there) == pytest.approx(3.55)  # a straight line; the product is 4.05
    before = runs.count
    assert runs.settle(there) and not runs.settle(there)
    assert runs.count == before + 3  # there, and with another a and b; c is near
    assert force(there) == pytest.approx(4.05)
    assert force(beyond) == pytest.approx(4.05 + 0.15 + 0.2 + 0.05)
    runs.count = MAX_RUNS
    assert not runs.settle(beyond)


def test_of_where_fits_settled_the_last_are_kept():
    simulator = third_party('product', Product())
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    runs.try_all((1.0,) * 3)
    for i in range(MAX_POINTS + 2):
        assert runs.settle((1.0, 1.0, 1.02 + 0.02 * i))
    assert len(runs.points) == MAX_POINTS + 1
    assert runs.near((1.0,) * 3) == (1.0,) * 3 and runs.near((1.0, 1.0, 1.04))[2] > 1.05


def test_as_near_as_a_tenth_of_a_sigma_it_is_not_run_again():
    simulator = third_party('product', Product())
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    runs.try_all((1.0,) * 3)
    assert not runs.settle((1.009, 1.0, 0.991)) and runs.settle((1.009, 1.0, 0.989))


class Giving:
    """The robot of the page, with a number that its wrench goes with one over the square of."""

    def __init__(self, robot):
        self.robot = robot

    def parameters(self):
        _, lag = self.robot.parameters()
        return [Parameter('give', 1.0, 0.03, '1', 0.1, 5.0, 'tool', ('tool_mass',)), lag]

    def simulate(self, inputs, parameters):
        payload = 1.2 / parameters['give'] ** 2
        return self.robot.simulate(inputs, {'payload': payload, 'lag': parameters['lag']})


class Scaled(Giving):
    """The robot of the page, whose payload is a product of two numbers."""

    def parameters(self):
        return [Parameter('payload', 1.2, 0.05), Parameter('scale', 1.0, 0.05)]

    def simulate(self, inputs, parameters):
        return self.robot.simulate(inputs, {
            'payload': parameters['payload'] * parameters['scale'], 'lag': 0.07})


def test_a_column_does_not_change_where_another_point_was_run_beside_it(example):
    scaled = third_party('scaled', Scaled(example[0].make()))
    source = SimulatorSource(scaled, TOLERANCES)
    ready, = source.prepare([measured(scaled, 1.2, 1.0)])
    ready.try_all(scaled.nominal)
    dataset, rig = ready.dataset, ready.dataset.rig
    payload = next(one for one in ready.simulation.nuisances(rig, ('wrench',))
                   if one.name == 'payload')

    def force():
        signals = ready.simulation.signals(rig)
        made = nuisance_column(dataset, payload, 0.05, rig, signals,
                               dataset.measured.residual(signals), np.ones(len(CHANNELS)))
        return np.stack([made[c].values() for c in range(3)])

    before = force()
    assert ready.runs.settle((1.245, 1.045))  # nearer than the nominal numbers to (1.25, 1.0)
    ready.simulation.forget()
    np.testing.assert_allclose(force(), before, atol=1e-4 * np.abs(before).max())


@pytest.mark.long
def test_a_number_that_is_no_straight_line_is_fitted_where_it_was_found(example):
    giving = third_party('giving', Giving(example[0].make()))
    found = SimulatorSource(giving, TOLERANCES).diagnose(measured(giving, 0.8, 0.072))
    changed, = found.details['parameters']
    assert changed['name'] == 'give'
    assert changed['std'] < 0.002
    assert changed['after'] == pytest.approx(0.8, abs=3.0 * changed['std'])


class Own:
    """A simulator whose answers a test chooses."""

    def __init__(self, answer=None, listed=None):
        self.answer = answer
        self.listed = [Parameter('mass', 1.0, 0.1)] if listed is None else listed

    def parameters(self):
        return self.listed

    def simulate(self, inputs, parameters):
        return self.answer(inputs) if callable(self.answer) else self.answer


T = np.arange(0.0, SECONDS, 0.01)
WRENCH = (T, np.zeros((len(T), 6)))
POSE = (T, np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(T), 1)))


def spoilt(value):
    rows = np.array(WRENCH[1])
    rows[7, 2] = value
    return T, rows


@pytest.mark.parametrize('answer, why', [
    (None, 'returned NoneType, expected a mapping'),
    ({'wrench': WRENCH}, 'returned no pose, but wrench; return wrench and pose'),
    ({'wrench': WRENCH, 'pose': WRENCH}, r'pose: stamps \(1200,\) and rows \(1200, 6\)'),
    ({'wrench': spoilt(np.nan), 'pose': POSE}, r'wrench: row 7 is not finite \(1 of 1200\)'),
    ({'wrench': WRENCH, 'pose': (T, 2.0 * POSE[1])}, 'has norm 2.0000; expected x, y, z, w'),
    ({'wrench': (T[::-1], WRENCH[1]), 'pose': POSE}, 'wrench: stamps do not increase at'),
    ({'wrench': (T + 900.0, WRENCH[1]), 'pose': POSE}, 'wrench goes from 900.00 to'),
    ({'wrench': 'x', 'pose': POSE}, r'wrench: expected \(stamps, rows\) of numbers'),
    (lambda inputs: inputs.nothing, r'simulate raised AttributeError: .+\(.+_simulator.py:\d+')])
def test_answers_that_are_none_are_refused_in_one_line(answer, why):
    with pytest.raises((ConfigError, DataError), match=why):
        third_party('own', Own(answer)).run(INPUTS, (1.0,))


@pytest.mark.parametrize('listed, why', [
    ([('mass', 1.0)], 'expected forcecal_ros.sim.protocol.Parameter'),
    ([Parameter('mass', 1.0, 0.0)], 'sigma 0.0, expected a standard deviation'),
    ([Parameter('mass', 1.0, 0.1, 'kg', 2.0)], 'nominal 1.0 is not within 2.0 to inf'),
    ([Parameter('mass', 1.0, 0.1, stage='arm')], "stage 'arm', expected one of robot"),
    ([Parameter('mass', 1.0, 0.1)] * 2, 'parameter mass is listed twice')])
def test_parameters_that_cannot_be_are_refused(listed, why):
    with pytest.raises(ConfigError, match=why):
        third_party('own', Own(listed=listed))


@pytest.mark.parametrize('spec, why', [
    ('my_robot', 'expected MODULE:FACTORY'),
    ('no_such_module_here:make', 'no module no_such_module_here in this folder'),
    ('json:make', 'json has no function make'),
    ('json:dumps', r'dumps\(\) raised TypeError: .+missing 1 required'),
    ('time:time', 'float has no method parameters')])
def test_what_cannot_be_loaded_is_said(spec, why):
    with pytest.raises(ConfigError, match=why):
        load_simulator(spec)


def test_another_answer_the_second_time_is_noticed():
    rng = np.random.default_rng(0)
    noisy = third_party('own', Own(lambda inputs: {
        'wrench': (T, rng.normal(size=(len(T), 6))), 'pose': POSE}))
    still = third_party('own', Own({'wrench': WRENCH, 'pose': POSE})).run(INPUTS, (1.0,)).pose
    runs = Runs(noisy, INPUTS, still)
    runs.exact(noisy.nominal)
    with pytest.raises(ConfigError, match='two runs with the same commands'):
        runs.refuse_unsteady()


def of_parameters(n):
    return third_party('own', Own(listed=[Parameter(f'p{i}', 1.0, 0.1) for i in range(n)]))


@pytest.mark.parametrize('n, recordings, why', [
    (97, 2, '97 parameters on 2 recordings .+ only the 96 .+, or diagnose without --heldout$'),
    (197, 1, 'on 1 recording require .+ only the 196 that are least certain$')])
def test_a_simulator_that_would_be_run_too_often_is_refused(n, recordings, why):
    with pytest.raises(ConfigError, match=why):
        refuse_too_many(of_parameters(n), recordings)
    refuse_too_many(of_parameters(n - 1), recordings)


def test_lines_are_those_tried_nearest_to_where_it_was_run():
    simulator = third_party('product', Product())
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    runs.try_all((1.0,) * 3)
    runs.settle((1.9, 1.0, 1.0))  # b is near where it was tried, so that its line is the old one
    assert runs.at((1.9, 1.05, 1.0)).wrench.values[0, 0] == pytest.approx(2.9 + 0.05)
    assert runs.try_about((2.0, 1.0, 1.0))
    # all are tried nearby, and the point of before learns of it
    assert runs.at((1.9, 1.05, 1.0)).wrench.values[0, 0] == pytest.approx(2.9 + 0.1)


def test_all_are_tried_where_one_is_far_while_runs_are_left():
    simulator = third_party('product', Product())
    runs = Runs(simulator, INPUTS, simulator.run(INPUTS, (1.0,) * 3).pose)
    runs.try_all((1.0,) * 3)
    assert not runs.try_about((1.05, 1.0, 1.0))
    assert runs.try_about((2.0, 1.0, 1.0)) and runs.count == 8
    assert not runs.try_about((2.05, 1.0, 1.0)) and not runs_short([runs])
    runs.count = MAX_RUNS - 5
    assert not runs.try_about((3.0, 1.0, 1.0))
    assert 'was run 195 times, so often that its 3 parameters' in runs_short([runs])


def test_joints_are_read_in_the_order_of_their_commands(tmp_path):
    q = np.sin(np.outer(T, [1.0, 2.0, 3.0]))
    write_recording(tmp_path / 'bag', Recording(
        wrench=Stream(*WRENCH), start_ns=10**18,
        joint_commands=JointStream(T, q[:, :2], '', ('shoulder', 'elbow')),
        joints=JointStream(T, q[:, [2, 1, 0]], '', ('finger', 'elbow', 'shoulder'))))
    read = read_recording(tmp_path / 'bag', joints=True).joints
    assert read.names == ('shoulder', 'elbow')
    np.testing.assert_array_equal(read.values, q[:, :2])
    without = read_recording(tmp_path / 'bag')
    assert without.joints is None and without.joint_commands.names == ('shoulder', 'elbow')
    np.testing.assert_array_equal(without.joint_commands.values, q[:, :2])


def test_joints_that_a_simulator_has_are_compared_and_no_others():
    inputs = replace(INPUTS, measured_joints=('shoulder', 'elbow', 'finger'))
    rows = np.tile([0.1, 0.2, np.nan], (len(T), 1))
    made = third_party('own', Own({'wrench': WRENCH, 'pose': POSE, 'joints': (T, rows)})).run(
        inputs, (1.0,)).joints
    assert made.names == ('shoulder', 'elbow')
    measured = JointStream(T, np.tile([3.0, 1.0, 2.0], (len(T), 1)), '',
                           ('finger', 'shoulder', 'elbow'))
    seen = select_joints(measured, made.names)
    np.testing.assert_array_equal(seen.values[0], [1.0, 2.0])
    one = Recording(joints=measured)
    assert keep_common_joints([one, Recording(joints=made)])[0].joints is None
    assert keep_common_joints([one, one])[0].joints is measured
    with pytest.raises(ConfigError, match=r'joints: stamps \(1200,\) and rows \(1200, 2\), '
                                          r'expected \(n,\) and \(n, 3\)'):
        third_party('own', Own({'wrench': WRENCH, 'pose': POSE, 'joints': (T, rows[:, :2])})).run(
            inputs, (1.0,))


def test_measured_joints_that_a_simulator_lacks_are_said():
    assert not list(missing_joint_notes((), ()))
    assert not list(missing_joint_notes(('lift',), ('lift',)))
    none, = missing_joint_notes(('shoulder', 'elbow'), ())
    assert none.startswith('it simulates none of the joints in joint_states (shoulder, elbow)')
    some, = missing_joint_notes(('shoulder', 'finger'), ('shoulder',))
    assert some.endswith(': finger')


@pytest.mark.long
def test_a_drive_that_is_a_third_too_weak_is_found_with_its_gain(tmp_path):
    pytest.importorskip('mujoco')
    from forcecal_ros.sim.mujoco import load_mujoco
    from golden_recordings import arm

    arm(tmp_path, 304, {'kp': [4000.0, 2600.0, 4000.0]})
    robot = third_party('arm.xml', load_mujoco(str(tmp_path / 'arm.xml')))
    found = SimulatorSource(robot, TOLERANCES).diagnose(
        read_recording(tmp_path / 'a')).diagnosis
    effect, = found.effects
    value = effect.parameters['value']
    assert effect.name == 'kp[lift]' and effect.probability > 0.8
    assert value.value == pytest.approx(2600.0, abs=4.0 * value.std) and value.std < 20.0


@pytest.mark.long
@pytest.mark.parametrize('seed, weak', [
    (1, {}), (2, {}), (5, {'kp[lift]': 3000.0}), (9, {'dof_frictionloss[lift]': 1.5})])
def test_numbers_of_a_robot_that_is_a_little_off_are_found_within_their_errors(
        seed, weak, tmp_path):
    """All of its numbers, beside one that is far off; the model's step is four times its own."""
    pytest.importorskip('mujoco')
    from forcecal_ros.sim.mujoco import load_mujoco

    rng, seconds = np.random.default_rng(seed), 12.0
    for name, step in (('arm.xml', '0.002'), ('robot.xml', '0.0005')):
        (tmp_path / name).write_text(mjcf().replace('timestep="0.002"', f'timestep="{step}"'))
    model, robot = (load_mujoco(str(tmp_path / name)) for name in ('arm.xml', 'robot.xml'))
    true = {p.name: p.nominal if 'backlash' in p.name else float(np.clip(
        rng.normal(p.nominal, p.sigma), p.low, p.high)) for p in model.parameters()} | weak
    made = robot.simulate(Inputs(0.0, seconds, joints=told(seconds), measured_joints=NAMES), true)
    (t, wrench), (_, pose), (_, joints) = (made[name] for name in ('wrench', 'pose', 'joints'))
    turned = rotation_from_vector(rng.normal(scale=2e-4, size=(len(t), 3)))
    found = SimulatorSource(third_party('arm.xml', model), TOLERANCES).diagnose(Recording(
        wrench=Stream(t, wrench + rng.normal(size=(len(t), 6)) * np.repeat([0.08, 0.004], 3)),
        pose=PoseStream(t, pose[:, :3] + rng.normal(scale=1e-4, size=(len(t), 3)),
                        matrix_from_quaternion(pose[:, 3:]) @ turned),
        joints=JointStream(t, joints + rng.normal(scale=3e-5, size=joints.shape), '', NAMES),
        joint_commands=told(seconds)))
    assert [e.name for e in found.diagnosis.effects] == list(weak)
    off = {p.name: (x - p.to_linear(true[p.name]) + p.nominal) / std for p in model.parameters()
           for x, std in [found.outcome.recalibrations.get(p.name, (0.0, 0.0))] if std}
    errors = np.abs([*off.values()])
    assert len(off) > 12 and np.median(errors) < 1.2 and errors.max() < 4.0, off
