"""The observer and what hangs on the sensor: tracked, told by others, and taken off."""

from forcecal_ros.core.errors import DataError
from forcecal_ros.io.calibration_file import save
from forcecal_ros.nodes.messages import read_tool
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.observe.playback import follow
from geometry_msgs.msg import InertiaStamped
from live import Live
import numpy as np
from observing import calibration
from payloads import on_the_rig, TURNS
from playing import Player
import pytest
from visualization_msgs.msg import Marker, MarkerArray


def tool(mass=14.0, frame='ft_sensor', inertia=0.0):
    message = InertiaStamped()
    message.header.frame_id = frame
    message.inertia.m, message.inertia.com.z = mass, 0.1
    message.inertia.ixx = message.inertia.iyy = message.inertia.izz = inertia
    return message


@pytest.mark.parametrize(('wrong', 'words'), [
    (tool(frame='tool0'), "is 'tool0', expected 'ft_sensor'"), (tool(mass=0.0), 'mass 0.0 kg'),
    (tool(mass=float('nan')), 'mass nan kg'), (tool(inertia=-1.0), 'is not physical')])
def test_what_is_no_tool_is_refused_in_one_line(wrong, words):
    with pytest.raises(DataError, match=words) as error:
        read_tool(wrong, 'ft_sensor')
    assert '\n' not in str(error.value) and 'is ignored' in str(error.value)


def test_an_inertia_that_is_not_given_stays_as_calibrated():
    assert read_tool(tool(frame=''), 'ft_sensor').inertia is None
    assert read_tool(tool(inertia=float('nan')), 'ft_sensor').inertia is None
    np.testing.assert_array_equal(read_tool(tool(inertia=0.2), 'ft_sensor').inertia,
                                  0.2 * np.eye(3))


def test_a_tracked_tool_is_published_and_taken_by_those_who_want_it(ros_domain, tmp_path):
    save(calibration(), tmp_path / 'c.yaml')
    recording, mass, _ = on_the_rig(1.0, start=1.0, parts=TURNS[:2])
    expected = follow(recording, calibration()).announced[-1]
    names = ('tracking', 'told')
    with Live() as live:
        heard = live.latched(InertiaStamped, 'observer/tool')
        drawn = []
        live.node.create_subscription(MarkerArray, 'tracking/markers', drawn.append, OUTPUT)
        player = Player(live, names)
        for name in names:
            live.start('observer', name, [
                f'__node:={name}', '~/tool:=observer/tool'],
                calibration__file=tmp_path / 'c.yaml', tool='tracked',
                payload__track='true' if name == 'tracking' else 'false')
        player.until_heard()
        live.until(lambda: all(live.diagnostics.get(name) and live.diagnostics[name].message
                               != 'not active' for name in names), 'active')
        assert {pair.key for pair in live.diagnostics['told'].values} >= {'mass subtracted [kg]'}
        stamps = player.play(recording)
        live.until(lambda: len(player.answers) >= len(stamps) - 5, 'all answers')

        def taken(name):
            return {pair.key: pair.value for pair in live.diagnostics[name].values}

        live.until(lambda: all(float(taken(name)['mass subtracted [kg]']) == pytest.approx(
            expected.mass, rel=3e-3) for name in names), 'the tracked tool')
        assert taken('tracking')['tool tracking'] == 'tracking'
        # this test and the other observer: the one that tracks does not listen to itself
        assert live.node.count_subscribers('observer/tool') == 2
        assert all(result.successful for result in live.set('told', tool=''))
        live.until(lambda: taken('told')['mass subtracted [kg]'] == '13', 'the calibrated tool')
    # while the payload was not known yet its weight was a contact, drawn 20 times a second at most
    arrows = [marker for array in drawn for marker in array.markers
              if marker.ns == 'contact force' and marker.action == Marker.ADD]
    assert arrows and len(drawn) < 2 * 20 * recording.wrench.t[-1]
    assert all(arrow.header.frame_id == 'ft_sensor' for arrow in arrows)
    assert heard[0].inertia.m == 13.0 and heard[0].header.frame_id == 'ft_sensor'
    assert heard[-1].inertia.m == pytest.approx(expected.mass, rel=3e-3)
    assert heard[-1].inertia.m == pytest.approx(mass, rel=0.01)
    rest = [stamp for stamp in stamps[-500:] if stamp in player.heard['tracking']]
    for name in names:
        contact = np.array([player.heard[name][stamp] for stamp in rest])
        assert len(contact) > 400
        assert np.abs(contact[:, :3].mean(axis=0)).max() < 1.4, name
