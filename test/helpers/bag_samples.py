"""Small recordings for tests, written by rosbags alone."""


from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from scipy.spatial.transform import Rotation

STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_700_000_000_123_456_789
STORAGES = [(storage, mode) for storage in StoragePlugin for mode in CompressionMode
            if (storage, mode) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)]


def small_recording(n=400):
    rng = np.random.default_rng(1)
    t = np.arange(n) / 1000
    rotations = Rotation.from_quat(rng.normal(size=(n // 4, 4))).as_matrix()
    poses = PoseStream(t[::4], rng.normal(size=(n // 4, 3)), rotations, 'base')
    return Recording(
        wrench=Stream(t, rng.normal(size=(n, 6)), 'ft_sensor'),
        accelerometer=Stream(t, rng.normal(size=(n, 3)), 'ft_sensor'),
        pose=poses, target=poses,
        optidrive=Stream(t, rng.normal(size=(n, 1)), 'ft_sensor'),
        phases=(Phase('measure', 0.0, 0.1), Phase('move', 0.1, t[-1])),
        start_ns=START_NS)


def header(stamp_ns, frame='ft_sensor'):
    types = STORE.types
    return types['std_msgs/msg/Header'](
        types['builtin_interfaces/msg/Time'](*divmod(int(stamp_ns), 10**9)), frame)


def wrench_message(stamp_ns, values, frame='ft_sensor'):
    types = STORE.types
    vector = types['geometry_msgs/msg/Vector3']
    wrench = types['geometry_msgs/msg/Wrench'](vector(*values[:3]), vector(*values[3:]))
    return types['geometry_msgs/msg/WrenchStamped'](header(stamp_ns, frame), wrench)


def write_messages(path, messages, storage=StoragePlugin.MCAP):
    """Write (topic, log time, message) by rosbags."""
    with Writer(path, version=9, storage_plugin=storage) as bag:
        connections = {}
        for topic, log_ns, message in messages:
            key = topic, message.__msgtype__
            if key not in connections:
                connections[key] = bag.add_connection(*key, typestore=STORE)
            bag.write(connections[key], log_ns,
                      STORE.serialize_cdr(message, message.__msgtype__))
    return path


def copy_bag(source, target, storage, mode, shuffle=None):
    """Write the messages of a bag again by rosbags, otherwise stored."""
    bag = Writer(target, version=9, storage_plugin=storage)
    bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag, Reader(source) as reader:
        connections = {one.id: bag.add_connection(one.topic, one.msgtype, typestore=STORE)
                       for one in reader.connections}
        messages = list(reader.messages())
        if shuffle is not None:
            messages = [messages[i] for i in shuffle.permutation(len(messages))]
        for connection, log_ns, data in messages:
            bag.write(connections[connection.id], log_ns, data)
    return target


def assert_same_recording(one, other):
    for role in ('wrench', 'accelerometer', 'optidrive', 'contact_truth', 'angular_velocity'):
        a, b = getattr(one, role), getattr(other, role)
        assert (a is None) == (b is None), role
        if a is not None:
            np.testing.assert_array_equal(a.t, b.t)
            np.testing.assert_array_equal(a.values, b.values)
            assert a.frame == b.frame
    for role in ('pose', 'target'):
        a, b = getattr(one, role), getattr(other, role)
        np.testing.assert_array_equal(a.t, b.t)
        np.testing.assert_array_equal(a.position, b.position)
        np.testing.assert_allclose(a.R_base_sensor, b.R_base_sensor, atol=4e-16)
    assert one.phases == other.phases
    assert one.start_ns == other.start_ns
    assert one.accelerometer_unit == other.accelerometer_unit
