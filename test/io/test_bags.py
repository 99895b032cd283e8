"""Recordings come back as they were written, whoever wrote them and however they are stored."""

from dataclasses import replace
from typing import Any

from bag_samples import (
    assert_same_recording,
    copy_bag,
    header,
    small_recording,
    START_NS,
    STORAGES,
    STORE,
    wrench_message,
    write_messages,
)
from forcecal_ros.checks.entry import checked
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.streams import Phase, Recording, Stream
from forcecal_ros.core.topics import require
from forcecal_ros.io.bags import (
    BagWriter,
    read_calibrations,
    read_chunks,
    read_recording,
    write_recording,
    write_signals,
)
from forcecal_ros.io.bags.messages import messages_of
import numpy as np
import pytest
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('bags') / 'small'
    write_recording(path, small_recording())
    return path


def wrenches(stamps_ns, log_ns=None, topic='/wrench', frames=None):
    rng = np.random.default_rng(len(stamps_ns))
    frames = frames or ['ft_sensor'] * len(stamps_ns)
    logs = stamps_ns if log_ns is None else log_ns
    return [(topic, int(log), wrench_message(stamp, rng.normal(size=6), frame))
            for stamp, log, frame in zip(stamps_ns, logs, frames)]


@pytest.mark.parametrize('storage, mode', STORAGES, ids=lambda value: value.name)
def test_storage_and_compression_make_no_difference(tmp_path, bag, storage, mode):
    path = copy_bag(bag, tmp_path / 'copy', storage, mode)
    recording = read_recording(path)
    assert_same_recording(recording, small_recording())
    assert recording.notes == ()
    file = next(file for file in path.iterdir() if file.name != 'metadata.yaml')
    alone = read_recording(file)
    assert_same_recording(alone, small_recording())


def test_order_in_the_file_makes_no_difference(tmp_path, bag):
    path = copy_bag(bag, tmp_path / 'copy', *STORAGES[0], shuffle=np.random.default_rng(3))
    for recording in (read_recording(bag), read_recording(path)):
        assert_same_recording(recording, small_recording())
        assert recording.notes == ()


def test_split_recording_is_one(tmp_path, bag):
    folder = tmp_path / 'split'
    with Reader(bag) as reader:
        messages = list(reader.messages())
    half = len(messages) // 2
    for part, chosen in enumerate([messages[:half], messages[half:]]):
        write_messages(tmp_path / f'part{part}', [
            (connection.topic, log_ns, STORE.deserialize_cdr(data, connection.msgtype))
            for connection, log_ns, data in chosen])
    folder.mkdir()
    for part in range(2):
        (tmp_path / f'part{part}' / f'part{part}.mcap').rename(folder / f'part{part}.mcap')
    assert_same_recording(read_recording(folder), small_recording())


@pytest.mark.parametrize('gyro', [True, False])
def test_specific_force_comes_back_with_and_without_angular_velocity(tmp_path, gyro):
    rng = np.random.default_rng(0)
    t = np.arange(50) / 100
    force, rates = (Stream(t, rng.normal(size=(50, 3)), 'imu') for _ in range(2))
    write_recording(tmp_path / 'bag', Recording(
        accelerometer=force, accelerometer_unit='m/s^2', angular_velocity=rates if gyro else None,
        start_ns=START_NS))
    recording = read_recording(tmp_path / 'bag')
    assert recording.accelerometer_unit == 'm/s^2'
    np.testing.assert_array_equal(recording.accelerometer.values, force.values)
    assert (recording.angular_velocity is not None) == gyro
    if gyro:
        np.testing.assert_array_equal(recording.angular_velocity.values, rates.values)


def test_raw_accelerometer_is_preferred_and_the_other_named(tmp_path):
    t = np.arange(5.0)
    raw, force = np.full((5, 3), 5.0), np.full((5, 3), 9.8)
    write_signals(tmp_path / 'bag', {'accelerometer': Stream(t, raw), 'accel': Stream(t, force)},
                  START_NS)
    recording = read_recording(tmp_path / 'bag')
    assert recording.accelerometer_unit == 'V'
    np.testing.assert_array_equal(recording.accelerometer.values, raw)
    assert any('/accel' in note for note in recording.notes)
    chosen = read_recording(tmp_path / 'bag', {'accel': '/accel'})
    assert chosen.accelerometer_unit == 'm/s^2'
    np.testing.assert_array_equal(chosen.accelerometer.values, force)


