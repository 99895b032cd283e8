"""Every parameter of every node as ``ros2 param`` meets it: described, bounded, checked."""

import contextlib
from importlib import import_module
from itertools import pairwise
import json
from pathlib import Path
import re
import statistics
import time
from typing import NamedTuple

from forcecal_ros.cli.main import main
from forcecal_ros.nodes import sequencer, sim
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters
import rclpy
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import String
import yaml

NODES = ('sim', 'sequencer', 'observer', 'gap', 'impedance')
NOT_OURS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
PAGE = Path(__file__).parents[2] / 'docs/reference/nodes.md'
LAYOUTS = Path(__file__).parents[2] / 'layouts'
RVIZ = {'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
        'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
        'rviz_default_plugins/Pose': 'geometry_msgs/msg/PoseStamped'}
"""What the displays of RViz take."""

QOS = {'sensor': (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
       'reliable': (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
       'latched': (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)}
"""What the page's words mean."""

NUMBERS = (ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE)


@pytest.fixture(scope='module')
def described(ros_domain_of_module):
    """Start every node; return a bench, and each node's descriptors by name."""
    with Live() as live:
        for node in NODES:
            live.start(node, **({'publish__marker_rate': 20.0} if node == 'observer' else {}))
        found = {}
        for node in NODES:
            names = live.call(f'{node}/list_parameters', ListParameters).result.names
            ours = [name for name in names if not name.startswith(NOT_OURS)]
            answer = live.call(f'{node}/describe_parameters', DescribeParameters,
                               DescribeParameters.Request(names=ours))
            found[node] = {d.name: d for d in answer.descriptors}
        yield live, found


def table(node):
    """Return the rows of a node's table by name."""
    module = import_module(f'forcecal_ros.nodes.{node}')
    return {row.name: row for row in module.PARAMETERS}


def bounds(descriptor):
    """Return the range that a descriptor says, or None."""
    for span in (*descriptor.floating_point_range, *descriptor.integer_range):
        return span.from_value, span.to_value
    return None


@pytest.mark.parametrize('node', NODES)
def test_the_wire_says_what_the_table_says(described, node):
    rows = table(node)
    found = described[1][node]
    assert set(found) == set(rows)
    for name, descriptor in found.items():
        row = rows[name]
        assert len(row.description) > 10, name
        assert descriptor.description.startswith(row.description), name
        assert f'[{row.unit}]' in descriptor.description or not row.unit, name
        assert all(word in descriptor.description for word in row.choices), name
        assert descriptor.read_only is not row.live, name
        if descriptor.type in NUMBERS:
            low, high = bounds(descriptor)
            assert low <= row.default <= high, name


@pytest.mark.parametrize('node', NODES)
def test_every_bound_and_choice_is_held_when_set(described, node):
    live, found = described
    rows = table(node)
    wrong = {}
    for name, descriptor in found[node].items():
        if descriptor.read_only:
            wrong[name] = rows[name].default
        elif descriptor.type in NUMBERS:
            wrong[name] = type(rows[name].default)(2 * bounds(descriptor)[1] + 1)
        elif rows[name].choices:
            wrong[name] = 'nonsense'
    below = {name: type(rows[name].default)(bounds(descriptor)[0] - 1)
             for name, descriptor in found[node].items()
             if not descriptor.read_only and descriptor.type in NUMBERS}
    assert wrong
    for values in filter(None, (wrong, below)):  # `sim` and `gap` have no number to set
        results = live.set(node, **values)
        assert len(results) == len(values)
        for name, result in zip(values, results):
            assert not result.successful and name in result.reason, (name, result.reason)


class Line(NamedTuple):
    """Of the page's topics of a node: direction, their names, types, and QoS, rate and frame."""

    direction: str
    names: list
    types: list
    cells: list


def documented(node):
    """Yield the lines of a node's topics and services, names in full."""
    section, = re.findall(rf'^### Topics of {node}\n\n(.+?)\n\n', PAGE.read_text(),
                          re.MULTILINE | re.DOTALL)
    for line in section.splitlines():
        direction, names, rest = re.fullmatch(r'- (\w+) (`.+?`): (.+)', line).groups()
        types, *cells = rest.split('; ')
        prefix = node if direction == 'serves' else ''
        yield Line(direction, [prefix + name if name[0] == '/' else name
                               for name in re.findall('`(.+?)`', names)],
                   [one.split()[0] for one in types.split(', ')], cells)


def named(node, direction):
    """Return the names of the page's topics or services of a node."""
    return [name for line in documented(node) if line.direction == direction
            for name in line.names]


def discovered(node, services):
    """
    Return a node's triggers and what it publishes and hears, once all services are there.

    A participant that misses what another announced at its start never hears of it again. So
    somebody who comes anew looks, and somebody else where that one does not see all.
    """
    seen = []
    for patience in (10.0, 20.0, 60.0):
        context = rclpy.Context()
        rclpy.init(context=context)
        graph = rclpy.create_node('newcomer', context=context)
        end = time.monotonic() + patience
        try:
            while time.monotonic() < end:
                # nobody hears of a node before its names arrive
                with contextlib.suppress(NodeNameNonExistentError):
                    found = graph.get_service_names_and_types_by_node(node, '/')
                    seen = [name.strip('/') for name, types in found
                            if types == ['std_srvs/srv/Trigger']]
                    if len(seen) >= len(services):
                        return sorted(seen), *(
                            {name.strip('/') for name, _ in ends(node, '/')} for ends in (
                                graph.get_publisher_names_and_types_by_node,
                                graph.get_subscriber_names_and_types_by_node))
                time.sleep(0.05)
        finally:
            graph.destroy_node()
            context.try_shutdown()
    raise AssertionError(f'{node} serves {seen}, expected {services}')


@pytest.mark.parametrize('node', NODES)
def test_the_page_names_every_topic_and_service(described, node):
    hears, says, services = (named(node, one) for one in ('subscribes', 'publishes', 'serves'))
    served, *ends = discovered(node, services)
    assert served == sorted(services)
    for found, known in zip(ends, (says, hears)):
        names = found - {'rosout', 'parameter_events', 'diagnostics'}
        # a node hears its own topic of commands to notice others there
        assert names - {f'{node}/transition_event', *says} <= {*known}


@pytest.mark.parametrize('node, ends', [
    ('sim', 6), ('sequencer', 11), ('observer', 7), ('gap', 6), ('impedance', 7)])
def test_the_page_has_the_type_and_qos_of_a_topic(described, node, ends):
    graph, seen = described[0].node, 0
    look = {'publishes': graph.get_publishers_info_by_topic,
            'subscribes': graph.get_subscriptions_info_by_topic}
    for line in (line for line in documented(node) if line.direction != 'serves'):
        types = line.types * len(line.names) if len(line.types) == 1 else line.types
        assert len(types) == len(line.names), line
        for topic, kind in zip(line.names, types):
            for one in look[line.direction](topic):
                if one.node_name == node:
                    seen += 1
                    assert one.topic_type.replace('/msg/', '/') == kind, topic
                    assert (one.qos_profile.reliability,
                            one.qos_profile.durability) == QOS[line.cells[0]], topic
    assert seen >= ends


def period(headers):
    """Return the median time between stamps [s]."""
    return statistics.median((after.stamp.sec - before.stamp.sec) + 1e-9 * (
        after.stamp.nanosec - before.stamp.nanosec) for before, after in pairwise(headers))


def test_the_page_has_rate_and_frame_of_each_topic_of_the_rig(described):
    live, heard = described[0], {}
    lines = {topic: line for line in documented('sim') for topic in line.names
             if line.direction == 'publishes' and line.cells[1] != 'if enabled'}
    for topic, line in lines.items():
        package, _, name = line.types[0].partition('/')
        rows = heard.setdefault(topic, [])
        live.node.create_subscription(
            getattr(import_module(f'{package}.msg'), name), topic,
            lambda message, rows=rows: rows.append(message.header), 1000)
    live.until(lambda: all(len(rows) > 100 for rows in heard.values()), 'samples of each sensor')
    assert {*heard} == {'wrench', 'sim/contact_wrench', 'accelerometer/raw', 'current_pose',
                        'optidrive'}
    for topic, rows in heard.items():
        _, rate, *frames = lines[topic].cells
        assert float(rate.removesuffix(' Hz')) == pytest.approx(1.0 / period(rows), rel=1e-3)
        assert {table('sim')[frame.strip('`')].default for frame in frames} == {
            one.frame_id for one in rows} - {''}, topic


@pytest.mark.parametrize('node, words', [
    ('sim', ['up: the nominal rig holds still until commands arrive on target_frame']),
    ('observer', ['up: publishes observer/contact_wrench', 'waiting for a calibration']),
    ('gap', ['up: compares the robot with the nominal rig', 'waiting for target_frame'])])
def test_a_node_says_that_it_is_up_and_what_it_waits_for(described, node, words):
    live, _ = described
    live.until(lambda: all(word in live.said(node) for word in words), f'{words} of {node}')


def test_diagnostics_name_the_hardware(described):
    live, _ = described
    live.until(lambda: {*NODES} <= {*live.diagnostics}, 'diagnostics of every node')
    assert all(live.diagnostics[node].hardware_id == 'robot' for node in NODES)


def test_the_state_is_the_phase_as_a_plain_word(described):
    live, _ = described
    said = {node: [] for node in ('sequencer', 'impedance')}
    for node, words in said.items():
        live.node.create_subscription(
            String, f'{node}/state', lambda message, words=words: words.append(message.data), 10)
    live.until(lambda: all(said.values()), 'a word of both')
    assert {*said['sequencer'], *said['impedance']} == {'idle'}


def test_topics_types_and_frames_of_the_layouts_are_those_of_the_nodes(described):
    manager = yaml.safe_load((LAYOUTS / 'rviz.rviz').read_text())['Visualization Manager']
    displays = [display for display in manager['Displays'] if 'Topic' in display]
    wanted = {display['Topic']['Value'] for display in displays}
    live, frames = described[0], {}
    for kind, topic in ((PoseStamped, 'current_pose'), (WrenchStamped, 'wrench')):
        live.node.create_subscription(
            kind, topic, lambda message, topic=topic: frames.__setitem__(
                topic, message.header.frame_id), 10)
    live.until(lambda: len(frames) == 2 and all(
        live.node.count_publishers(topic) for topic in wanted), 'topics')
    for display in displays:
        asked = display['Topic']
        (publisher,) = live.node.get_publishers_info_by_topic(asked['Value'])
        assert publisher.topic_type == RVIZ[display['Class']], display['Name']
        if asked.get('Durability Policy') == 'Transient Local':
            assert publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        if asked['Reliability Policy'] == 'Reliable':
            assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert frames['current_pose'] == manager['Global Options']['Fixed Frame']
    assert f'<link name="{frames["wrench"]}">' in (LAYOUTS / 'rig.urdf').read_text()
    follow = {config['followTf'] for config in json.loads(
        (LAYOUTS / 'foxglove.json').read_text())['configById'].values() if 'followTf' in config}
    assert follow == {frames['current_pose']}


@pytest.fixture
def shell(described, capfd):
    """Return a function that runs a command beside the nodes."""
    def run(*arguments):
        status = main([*arguments])
        return status, *capfd.readouterr()

    return run


def test_status_tells_of_every_node(described, shell):
    nodes = {}

    def told():
        status, out, _ = shell('status', '--json')
        nodes.update(json.loads(out)['nodes'] if status == 0 else {})
        return set(nodes) == set(NODES)

    # a busy computer may take longer to find all nodes than the command listens
    described[0].until(told, 'a word of every node')
    assert nodes['observer']['message'] == 'waiting for a calibration'
    status, out, err = shell('status', '--namespace', 'left', '--timeout', '0.1')
    assert status == 1 and out == '' and 'no node reports' in err


@pytest.mark.parametrize('arguments, why', [
    (['save'], '/sequencer/save_calibration: there is no calibration yet'),
    (['tare'], '/observer/tare: there is no calibration yet'),
    (['abort', '--node', 'impedance'], '/impedance/abort: no motion is under way'),
    (['start', '--node', 'impedance'], '/impedance/start: observer/contact_wrench: '),
    (['start', '--namespace', '/left', '--timeout', '0.1'], '/left/sequencer/start was not found'),
])
def test_a_refusal_is_one_line_and_status_1(shell, arguments, why):
    status, out, err = shell(*arguments)
    (line,) = err.splitlines()
    assert status == 1 and out == '' and why in line


def test_start_begins_a_motion_and_abort_ends_it(described, shell):
    live, commands = described[0], []
    live.node.create_subscription(PoseStamped, 'target_frame', lambda message: commands.append(
        message.header), 1000)
    live.until(lambda: shell('start')[0] == 0, 'a start', 30.0)
    live.until(lambda: len(commands) > 20, 'commands')
    line, = (line for line in documented('sequencer') if 'target_frame' in line.names)
    assert line.cells[1:] == ['`motion.rate`', 'that of `current_pose`']
    assert period(commands) == pytest.approx(
        1.0 / table('sequencer')['motion.rate'].default, rel=0.05)
    assert {one.frame_id for one in commands} == {table('sim')['frames.base'].default}
    shell('abort')  # unless the robot of a busy machine has ended it before
    described[0].until(lambda: described[0].phases[-1] == 'aborted', 'the end')


@pytest.mark.parametrize('arguments', [('-p', 'speed'), ('--params-file', '/nowhere.yaml')])
def test_ros_arguments_that_cannot_be_read_are_wrong_usage(capsys, arguments):
    assert sim.main(['sim', '--ros-args', *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('sim: ') and arguments[-1] in line


@pytest.mark.parametrize('text, why', [
    ('a:\n\tb: 1\n', "'\\t' that cannot start any token in line 2"),
    ('/**/sim:\n  ros__parameters:\n    a.b: 1\n    a: {b: 2}\n', 'a.b is given twice'),
    ('/**/sim:\n  ros__parameters:\n    accelerometer: no\n', 'accelerometer is False, expected')])
def test_a_parameter_file_that_ros_would_misread_is_refused_in_one_line(
        ros_domain, capfd, tmp_path, text, why):
    (tmp_path / 'my.yaml').write_text(text)
    assert sim.main(['sim', '--ros-args', '--params-file', str(tmp_path / 'my.yaml')]) > 0
    (line,) = capfd.readouterr().err.splitlines()
    assert why in line


def test_a_word_that_yaml_reads_as_yes_or_no_is_named(ros_domain, capfd):
    assert sequencer.main(['sequencer', '--ros-args', '-p', 'identify.tool_compliance:=no']) == 1
    assert "expected a str; write 'no' in quotes" in capfd.readouterr().err


def test_a_node_that_may_not_start_says_so(ros_domain, capfd, monkeypatch, tmp_path):
    """Without its keys under Enforce, whether or not this DDS was built with security."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    assert sim.main(['sim', '--ros-args', '--enclave', '/forcecal/sim']) == 1
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith('sim: ROS 2 refuses to start') and 'ROS_SECURITY_ENABLE' in line
