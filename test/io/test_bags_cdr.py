"""Serialised messages: arrays and rosbags' messages say the same, bit for bit."""

from typing import Any

from bag_samples import STORE
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Stream
from forcecal_ros.core.topics import (
    CONTROLLER_STATE,
    DIAGNOSTICS,
    IMU,
    JOINT_STATE,
    MULTI_ARRAY,
    POSE,
    ROLES,
    Topic,
    WRENCH,
)
from forcecal_ros.io.bags.files import Batch
from forcecal_ros.io.bags.messages import CdrError, Decoder, encode, FIELDS, messages_of, walk
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
import numpy as np
import pytest

TYPES = sorted({msgtype for role in ROLES.values() for msgtype in role.types}
               - {CONTROLLER_STATE})  # which recordings bring along
STAMPS = st.integers(0, (1 << 31) * 10**9 - 1)
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=20)


def batch(messages, msgtype):
    return Batch.of(Topic('/x', msgtype), messages, np.zeros(len(messages), int))


def value_at(message, path):
    for name in path.split('.'):
        message = getattr(message, name)
    return message


@pytest.mark.parametrize('msgtype', sorted(FIELDS))
@settings(max_examples=10)
@given(data=st.data())
def test_rosbags_reads_what_was_encoded(msgtype, data):
    paths = FIELDS[msgtype] if msgtype != JOINT_STATE else ('position[0]', 'position[1]')
    n = data.draw(st.integers(1, 4))
    stamps = np.array(data.draw(st.lists(STAMPS, min_size=n, max_size=n)))
    values = data.draw(npst.arrays(float, (n, len(paths))))
    frame = data.draw(TEXT)
    rows = encode(msgtype, stamps, paths, values, {'header.frame_id': frame})
    for row, stamp, numbers in zip(rows, stamps.tolist(), values):
        message: Any = STORE.deserialize_cdr(row.tobytes(), msgtype)
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(stamp, 10**9)
        assert message.header.frame_id == frame
        read = (message.position if msgtype == JOINT_STATE
                else [value_at(message, path) for path in paths])
        np.testing.assert_array_equal(read, numbers)
        assert bytes(STORE.serialize_cdr(message, msgtype)) == row.tobytes()


@pytest.mark.parametrize('little', [True, False])
@settings(max_examples=15)
@given(frames=st.lists(TEXT, min_size=1, max_size=6), data=st.data())
def test_messages_of_rosbags_are_decoded_whatever_their_frame(little, frames, data):
    n = len(frames)
    values = data.draw(npst.arrays(float, (n, 6)))
    stamps = np.array(data.draw(st.lists(STAMPS, min_size=n, max_size=n)))
    messages = []
    for frame, stamp, numbers in zip(frames, stamps, values):
        row = encode(WRENCH, np.array([stamp]), FIELDS[WRENCH], numbers[None],
                     {'header.frame_id': frame})[0]
        message = STORE.deserialize_cdr(row.tobytes(), WRENCH)
        messages.append(bytes(STORE.serialize_cdr(message, WRENCH, little_endian=little)))
    decoder = Decoder(STORE, WRENCH)
    seen = np.zeros(n, int)
    for group in decoder.groups(batch(messages, WRENCH)):
        seen[group.where] += 1
        np.testing.assert_array_equal(group.columns(FIELDS[WRENCH]), values[group.where])
        np.testing.assert_array_equal(group.stamps(), stamps[group.where])
        assert {frames[i] for i in group.where} == {group.layout.text['header.frame_id']}
    assert (seen == 1).all() and decoder.undecodable == 0


@pytest.mark.parametrize('msgtype', TYPES)
@settings(max_examples=10)
@given(content=st.binary(max_size=400))
def test_noise_is_decoded_or_counted(msgtype, content):
    decoder = Decoder(STORE, msgtype)
    groups = list(decoder.groups(batch([b'\0\1\0\0' + content, content], msgtype)))
    assert sum(len(group.where) for group in groups) + decoder.undecodable == 2


@pytest.mark.parametrize('msgtype', TYPES)
def test_every_type_of_ours_has_a_layout(msgtype):
    message = encode(msgtype, np.array([10**9]), (), np.empty((1, 0)))[0].tobytes()
    assert walk(STORE, msgtype, message).length == len(message)
    with pytest.raises(CdrError):
        walk(STORE, msgtype, message[:3])


def test_sequences_are_as_long_as_their_elements_are_named():
    row = encode(MULTI_ARRAY, np.zeros(1, int), ('data[5]', 'layout.dim[1].size'),
                 np.array([[7.0, 3.0]]), {'layout.dim[0].label': 'rows'})[0].tobytes()
    message: Any = STORE.deserialize_cdr(row, MULTI_ARRAY)
    np.testing.assert_array_equal(message.data, [0, 0, 0, 0, 0, 7])
    assert [one.label for one in message.layout.dim] == ['rows', '']
    assert message.layout.dim[1].size == 3


def test_imu_without_gyro_says_so():
    row = next(iter(messages_of('imu', Stream([0.0], [[1.0, 2.0, 3.0]]), 0).rows)).tobytes()
    message: Any = STORE.deserialize_cdr(row, IMU)
    assert message.linear_acceleration.z == 3.0
    assert message.orientation_covariance[0] == message.angular_velocity_covariance[0] == -1


def test_stamp_beyond_2038_is_refused():
    with pytest.raises(DataError, match='between 1970 and 2038'):
        encode(POSE, np.array([(1 << 31) * 10**9]), (), np.empty((1, 0)))


def test_length_beyond_the_end_is_refused():
    row = bytearray(encode(DIAGNOSTICS, np.zeros(1, int), (), np.empty((1, 0)),
                           {'status[0].message': 'move'})[0])
    for place in range(12, len(row) - 3, 4):
        damaged = bytearray(row)
        damaged[place:place + 4] = b'\xff\xff\xff\x7f'
        decoder = Decoder(STORE, DIAGNOSTICS)
        read = sum(1 for _ in decoder.groups(batch([bytes(damaged)], DIAGNOSTICS)))
        assert read + decoder.undecodable == 1
