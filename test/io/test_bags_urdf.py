"""Poses out of joint states and a URDF, as who records no /tf has them."""

from bag_samples import header, START_NS, STORE, wrench_message, write_messages
from forcecal_ros.core.errors import DataError
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.bags.poses import refuse_degrees
from forcecal_ros.io.urdf import Description
from forcecal_ros.nodes.wire import JointsReader
from forcecal_ros.observe.pose_sources import JointPose
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

T = 0.01 * np.arange(100)
INERTIA = ('<inertial><mass value="1"/>'
           '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>')
LINKS = ''.join(f'<link name="{name}">{INERTIA}</link>'
                for name in ('base_link', 'upper', 'slide', 'hand', 'finger', 'ft_sensor'))
ROBOT = f"""<robot name="arm"><mujoco><compiler fusestatic="false"/></mujoco>{LINKS}
<joint name="lift" type="continuous"><parent link="base_link"/><child link="upper"/>
  <origin xyz="0.1 0 0.4" rpy="0.3 -0.2 0.5"/><axis xyz="0 1 0"/></joint>
<joint name="reach" type="prismatic"><parent link="upper"/><child link="slide"/>
  <origin xyz="0 0.2 0"/><axis xyz="1 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="wrist" type="revolute"><parent link="slide"/><child link="hand"/>
  <origin rpy="0 0 1.2"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="finger" type="prismatic"><parent link="hand"/><child link="finger"/>
  <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/>
  <mimic joint="reach" multiplier="-0.5" offset="0.02"/></joint>
<joint name="mount" type="fixed"><parent link="finger"/><child link="ft_sensor"/>
  <origin xyz="0 0.02 0.11" rpy="0.1 -0.2 0.3"/><axis xyz="0 0 0"/></joint>
<transmission name="of_another_program"/></robot>"""
ASIDE = ('<joint name="hung" type="floating"><parent link="upper"/><child link="camera"/></joint>'
         '</robot>')
"""What is not on the way between two links may be anything."""
POSITIONS = {'lift': np.sin(2.0 * T), 'reach': 0.3 * np.cos(T), 'wrist': 1.0 - T,
             'gripper': 0.0 * T}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Joint states in two parts, whose order changes; the description on its topic."""
    messages = [('/robot_description', 10**9, STORE.types['std_msgs/msg/String'](
        ROBOT.replace('</robot>', ASIDE)))]
    for k, t in enumerate(T):
        stamp = 10**9 + round(1e9 * t)
        arm = ('lift', 'wrist', 'reach') if k % 2 else ('reach', 'lift', 'wrist')
        messages += [('/joint_states', stamp, joint_states(
            stamp, names, [POSITIONS[name][k] for name in names]))
            for names in (arm, ('gripper',))]
    return write_messages(tmp_path_factory.mktemp('urdf') / 'bag', messages)


def joint_states(stamp, names, positions):
    return STORE.types['sensor_msgs/msg/JointState'](
        header(stamp, ''), list(names), np.array(positions), np.empty(0), np.empty(0))


def by_mujoco(body, base):
    """Position and rotation of one link in another, by another program that reads URDF."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(ROBOT)
    data = mujoco.MjData(model)
    places, rotations = [], []
    for k in range(len(T)):
        for joint, told in (('lift', POSITIONS['lift']), ('reach', POSITIONS['reach']),
                            ('wrist', POSITIONS['wrist']),
                            ('finger', 0.02 - 0.5 * POSITIONS['reach'])):
            data.joint(joint).qpos[0] = told[k]
        mujoco.mj_kinematics(model, data)
        R, p = data.body(base).xmat.reshape(3, 3), data.body(base).xpos
        places.append(R.T @ (data.body(body).xpos - p))
        rotations.append(R.T @ data.body(body).xmat.reshape(3, 3))
    return np.array(places), np.array(rotations)


@pytest.mark.parametrize('base, link', [
    ('upper', 'ft_sensor'), ('ft_sensor', 'upper'), ('slide', 'finger')])
def test_the_pose_is_that_of_another_program(bag, base, link):
    pose = read_recording(bag, {'pose': f'urdf:/robot_description:{base}:{link}'}).pose
    place, rotation = by_mujoco(link, base)
    np.testing.assert_allclose(pose.position, place, atol=1e-9)
    np.testing.assert_allclose(pose.R_base_sensor, rotation, atol=1e-9)
    assert pose.frame == base and pose.of == link
    np.testing.assert_allclose(pose.t, T, atol=1e-9)


def test_joints_with_limits_in_degrees_are_refused():
    description = Description(ROBOT.encode(), 'arm')
    wrist, lift = (description.joint(link) for link in ('hand', 'upper'))
    wheel = POSITIONS | {'lift': 50.0 * POSITIONS['lift']}
    refuse_degrees([wrist, lift], wheel, '/joint_states')
    with pytest.raises(DataError, match='/joint_states: joint wrist .* are in degrees; publish'):
        refuse_degrees([wrist], {'wrist': np.degrees(POSITIONS['wrist'])}, '/joint_states')


