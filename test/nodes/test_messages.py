"""Serialised messages as the nodes read and write them say what rosbags says, bit for bit."""

from struct import error as StructError

from bag_samples import header, STORE
from forcecal_ros.core.topics import ACCEL, IMU, JOINT_STATE, POSE, TWIST, VECTOR3, WRENCH
from forcecal_ros.io.bags.messages import encode, FIELDS
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
import numpy as np
import pytest

msgs = pytest.importorskip('geometry_msgs.msg', reason='needs the messages of ROS 2')
sensor_msgs = pytest.importorskip('sensor_msgs.msg', reason='needs the messages of ROS 2')

wire = pytest.importorskip('forcecal_ros.nodes.wire')
inputs = pytest.importorskip('forcecal_ros.nodes.inputs')

CLASSES = {WRENCH: msgs.WrenchStamped, VECTOR3: msgs.Vector3Stamped, ACCEL: msgs.AccelStamped,
           POSE: msgs.PoseStamped, IMU: sensor_msgs.Imu, TWIST: msgs.TwistStamped}
READ = {**FIELDS, IMU: FIELDS[IMU][:3]}
WRITTEN = {
    **{msgtype: FIELDS[msgtype] for msgtype in (WRENCH, VECTOR3, POSE)},
    ACCEL: [f'accel.{part}.{axis}' for part in ('linear', 'angular') for axis in 'xyz'],
    TWIST: [f'twist.{part}.{axis}' for part in ('linear', 'angular') for axis in 'xyz'],
    IMU: [*(f'orientation.{axis}' for axis in 'xyzw'),
          *(f'orientation_covariance[{i}]' for i in range(9)),
          *(f'angular_velocity.{axis}' for axis in 'xyz'),
          *(f'angular_velocity_covariance[{i}]' for i in range(9)),
          *(f'linear_acceleration.{axis}' for axis in 'xyz'),
          *(f'linear_acceleration_covariance[{i}]' for i in range(9))],
}
STAMPS = st.integers(0, (1 << 31) * 10**9 - 1)
FRAMES = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=20)
NAMES = st.text(st.characters(codec='ascii', exclude_characters='\0'), min_size=1, max_size=9)


def serialised(msgtype, stamp, fields, values, frame, little=True):
    raw = encode(msgtype, np.array([stamp]), fields, np.array([values]),
                 {'header.frame_id': frame})[0].tobytes()
    message = STORE.deserialize_cdr(raw, msgtype)
    return bytes(STORE.serialize_cdr(message, msgtype, little_endian=little))


def joints(stamp, names, positions, frame='', little=True):
    nothing = np.empty(0)
    message = STORE.types[JOINT_STATE](header(stamp, frame), list(names),
                                       np.array(positions, dtype=float), nothing, nothing)
    return bytes(STORE.serialize_cdr(message, JOINT_STATE, little_endian=little))


@pytest.mark.parametrize('little', [True, False])
@pytest.mark.parametrize('msgtype', [WRENCH, VECTOR3, ACCEL, POSE, IMU])
@settings(max_examples=20)
@given(data=st.data(), stamp=STAMPS, frame=FRAMES)
def test_stamp_numbers_and_frame_are_read(msgtype, little, data, stamp, frame):
    fields = READ[msgtype]
    values = data.draw(npst.arrays(float, len(fields)))
    raw = serialised(msgtype, stamp, fields, values, frame, little)
    sample = wire.Reader(CLASSES[msgtype])(raw)
    assert sample.stamp_ns == stamp
    np.testing.assert_array_equal(sample.values, values)
    assert sample.frame == frame


@pytest.mark.parametrize('msgtype', WRITTEN)
@settings(max_examples=20)
@given(data=st.data(), stamp=STAMPS, frame=FRAMES)
def test_messages_are_written_as_rosbags_writes_them(msgtype, data, stamp, frame):
    fields = WRITTEN[msgtype]
    values = data.draw(npst.arrays(float, len(fields), elements=st.floats(allow_nan=False)))
    assert (wire.Writer(CLASSES[msgtype], frame)(stamp, values.tolist())
            == serialised(msgtype, stamp, fields, values, frame))


@pytest.mark.parametrize('little', [True, False])
@settings(max_examples=20)
@given(names=st.lists(NAMES, max_size=4, unique=True), data=st.data(), stamp=STAMPS, frame=FRAMES)
def test_joint_is_found_by_name_wherever_it_stands(little, names, data, stamp, frame):
    read = inputs.optidrive_input('optidrive').read
    for _ in range(2):
        order = data.draw(st.permutations([*names, 'optidrive']))
        positions = data.draw(npst.arrays(float, len(order), elements=st.floats(allow_nan=False)))
        stamp_ns, values, _ = read(joints(stamp, order, positions, frame, little))
        assert (stamp_ns, values) == (stamp, (positions[order.index('optidrive')],))
        assert read(joints(stamp, names, positions[:len(names)], frame, little)) is None
        assert read(joints(stamp, order, [], frame, little)) is None


@settings(max_examples=20)
@given(stamp=STAMPS, position=st.floats(allow_nan=False), frame=FRAMES, joint=NAMES)
def test_joint_is_written_as_rosbags_writes_it(stamp, position, frame, joint):
    assert (wire.Writer(sensor_msgs.JointState, frame, joint)(stamp, [position])
            == joints(stamp, [joint], [position], frame))


@pytest.mark.parametrize('msgtype', [WRENCH, VECTOR3, ACCEL, POSE, IMU])
@settings(max_examples=20)
@given(data=st.data())
def test_message_cut_short_is_refused(msgtype, data):
    whole = serialised(msgtype, 10**9, READ[msgtype], np.ones(len(READ[msgtype])), 'ft_sensor')
    unread = {ACCEL: 24, IMU: 72}.get(msgtype, 0)
    cut = data.draw(st.integers(4, len(whole) - unread - 1))
    with pytest.raises(StructError):
        wire.Reader(CLASSES[msgtype])(whole[:cut])


@settings(max_examples=20)
@given(st.binary(max_size=200))
def test_noise_is_read_or_refused_as_too_short(content):
    for read in (wire.Reader(msgs.WrenchStamped), wire.Reader(sensor_msgs.Imu),
                 inputs.optidrive_input('optidrive').read):
        try:
            read(b'\0\1\0\0' + content)
        except StructError:
            continue
