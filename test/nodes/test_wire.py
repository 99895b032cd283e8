"""Fast reading and writing of messages against ROS's own."""


from forcecal_ros.nodes.wire import DOUBLES, frame_of, JointReader, JointWriter, Reader, Writer
from geometry_msgs.msg import AccelStamped
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, JointState

STAMP = 1_700_000_000_123_456_789
TYPES = pytest.mark.parametrize('kind', list(DOUBLES), ids=lambda kind: kind.__name__)


def numbers(count):
    return [0.5 + i for i in range(count)]


@TYPES
@pytest.mark.parametrize('frame', ['', 'a', 'base', 'ft_sensor', 'x' * 31, 'Gelenk_ä'])
def test_what_is_written_is_what_ros_reads_and_writes_again(kind, frame):
    raw = Writer(kind, frame)(STAMP, numbers(DOUBLES[kind]))
    message = deserialize_message(raw, kind)
    assert message.header.frame_id == frame_of(raw) == frame
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(STAMP, 10**9)
    again = bytes(serialize_message(message))
    assert len(again) == len(raw)
    assert Reader(kind)(again) == Reader(kind)(raw)


@TYPES
def test_the_numbers_read_are_those_written_in_their_order(kind):
    stamp, values = Reader(kind)(Writer(kind, 'base')(STAMP, numbers(DOUBLES[kind])))
    assert stamp == STAMP
    expected = numbers(DOUBLES[kind])
    if kind is Imu:
        expected = expected[25:28]
    elif kind is AccelStamped:
        expected = expected[:3]
    assert list(values) == expected


def test_the_acceleration_is_read_from_where_ros_puts_it():
    message = Imu()
    message.linear_acceleration.x, message.linear_acceleration.z = 1.5, -9.8
    assert Reader(Imu)(bytes(serialize_message(message))).values == (1.5, 0.0, -9.8)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.text(st.characters(codec='ascii', exclude_characters='\0'), max_size=12),
                max_size=5, unique=True),
       st.integers(0, 5), st.text('abc', max_size=9))
def test_one_joint_is_found_among_any_others(names, at, frame):
    names = [name for name in names if name != 'optidrive']
    names.insert(at, 'optidrive')
    message = JointState(name=names, position=numbers(len(names)), velocity=[7.0])
    message.header.frame_id = frame
    message.header.stamp.sec = 5
    raw = bytes(serialize_message(message))
    read = JointReader('optidrive')
    for _ in range(2):
        sample = read(raw)
        assert sample.values == (0.5 + names.index('optidrive'),)
        assert sample.stamp_ns == 5 * 10**9


def test_a_joint_that_is_not_there_is_no_sample():
    read = JointReader('optidrive')
    other = JointState(name=['wrist'], position=[1.0])
    assert read(bytes(serialize_message(other))) is None
    short = JointState(name=['wrist', 'optidrive'], position=[1.0])
    assert read(bytes(serialize_message(short))) is None
    full = JointState(name=['wrist', 'optidrive'], position=[1.0, 2.0])
    assert read(bytes(serialize_message(full))).values == (2.0,)


def test_a_joint_written_is_what_ros_reads():
    raw = JointWriter('optidrive', 'ft_sensor')(STAMP, 0.025)
    message = deserialize_message(raw, JointState)
    assert list(message.name) == ['optidrive'] and list(message.position) == [0.025]
    assert not message.velocity and not message.effort
    assert message.header.frame_id == 'ft_sensor'
    assert JointReader('optidrive')(raw) == (STAMP, (0.025,))