def test_sign_of_the_driver_is_turned_round(bag):
    np.testing.assert_array_equal(read_recording(bag, wrench_sign=-1).wrench.values,
                                  -small_recording().wrench.values)


def test_phases_are_the_same_with_and_without_repeats(tmp_path):
    changes = [Phase('idle', 0.0, 2.5), Phase('measure', 2.5, 4.0), Phase('done', 4.0, 6.0)]
    repeats = [Phase(name, start, 0.0) for name, start in (
        ('idle', 0.0), ('idle', 1.0), ('idle', 2.0), ('measure', 2.5), ('measure', 3.5),
        ('done', 4.0), ('done', 5.0))]
    wrench = Stream(np.linspace(0, 6, 13), np.zeros((13, 6)))
    for name, phases in (('changes', changes), ('repeats', repeats)):
        write_signals(tmp_path / name, {'wrench': wrench, 'phase': phases}, START_NS)
        assert read_recording(tmp_path / name).phases == tuple(changes)


def test_stamps_keep_nanoseconds(tmp_path):
    stamps = START_NS + np.array([0, 1001, 10**9 + 7, 50 * 3600 * 10**9 + 333])[:3]
    write_messages(tmp_path / 'bag', wrenches(stamps))
    recording = read_recording(tmp_path / 'bag')
    assert recording.start_ns == START_NS
    np.testing.assert_array_equal(np.rint(recording.wrench.t * 1e9), stamps - START_NS)


def test_zero_stamps_fall_back_to_the_time_of_recording(tmp_path):
    log = START_NS + 10**6 * np.arange(10)
    write_messages(tmp_path / 'bag', wrenches(np.zeros(10, int), log))
    recording = read_recording(tmp_path / 'bag')
    np.testing.assert_allclose(recording.wrench.t, 1e-3 * np.arange(10), atol=1e-12)
    assert any('/wrench: header stamps are zero' in note for note in recording.notes)


def test_nan_and_infinite_rows_are_kept_for_the_checks(tmp_path):
    messages = wrenches(START_NS + 10**6 * np.arange(20))
    messages[3][2].wrench.force.x = float('nan')
    messages[7][2].wrench.torque.z = float('inf')
    write_messages(tmp_path / 'bag', messages)
    recording = read_recording(tmp_path / 'bag')
    assert len(recording.wrench) == 20
    assert not np.isfinite(recording.wrench.values).all(axis=1)[[3, 7]].any()
    usable = checked(recording)
    assert len(usable.wrench) == 18 and usable.removed == {'wrench': 2}
    assert any(note.startswith('wrench: 2 samples are not finite') for note in usable.notes)


def test_a_topic_without_a_message_is_an_empty_stream(tmp_path):
    recording = small_recording()
    silent = {name: getattr(recording, name).between(0.0, 0.0) for name in ('wrench', 'pose')}
    write_recording(tmp_path / 'bag', replace(recording, **silent))
    read = read_recording(tmp_path / 'bag')
    assert read.wrench.values.shape == (0, 6) and read.pose.position.shape == (0, 3)
    assert len(read.target) == len(recording.target)
    with pytest.raises(DataError, match='no messages of wrench'):
        require(read, ['wrench'])


def test_orientations_that_are_no_rotations_are_kept_as_nan_for_the_checks(tmp_path):
    types = STORE.types
    pose: Any = types['geometry_msgs/msg/Pose'](
        types['geometry_msgs/msg/Point'](0.0, 0.0, 0.0),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0))
    unset = types['geometry_msgs/msg/Pose'](
        pose.position, types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 0.0))
    stamped = types['geometry_msgs/msg/PoseStamped']
    write_messages(tmp_path / 'bag', [
        ('/current_pose', START_NS + i, stamped(header(START_NS + i), one))
        for i, one in enumerate([pose, unset, pose])])
    recording = read_recording(tmp_path / 'bag')
    assert np.isnan(recording.pose.R_base_sensor).any(axis=(1, 2)).tolist() == [False, True, False]
    assert len(checked(recording).pose) == 2


def test_several_frames_are_read_and_named(tmp_path):
    frames = ['ft_sensor', 'ft_sensor', 'a_longer_frame'] * 10
    stamps = START_NS + 10**6 * np.arange(30)
    messages = wrenches(stamps, frames=frames)
    write_messages(tmp_path / 'bag', messages)
    recording = read_recording(tmp_path / 'bag')
    assert recording.wrench.frame == 'ft_sensor'
    np.testing.assert_array_equal(recording.wrench.values[:, 0],
                                  [message.wrench.force.x for _, _, message in messages])
    assert any('a_longer_frame' in note and '10' in note for note in recording.notes)


