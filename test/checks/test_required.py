"""What a command cannot do without, said with the topics that may be meant."""

from bag_samples import header, small_recording, START_NS, STORE, wrench_message, write_messages
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.topics import require
from forcecal_ros.io.bags import read_recording, write_recording
import pytest


def wrenches(topic):
    return [(topic, START_NS + i, wrench_message(START_NS + i, [1.0] * 6)) for i in range(1, 5)]


def poses(topic):
    types = STORE.types
    pose = types['geometry_msgs/msg/Pose'](
        types['geometry_msgs/msg/Point'](0.0, 0.0, 0.0),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0))
    stamped = types['geometry_msgs/msg/PoseStamped']
    return [(topic, START_NS + i, stamped(header(START_NS + i), pose)) for i in range(1, 5)]


def refusal(path, roles):
    with pytest.raises(DataError) as refused:
        require(read_recording(path), roles)
    return str(refused.value)


def test_all_that_is_missing_is_named_and_what_is_there_is_not(tmp_path):
    write_messages(tmp_path / 'bag', wrenches('/wrench'))
    require(read_recording(tmp_path / 'bag'), ['wrench'])
    assert refusal(tmp_path / 'bag', ['wrench', 'pose', 'phase']) == (
        f'{tmp_path}/bag: no messages of current_pose (pose), sequencer/phase (phase); '
        'record current_pose and record sequencer/phase')


def test_the_one_topic_that_can_be_meant_is_offered(tmp_path):
    write_messages(tmp_path / 'bag', [*wrenches('/wrench'), *poses('/tcp_pose_broadcaster/pose')])
    assert refusal(tmp_path / 'bag', ['pose']).endswith(
        '; select its topic with --topic pose=/tcp_pose_broadcaster/pose')
    with pytest.raises(DataError, match='--topic pose=/tcp_pose_broadcaster/pose'):
        identify(read_recording(tmp_path / 'bag'))


def test_of_several_one_is_to_be_chosen_and_none_that_is_in_use(tmp_path):
    names = [f'/arm_{i}/ft' for i in range(8)]
    write_messages(tmp_path / 'bag', [
        *poses('/current_pose'), *wrenches('/sim/contact_wrench'),
        *(message for name in names for message in wrenches(name))])
    said = refusal(tmp_path / 'bag', ['wrench'])
    assert said.endswith('--topic wrench=NAME, one of /arm_0/ft, /arm_1/ft, /arm_2/ft, /arm_3/ft, '
                         '/arm_4/ft, /arm_5/ft and 2 more')
    assert 'contact_wrench' not in said and 'current_pose' not in said


def test_what_is_there_under_its_usual_name_leaves_nothing_to_choose(tmp_path):
    write_recording(tmp_path / 'bag', small_recording())
    assert not set(read_recording(tmp_path / 'bag').candidates) & {'wrench', 'pose', 'target'}
