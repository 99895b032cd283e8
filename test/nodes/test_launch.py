"""Launch files: read as text everywhere, carried out where ROS 2's launch is installed."""

import ast
import importlib.util
import os
from pathlib import Path
import sys

from forcecal_ros.cli.node import NODES
import pytest

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT / 'forcecal_ros' / 'nodes' / 'launching.py'
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))


def calls(path, function):
    """All calls of a function in a file, as syntax trees."""
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name) and node.func.id == function]


@pytest.mark.parametrize('path', [*FILES, SHARED], ids=lambda path: path.name)
def test_every_argument_says_what_it_is_for(path):
    for call in calls(path, 'DeclareLaunchArgument'):
        assert any(word.arg == 'description' for word in call.keywords), ast.unparse(call)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_node_is_an_executable_with_a_parameter_file(path):
    names = {call.args[0].value for call in calls(path, 'node')}
    assert names
    for name in names:
        assert name in NODES
        assert (ROOT / 'config' / f'{name}.yaml').is_file()


def test_every_remapped_topic_is_one_that_nodes_ask_for():
    from forcecal_ros.core.topics import ROLES
    commands = {'joint_trajectory', 'delta_twist_cmds', 'joint_states'}
    known = {role.topic for role in ROLES.values()} | commands
    table = next(node.value for node in ast.parse(SHARED.read_text()).body
                 if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'TOPICS')
    topics = [topic for topic, _ in ast.literal_eval(table).values()]
    assert len(topics) == 11
    assert set(topics) <= known


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_it_describes_its_nodes_and_arguments(path):
    pytest.importorskip('launch_ros', reason="ROS 2's launch is not on PyPI")
    from launch import LaunchContext
    from launch.actions import DeclareLaunchArgument
    from launch_ros.actions import Node
    spec = importlib.util.spec_from_file_location(path.stem.partition('.')[0], path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities = module.generate_launch_description().describe_sub_entities()
    nodes = [entity for entity in entities if isinstance(entity, Node)]
    assert {entity.node_executable for entity in nodes} >= {'sim', 'observer'}
    context = LaunchContext()
    context.launch_configurations['sim'] = 'false'
    running = {entity.node_executable for entity in nodes
               if entity.condition is None or entity.condition.evaluate(context)}
    assert 'sim' not in running and 'observer' in running
    arguments = {entity.name: entity.description for entity in entities
                 if isinstance(entity, DeclareLaunchArgument)}
    assert {'wrench', 'current_pose', 'namespace', 'use_sim_time', 'sim'} <= set(arguments)
    assert all(arguments.values())


def test_presets_give_topics_and_parameter_files_and_the_users_file_counts_last():
    pytest.importorskip('launch_ros', reason="ROS 2's launch is not on PyPI")
    from forcecal_ros.core.topics import preset_file
    from forcecal_ros.nodes import launching
    from launch import LaunchContext
    from launch.actions import DeclareLaunchArgument

    def resolved(**given):
        context = LaunchContext()
        context.launch_configurations.update(given)
        for one in launching.describe([], [launching.parameters_argument('sequencer')]):
            if isinstance(one, DeclareLaunchArgument):
                one.execute(context)
        return context.launch_configurations

    found = resolved(robot='ur', controller='moveit_servo', current_pose='/mine')
    assert found['wrench'] == '/force_torque_sensor_broadcaster/wrench'
    assert found['delta_twist_cmds'] == '/servo_node/delta_twist_cmds'
    assert found['current_pose'] == '/mine' and found['target_frame'] == 'target_frame'
    assert found['sequencer_params'] == str(preset_file('moveit_servo'))
    assert resolved(robot='ur')['sequencer_params'] == str(preset_file('ur'))
    assert resolved(robot='ur', sequencer_params='/a.yaml')['sequencer_params'] == '/a.yaml'
    assert launching.node('sequencer') is not None


@pytest.fixture
def launched(ros_domain, tmp_path, monkeypatch):
    """
    Return a function that runs a launch file until all nodes are up or one of them has ended.

    It returns what they said, and their exit statuses by executable.
    """
    pytest.importorskip('launch_ros', reason="ROS 2's launch is not on PyPI")
    from launch import LaunchDescription, LaunchService
    from launch.actions import IncludeLaunchDescription, RegisterEventHandler, Shutdown
    from launch.event_handlers import OnProcessExit, OnProcessIO, OnProcessStart
    from launch.launch_description_sources import PythonLaunchDescriptionSource
    _install(tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path), prepend=os.pathsep)

    def run(path, **arguments):
        started, said, ended = [], [], {}

        def hear(event):
            said.append(event.text.decode())
            up = ''.join(said).count(': up: ') + ''.join(said).count(': ready: ')
            return Shutdown() if up == len(started) else None

        def end(event, context):
            ended[event.action.node_executable] = event.returncode
            return Shutdown()

        service = LaunchService(noninteractive=True)
        service.include_launch_description(LaunchDescription([
            RegisterEventHandler(OnProcessStart(
                on_start=lambda event, context: started.append(event.process_name))),
            RegisterEventHandler(OnProcessIO(on_stderr=hear)),
            RegisterEventHandler(OnProcessExit(on_exit=end)),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(str(path)),
                                     launch_arguments=arguments.items())]))
        service.run()
        return ''.join(said), ended

    return run


def _install(prefix):
    """Make a prefix in which ROS 2 finds the package and the nodes of this tree."""
    index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages'
    index.mkdir(parents=True)
    (index / 'forcecal_ros').touch()
    (prefix / 'share' / 'forcecal_ros').symlink_to(ROOT)
    programs = prefix / 'lib' / 'forcecal_ros'
    programs.mkdir(parents=True)
    for name in NODES:
        program = programs / name
        program.write_text(f'#!{sys.executable}\nfrom forcecal_ros.entry import {name}\n'
                           f'raise SystemExit({name}())\n')
        program.chmod(0o755)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_its_nodes_start_in_the_namespace_and_end_cleanly(launched, path):
    said, ended = launched(path, sim='true', use_sim_time='true', namespace='left', calibration='')
    names = {'sim', *(call.args[0].value for call in calls(path, 'node'))}
    assert ended == dict.fromkeys(names, 0), said
    assert all(f'[left.{name}]: ' in said for name in names)
    assert 'publishes /clock' in said and 'Traceback' not in said


@pytest.mark.parametrize('name', ['20240501', 'arm: left #2.yaml'])
def test_the_calibration_is_the_file_of_that_name_not_what_yaml_makes_of_it(launched, name):
    observe = next(path for path in FILES if path.name == 'observe.launch.py')
    said, ended = launched(observe, calibration=name)
    assert f'observer: {name}: cannot be read' in said
    assert ended == {'observer': 1}


def test_a_parameter_file_that_is_not_there_is_refused_not_left_out(launched):
    observe = next(path for path in FILES if path.name == 'observe.launch.py')
    said, ended = launched(observe, calibration='', observer_params='/nowhere.yaml')
    assert 'observer: /nowhere.yaml: cannot be read' in said
    assert ended == {'observer': 2}