MS = 10**6
WILD = 10 * 365 * 86400 * 10**9 * np.isin(np.arange(100), (50, 99))


@pytest.mark.parametrize('stamps, kept, note', [
    (MS * np.concatenate([np.arange(2000), np.arange(-5000, -1000)]), 4000,
     '2000 messages were left out because their stamps jump'),
    (MS * np.arange(100) + WILD, 98, '2 messages were left out because their stamps jump'),
    (MS * np.repeat(np.arange(10), 2), 10, '10 messages with a duplicate stamp')],
    ids=['clock set back', 'wild stamps', 'repeated stamps'])
def test_stamps_that_do_not_increase_cost_as_few_messages_as_possible(
        tmp_path, stamps, kept, note):
    write_messages(tmp_path / 'bag', wrenches(START_NS + stamps, START_NS + MS * np.arange(
        len(stamps))))
    recording = read_recording(tmp_path / 'bag')
    assert len(recording.wrench) == kept and recording.wrench.t[-1] < 1e-3 * len(stamps)
    assert any(note in one for one in recording.notes)


def test_topic_of_another_clock_is_left_out_and_named(tmp_path):
    messages = wrenches(START_NS + 10**6 * np.arange(20))
    messages += wrenches(10**6 * np.arange(1, 6), START_NS + np.arange(5),
                         topic='/sim/contact_wrench')
    write_messages(tmp_path / 'bag', messages)
    recording = read_recording(tmp_path / 'bag')
    assert recording.contact_truth is None
    assert any('/sim/contact_wrench is stamped' in note for note in recording.notes)
    assert recording.wrench.t[-1] < 1.0


def test_two_robots_are_told_apart_by_one_name(tmp_path):
    recording = small_recording()
    write_signals(tmp_path / 'one', {'wrench': recording.wrench, 'pose': recording.pose}, START_NS,
                  topics={'wrench': '/robot1/wrench', 'pose': '/robot1/current_pose'})
    again = read_recording(tmp_path / 'one')  # of one robot below a namespace no name is needed
    assert (len(again.wrench), len(again.pose)) == (len(recording.wrench), len(recording.pose))
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write([messages_of(role, stream, START_NS, f'/{robot}/{topic}')
                   for role, topic in (('wrench', 'wrench'), ('pose', 'current_pose'))
                   for robot, stream in (('robot1', getattr(recording, role)),
                                         ('robot2', getattr(recording, role).between(0, 0.1)))])
    with pytest.raises(DataError, match='/robot1/wrench, /robot2/wrench.*--topic wrench=NAME'):
        read_recording(tmp_path / 'bag')
    again = read_recording(tmp_path / 'bag', {'wrench': '/robot2/wrench'})
    assert (len(again.wrench), len(again.pose)) == (100, 25)


@pytest.mark.parametrize('topics, error, why', [
    ({'wrench': '/optidrive'}, DataError, ('/optidrive is sensor_msgs/msg/JointState, but wrench '
                                           'must be geometry_msgs/msg/WrenchStamped')),
    ({'wrench': '/ft/data'}, DataError, 'topic /ft/data .* type: /wrench'),
    ({'force': '/wrench'}, ConfigError, 'unknown role force; roles are wrench')])
def test_a_topic_that_cannot_be_read_is_named_with_what_would_fit(bag, topics, error, why):
    with pytest.raises(error, match=why):
        read_recording(bag, topics)


def test_usual_name_with_another_type_is_explained_and_of_two_types_the_one_that_fits_is_read(
        tmp_path):
    text = STORE.types['std_msgs/msg/String']('x')
    write_messages(tmp_path / 'bag', [
        ('/wrench', START_NS, text), *wrenches(START_NS + np.arange(1, 5)),
        ('/current_pose', START_NS, text)])
    recording = read_recording(tmp_path / 'bag')
    assert len(recording.wrench) == 4
    with pytest.raises(DataError, match='/current_pose is std_msgs/msg/String, but pose must be'):
        require(recording, ['pose'])


def write_arrays(path, rows):
    types = STORE.types
    layout = types['std_msgs/msg/MultiArrayLayout']([], 0)
    write_messages(path, [
        ('/raw', START_NS + 1000 * i, types['std_msgs/msg/Float64MultiArray'](layout, row))
        for i, row in enumerate(rows)])


