"""Poses out of /tf, as a driver with robot_state_publisher records them."""

from bag_samples import header, STORE, wrench_message, write_messages
from forcecal_ros.core.errors import DataError
from forcecal_ros.io.bags import read_recording
from forcecal_ros.observe.pose_sources import TransformPose
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

T = 0.01 * np.arange(200)


def turn(i, t):
    """Rotation and place of link i in its parent: smooth, of another rate each."""
    return (Rotation.from_rotvec(np.outer(np.sin((0.5 + i) * t), np.eye(3)[i])),
            np.outer(np.cos(0.7 * t), [0.1 * (i + 1), -0.05, 0.3]))


FIXED = (Rotation.from_euler('xyz', [0.1, -0.2, 0.3]), np.array([0.0, 0.02, 0.11]))


def transform(stamp, parent, child, R, p):
    kind = STORE.types
    return kind['geometry_msgs/msg/TransformStamped'](
        header(stamp, parent), child, kind['geometry_msgs/msg/Transform'](
            kind['geometry_msgs/msg/Vector3'](*p), kind['geometry_msgs/msg/Quaternion'](
                *R.as_quat())))


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Three links that move, the last message by message of another time; a fixed tool."""
    links, late, messages = [turn(i, T) for i in range(3)], turn(2, T + 0.004), []

    def tf(topic, stamp, *transforms):
        messages.append((topic, stamp, STORE.types['tf2_msgs/msg/TFMessage'](list(transforms))))

    tf('/tf_static', 10**9, transform(10**9, 'link2', 'tool0', *FIXED),
       transform(10**9, 'elsewhere', 'camera', *FIXED))
    for k, t in enumerate(T):
        stamp = 10**9 + round(1e9 * t)
        tf('/tf', stamp, *(transform(stamp, parent, f'link{i}', links[i][0][k], links[i][1][k])
                           for i, parent in enumerate(('base_link', 'link0'))))
        tf('/tf', stamp + 4_000_000, transform(stamp + 4_000_000, 'link1', 'link2',
                                               late[0][k], late[1][k]))
        messages.append(('/wrench', stamp, wrench_message(
            stamp, [0.0, 0.1 * k, 1.0] * 2, 'tool0')))
    return write_messages(tmp_path_factory.mktemp('tf') / 'bag', messages)


def expected(t):
    R, p = Rotation.identity(len(t)), np.zeros((len(t), 3))
    for own, place in (*(turn(i, t) for i in range(3)), FIXED):
        p = p + R.apply(np.broadcast_to(place, p.shape).copy())
        R = R * own
    return R.as_matrix(), p


def test_the_pose_of_the_wrench_frame_is_found_by_itself(bag):
    recording = read_recording(bag)
    pose = recording.pose
    assert 'pose: of tool0 in base_link, from /tf' in recording.notes
    assert pose.frame == 'base_link'
    R, p = expected(pose.t)
    # links are linear between samples 10 ms apart: a(t) (10 ms)^2 / 8 of what turns at 2.5 rad/s
    np.testing.assert_allclose(pose.position, p, atol=2e-4)
    np.testing.assert_allclose(pose.R_base_sensor, R, atol=2e-4)


def test_live_the_same_transforms_make_the_same_poses(bag):
    offline, live = read_recording(bag), TransformPose('base_link', 'tool0')
    with Reader(bag) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic == '/tf_static':
                live.take_static(raw)
        found = {pose.stamp_ns: pose.values for connection, _, raw in reader.messages()
                 if connection.topic == '/tf' and (pose := live.take(raw))}
    stamps = offline.start_ns + np.round(1e9 * offline.pose.t).astype(int)
    both = [k for k, stamp in enumerate(stamps) if stamp in found]
    assert len(found) > 1.9 * len(T) and len(both) > 0.9 * len(T)
    poses = np.array([found[stamp] for stamp in stamps[both]])
    # orientations lie on a chord instead of an arc of 25 mrad: 25e-3^3 / 64 off at most
    np.testing.assert_allclose(poses[:, :3], offline.pose.position[both], atol=1e-6)
    np.testing.assert_allclose(Rotation.from_quat(poses[:, 3:]).as_matrix(),
                               offline.pose.R_base_sensor[both], atol=1e-6)


def tf_message(*transforms):
    kind = STORE.types['tf2_msgs/msg/TFMessage']
    return bytes(STORE.serialize_cdr(kind(list(transforms)), 'tf2_msgs/msg/TFMessage'))


def test_a_transform_that_stays_away_ends_the_live_poses():
    live, here = TransformPose('base', 'tool'), (Rotation.identity(), np.zeros(3))
    assert live.take(tf_message(transform(10, 'base', 'arm', *here))) is None
    assert "no frame 'tool' in /tf; frames are arm, base" in live.why_not
    live.take_static(tf_message(transform(0, 'arm', 'tool', *FIXED)))
    live.take(tf_message(transform(20, 'base', 'arm', *here)))
    found = live.take(tf_message(transform(30, 'base', 'arm', *here)))
    np.testing.assert_allclose(found.values[:3], FIXED[1])
    assert live.take(tf_message(transform(40, 'base', 'camera', *here))) is None
    assert live.take(tf_message(transform(30, 'base', 'arm', *here))) is None, 'twice'
    went_back = live.take(tf_message(transform(-10**10, 'base', 'arm', *here)))
    assert went_back.stamp_ns == -10**10


def test_frames_can_be_named_also_where_both_move(bag):
    pose = read_recording(bag, topics={'pose': 'tf:link1:tool0'}).pose
    last, place = turn(2, pose.t)
    np.testing.assert_allclose(pose.R_base_sensor, (last * FIXED[0]).as_matrix(), atol=2e-4)
    np.testing.assert_allclose(pose.position, last.apply(FIXED[1]) + place, atol=2e-4)
    back = read_recording(bag, topics={'pose': 'tf:tool0:base_link'}).pose
    np.testing.assert_allclose(np.swapaxes(back.R_base_sensor, 1, 2), expected(back.t)[0],
                               atol=2e-4)


@pytest.mark.parametrize('named, why', [
    ('tf:base:tool0', "no frame 'base' in /tf; frames are base_link, camera"),
    ('tf:base_link:camera', 'in different trees'),
    ('tf:link2:tool0', 'no transform between link2 and tool0 moves')])
def test_frames_that_give_no_pose_are_refused_by_name(bag, named, why):
    with pytest.raises(DataError, match=why):
        read_recording(bag, topics={'pose': named})


def test_one_message_of_all_transforms_is_the_pose_of_one_message_each():
    rng, whole, apart = np.random.default_rng(2), *(TransformPose('left', 'tool')
                                                    for _ in range(2))
    links = (('base', 'left'), ('base', 'arm'), ('arm', 'hand'))
    for live in (whole, apart):
        live.take_static(tf_message(transform(0, 'hand', 'tool', *FIXED)))
    found = []
    for n in range(1, 40):
        stamps = [1000 * n] * 3 if n != 20 else [20_000, 20_000, 19_900]
        parts = [transform(stamp, *link, Rotation.from_rotvec(rng.normal(size=3)),
                           rng.normal(size=3)) for stamp, link in zip(stamps, links)]
        if n == 10:
            parts[1].transform.rotation.w = np.nan
        if n == 30:
            parts[2].transform.rotation.x *= 3.0
        both = (whole.take(tf_message(*parts)), [apart.take(tf_message(one)) for one in parts][-1])
        if n not in (1, 10, 20):  # frames are not known yet, a part is no number, one is late
            found.append(both)
    for one, other in found:
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_allclose(one.values, other.values, atol=1e-12)
