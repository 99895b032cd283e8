"""``forcecal init`` while a driver runs: its topics, frame and present pose."""

from forcecal_ros.cli.main import main
from geometry_msgs.msg import PoseStamped, WrenchStamped
from live import Live
import numpy as np
import yaml


def test_a_running_driver_fills_topics_frame_and_pose(ros_domain, tmp_path, capfd):
    path = tmp_path / 'my_cell.yaml'
    with Live() as live:
        live.start('sim', remap=['wrench:=ft/data'])
        heard = []
        live.hear(PoseStamped, 'current_pose', lambda *sample: heard.append(sample))
        live.node.create_publisher(WrenchStamped, 'other/ft', 1)
        live.until(lambda: heard, 'a pose')
        assert main(['init', '--preset', 'ur', '--timeout', '4', '-o', str(path)]) == 0
    said = capfd.readouterr()
    # of the type of the pose there is one, the command aside; of that of the wrench two
    assert 'current_pose:=/current_pose' in said.out and 'wrench:=' not in said.out
    assert 'Choose one of /ft/data, /other/ft by wrench:=NAME.' in said.err
    comment = ' '.join(path.read_text().replace('# ', '').split())
    assert 'Choose one of /ft/data, /other/ft by wrench:=NAME.' in comment
    assert 'Received: current_pose in base.' in comment
    sequencer = yaml.safe_load(path.read_text())['/**/sequencer']['ros__parameters']
    assert sequencer['motion']['frame'] == 'base'
    assert sequencer['joints']['names'][0] == 'shoulder_pan_joint'
    middle = np.mean([sequencer['limits'][f'workspace_{end}'] for end in ('min', 'max')], axis=0)
    for end, tip in (('min', np.less), ('max', np.greater)):
        assert tip(sequencer['limits'][f'workspace_{end}'],
                   np.add(heard[0][1][:3], sequencer['limits']['tip'])).all()
    marked = [line.split(':')[0].strip() for line in path.read_text().splitlines()
              if line.endswith('# SET')]
    assert marked == ['backend', 'names', 'values', 'workspace_min', 'workspace_max', 'tip',
                      'force', 'torque']
    np.testing.assert_allclose(middle, np.array(heard[0][1][:3]), atol=0.01)