def test_columns_of_an_array_without_header(tmp_path):
    values = np.arange(12.0).reshape(4, 3)
    write_arrays(tmp_path / 'bag', values)
    columns, = read_chunks(tmp_path / 'bag', {'raw': ['data']})
    np.testing.assert_array_equal(columns.values, values)
    np.testing.assert_allclose(columns.t, 1e-6 * np.arange(4), atol=1e-15)
    two, = read_chunks(tmp_path / 'bag', {'/raw': ['data[2]', 'data[0]']})
    np.testing.assert_array_equal(two.values, values[:, [2, 0]])
    assert not list(read_chunks(tmp_path / 'bag', {'raw': ['data[9]']}))
    write_arrays(tmp_path / 'varying', [np.zeros(2), np.zeros(3)])
    with pytest.raises(DataError, match=r'vary in length .2 and 3'):
        list(read_chunks(tmp_path / 'varying', {'raw': ['data']}))


def test_joint_is_found_by_its_name(tmp_path):
    types = STORE.types
    joints = types['sensor_msgs/msg/JointState']
    empty = np.empty(0)
    write_messages(tmp_path / 'bag', [
        ('/optidrive', START_NS + 1,
         joints(header(START_NS + 1), ['arm', 'optidrive'], np.array([1.0, 2.0]), empty, empty)),
        ('/optidrive', START_NS + 2,
         joints(header(START_NS + 2), ['optidrive'], np.array([3.0]), empty, empty)),
        ('/optidrive', START_NS + 3,
         joints(header(START_NS + 3), ['arm'], np.array([4.0]), empty, empty))])
    recording = read_recording(tmp_path / 'bag')
    np.testing.assert_array_equal(recording.optidrive.values, [[2.0], [3.0]])
    assert any('/optidrive: 1 messages were left out' in note for note in recording.notes)


def test_type_that_only_the_recording_defines_is_read(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(
        'std_msgs/Header header\nstring unit\nint16[4] counts\nfloat32 t', 'jr3_msgs/msg/Raw'))
    raw = store.types['jr3_msgs/msg/Raw']
    for storage in StoragePlugin:
        with Writer(tmp_path / storage.name, version=9, storage_plugin=storage) as bag:
            connection = bag.add_connection('/jr3', 'jr3_msgs/msg/Raw', typestore=store)
            for i, unit in enumerate(['N', 'lbf', 'N']):
                message = raw(header(START_NS + i), unit, np.array([1, -2, 3, i], np.int16), 0.5)
                bag.write(connection, START_NS,
                          store.serialize_cdr(message, 'jr3_msgs/msg/Raw'))
        columns, = read_chunks(tmp_path / storage.name, {'/jr3': ['counts', 't']})
        np.testing.assert_array_equal(columns.values, [[1, -2, 3, i, 0.5] for i in range(3)])


def test_text_comes_back(tmp_path):
    text = 'format: forcecal-calibration/1\nmaß: 13 kg\n'
    write_signals(tmp_path / 'bag', {'calibration': text}, START_NS)
    assert read_calibrations(tmp_path / 'bag') == [text]
    with Reader(tmp_path / 'bag') as reader:
        quality = reader.connections[0].ext.offered_qos_profiles[0]
    assert quality.durability == QosDurability.TRANSIENT_LOCAL


def test_failure_while_writing_leaves_the_old_recording(tmp_path):
    path = tmp_path / 'bag'
    write_messages(path, wrenches(START_NS + np.arange(1, 5)))
    with pytest.raises(ZeroDivisionError):
        with BagWriter(path) as bag:
            bag.write_raw('/x', 'std_msgs/msg/String', 0, b'')
            raise ZeroDivisionError
    assert [file.name for file in tmp_path.iterdir()] == ['bag']
    assert len(read_recording(path).wrench) == 4


def test_writing_to_an_impossible_place_is_one_line(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(ConfigError, match='cannot be written'):
        with BagWriter(tmp_path / 'file' / 'bag'):
            pass


def test_an_unknown_type_is_refused(tmp_path):
    with pytest.raises(ConfigError, match='my_msgs/msg/None'):
        with BagWriter(tmp_path / 'bag') as bag:
            bag.write_raw('/x', 'my_msgs/msg/None', 0, b'')
    assert not (tmp_path / 'bag').exists()