def test_a_file_describes_the_robot_as_well_as_a_topic(bag, tmp_path):
    (tmp_path / 'arm.urdf').write_text(ROBOT)
    one, other = (read_recording(bag, {'pose': f'urdf:{source}:base_link:ft_sensor'}).pose
                  for source in ('/robot_description', tmp_path / 'arm.urdf'))
    assert np.array_equal(one.position, other.position) and np.ptp(one.position, axis=0).min() > 0


def test_two_arms_joint_states_are_ambiguous_only_to_who_wants_them(tmp_path):
    wrenches = [('/wrench', START_NS + i, wrench_message(START_NS + i, [1.0] * 6))
                for i in range(1, 5)]
    states = [(f'/{arm}/joint_states', START_NS + i, joint_states(START_NS + i, ['lift'], [0.0]))
              for arm in 'ab' for i in range(1, 5)]
    write_messages(tmp_path / 'bag', [*wrenches, *states])
    assert len(read_recording(tmp_path / 'bag').wrench) == 4
    for wanting in ({'topics': {'pose': 'urdf:x.urdf:base_link:hand'}}, {'joints': True}):
        with pytest.raises(DataError, match='could be joint_states: /a/joint_states, /b/joint_s'):
            read_recording(tmp_path / 'bag', **wanting)


def test_stamps_of_zero_and_nan_are_dealt_with_as_of_any_topic(tmp_path):
    logged = [('/joint_states', START_NS + 10**7 * i, joint_states(
        0, ['lift', 'reach', 'wrist'], [0.01 * i if i != 5 else np.nan, 0.1, 0.2]))
        for i in range(1, 20)]
    write_messages(tmp_path / 'bag', logged)
    (tmp_path / 'arm.urdf').write_text(ROBOT)
    recording = read_recording(tmp_path / 'bag', {
        'pose': f'urdf:{tmp_path}/arm.urdf:base_link:ft_sensor'})
    assert '/joint_states: header stamps are zero; the recording times were used instead' in (
        recording.notes)
    assert any('1 messages without stamp or' in note for note in recording.notes)
    assert len(recording.pose) == 19 and np.isfinite(recording.pose.position).all()
    np.testing.assert_allclose(np.diff(recording.pose.t), 0.01, atol=1e-9)


@pytest.mark.parametrize('named, why', [
    ('urdf:/robot_description:base_link', 'expected urdf:FILE:BASE:LINK'),
    ('urdf:nowhere.urdf:base_link:hand', r'nowhere.urdf: not a readable file \(No such file'),
    ('urdf:/robot_description:base_link:tool0', "no frame 'tool0' in /robot_description; frames"),
    ('urdf:/robot_description:finger:ft_sensor', 'between finger and ft_sensor in .* moves')])
def test_what_gives_no_pose_is_refused_by_name(bag, named, why):
    with pytest.raises(DataError, match=why):
        read_recording(bag, {'pose': named})


@pytest.mark.parametrize('change, why', [
    (('type="continuous"', 'type="floating"'), 'joint lift is floating'),
    (('<axis xyz="1 0 1"/>', '<axis xyz="0 0 0"/>'), 'joint reach: its axis is zero'),
    (('rpy="0 0 1.2"', 'rpy="0 0 ${pi}"'), r"joint wrist: rpy is '0 0 \$\{pi\}'; expected 3 num"),
    (('<robot', '<!DOCTYPE robot [<!ENTITY a "aa">]><robot'), 'it defines XML entities'),
    ((ROBOT, '<robot><link name="a"/></robot>'), 'not a URDF with joints'),
    (('</robot>', ''), 'not valid XML'), (('robot>', 'sdf>'), 'not valid XML'),
    (('"wrist"', '"elbow"'), 'has no joint elbow; its joints are gripper, lift, reach, wrist')])
def test_descriptions_that_cannot_be_computed_are_refused(bag, tmp_path, change, why):
    assert change[0] in ROBOT
    (tmp_path / 'arm.urdf').write_text(ROBOT.replace(*change))
    with pytest.raises(DataError, match=why):
        read_recording(bag, {'pose': f'urdf:{tmp_path}/arm.urdf:base_link:ft_sensor'})


@pytest.mark.parametrize('base, link', [
    ('base_link', 'ft_sensor'), ('ft_sensor', 'upper'), ('slide', 'finger')])
def test_a_node_computes_the_same_poses_message_by_message(bag, base, link):
    offline = read_recording(bag, {'pose': f'urdf:/robot_description:{base}:{link}'}).pose
    live = JointPose(Description(ROBOT.encode(), 'arm.urdf'), base, link, 'pose', 'arm.urdf')
    read = JointsReader(live.drivers)
    with Reader(bag) as reader:
        heard = [raw for connection, _, raw in reader.messages()
                 if connection.topic == '/joint_states']
    found = [pose for raw in heard if (pose := live.take(*read(raw))) is not None]
    values = np.array([pose.values for pose in found])
    assert len(heard) == 2 * len(found) == 2 * len(T)
    np.testing.assert_allclose([pose.stamp_ns for pose in found], 1e9 + 1e9 * T, atol=1)
    np.testing.assert_allclose(values[:, :3], offline.position, atol=1e-12)
    np.testing.assert_allclose(Rotation.from_quat(values[:, 3:]).as_matrix(),
                               offline.R_base_sensor, atol=1e-12)
