"""Every parameter of every node as ``ros2 param`` meets it: described, bounded, checked."""

from importlib import import_module

from forcecal_ros.nodes import sim
from live import Live
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters

TABLES = {'sim': 'sim', 'sequencer': 'sequencer_settings', 'observer': 'observer_settings',
          'gap': 'gap', 'impedance': 'impedance_settings'}
NOT_OURS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
NUMBERS = (ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE)


@pytest.fixture(scope='module')
def described(ros_domain_of_module):
    """Start every node; return a bench, and each node's descriptors by name."""
    with Live() as live:
        for node in TABLES:
            live.start(node)
        found = {}
        for node in TABLES:
            names = live.call(f'{node}/list_parameters', ListParameters).result.names
            ours = [name for name in names if not name.startswith(NOT_OURS)]
            answer = live.call(f'{node}/describe_parameters', DescribeParameters,
                               DescribeParameters.Request(names=ours))
            found[node] = {d.name: d for d in answer.descriptors}
        yield live, found


def table(node):
    """Return the rows of a node's table by name."""
    module = import_module(f'forcecal_ros.nodes.{TABLES[node]}')
    return {row.name: row for row in module.PARAMETERS}


def bounds(descriptor):
    """Return the range that a descriptor says, or None."""
    for span in (*descriptor.floating_point_range, *descriptor.integer_range):
        return span.from_value, span.to_value
    return None


@pytest.mark.parametrize('node', TABLES)
def test_the_wire_says_what_the_table_says(described, node):
    rows = table(node)
    found = described[1][node]
    assert set(found) == set(rows)
    for name, descriptor in found.items():
        row = rows[name]
        assert descriptor.description.startswith(row.description), name
        assert f'[{row.unit}]' in descriptor.description or not row.unit, name
        assert all(word in descriptor.description for word in row.choices), name
        assert descriptor.read_only is not row.live, name
        if descriptor.type in NUMBERS:
            low, high = bounds(descriptor)
            assert low <= row.default <= high, name


@pytest.mark.parametrize('node', TABLES)
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
    results = live.set(node, **wrong)
    assert wrong and len(results) == len(wrong)
    for name, result in zip(wrong, results):
        assert not result.successful and name in result.reason, (name, result.reason)


@pytest.mark.parametrize('arguments', [('-p', 'speed'), ('--params-file', '/nowhere.yaml')])
def test_ros_arguments_that_cannot_be_read_are_wrong_usage(capsys, arguments):
    assert sim.main(['sim', '--ros-args', *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith('sim: ') and arguments[-1] in line


def test_a_node_that_may_not_start_says_so(ros_domain, capfd, monkeypatch, tmp_path):
    """Without its keys under Enforce, whether or not this DDS was built with security."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    assert sim.main(['sim', '--ros-args', '--enclave', '/forcecal/sim']) == 1
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith('sim: ROS 2 refuses to start') and 'ROS_SECURITY_ENABLE' in line
