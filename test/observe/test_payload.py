"""Mass and centre of mass followed along: a payload is heard of and known, a push is not one."""

from dataclasses import replace
import json
from typing import Any

from forcecal_ros.calibrate.delay import estimate_delay, with_delay
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.io.bags import write_recording
from forcecal_ros.io.calibration_file import save
from forcecal_ros.observe import design
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.payload import (
    begin,
    Block,
    estimate,
    FROZEN,
    NOT_EXCITED,
    on_block,
    payload_model,
    TRACKING,
)
from forcecal_ros.observe.playback import events, follow
from forcecal_ros.observe.tracker import Tracker
import gravity_arm as arm
from kuka import kuka_recording, static_calibration
from longer import first
import numpy as np
from observing import calibration
from payloads import after, at_point, laid_on, on_the_rig, PUSHES, TURNS, weight
import pytest
from rosbags.highlevel import AnyReader

HEARD, KNOWN = 1.0, 10.0
"""Within these a payload is to be heard of, and its mass known to 1 % [s]."""

EVERY = 50
"""Samples of a block."""


@pytest.fixture(scope='module')
def hand():
    """Return the arm's calibration as the tracker wants it."""
    return payload_model(arm.calibrate(np.random.default_rng(1))[0])


def blocks(moving, contact, seed=0):
    """Return what the arm's exact motion and noisy sensor make block by block."""
    noise = np.repeat([arm.FORCE_NOISE, arm.TORQUE_NOISE], 3)
    wrench = arm.true_load(moving) + arm.BIAS + contact
    wrench += np.random.default_rng(seed).normal(0, noise, wrench.shape)
    f = arm.specific_force(moving, np.zeros(3))
    down = np.einsum('nji,j->ni', moving.R_base_sensor, arm.G)
    for i in range(0, len(moving.t) - EVERY, EVERY):
        part = slice(i, i + EVERY)
        yield Block(moving.t[i + EVERY - 1], EVERY / arm.RATE, wrench[part].mean(axis=0),
                    noise ** 2 / EVERY, f[part].mean(axis=0), down[part].mean(axis=0),
                    moving.omega[part].mean(axis=0), moving.alpha[part].mean(axis=0), 0.0)


def followed(model, moving, contact, seed=0):
    state, found = begin(model), []
    for block in blocks(moving, contact, seed):
        state = on_block(state, block, model)
        found.append(estimate(state, model))
    return state, found


def swinging(seed, seconds=16.0):
    return arm.free_motion(np.random.default_rng(seed), seconds)


@pytest.mark.parametrize('load', first([0.06, -0.2, 1.2]))
def test_a_payload_is_heard_of_and_known(hand, load):
    moving = swinging(5)
    state, found = followed(hand, moving, weight(moving, load, 4.0))
    assert all(one.state == TRACKING for one in found if one.t < 4.0)
    assert next(one.t for one in found if one.suspected == one.suspected) < 4.0 + HEARD
    change, = state.changes
    assert change.t < 4.0 + KNOWN
    assert change.inert == (abs(load) > 0.1)
    last = found[-1]
    assert last.state == TRACKING
    assert last.mass == pytest.approx(arm.MASS + load, rel=0.01)
    com = (arm.MASS * arm.COM + load * np.array([0.02, 0.0, 0.12])) / (arm.MASS + load)
    # the calibration's own error of the place, 0.1 mm, comes on top
    assert (np.abs(last.com - com) < 4 * last.com_std + 2e-4).all()


@pytest.mark.parametrize('push', first((name for name in PUSHES if name != 'none'), 2))
def test_a_push_is_no_payload(hand, push):
    moving = swinging(6)
    force = PUSHES[push](moving, np.random.default_rng(7), 3.0) * after(moving.t, 4.0)
    state, found = followed(hand, moving, at_point(force))
    assert state.changes == ()
    assert found[-1].mass == pytest.approx(arm.MASS, rel=0.005)
    assert all(one.state != TRACKING for one in found if one.t > 4.0 + HEARD)


def test_a_light_steady_push_straight_down_is_a_weight_and_said_not_to_be_inert(hand):
    moving = swinging(6)
    force = PUSHES['steady, straight down'](moving, None, 0.5) * after(moving.t, 4.0)
    state, _ = followed(hand, moving, at_point(force))
    assert [change.inert for change in state.changes] == [False]
    assert state.changes[0].mass == pytest.approx(0.5 / 9.81, abs=0.01)


def test_a_payload_is_known_again_after_a_push(hand):
    moving = swinging(8, 20.0)
    hit = PUSHES['hand-guided'](moving, np.random.default_rng(7), 5.0)
    between = after(moving.t, 2.0) * (moving.t < 6.0)[:, np.newaxis]
    _, found = followed(hand, moving, at_point(hit * between) + weight(moving, 0.3, 4.0))
    assert found[-1].state == TRACKING
    assert found[-1].mass == pytest.approx(arm.MASS + 0.3, rel=0.01)


def test_without_rotation_nothing_is_taken_for_a_payload(hand):
    moving = arm.resting(np.array([[0.3, 0.2, 0.933]]), 12.0)
    state, found = followed(hand, moving, weight(moving, 0.3, 4.0))
    assert state.changes == () and found[-1].state == NOT_EXCITED
    assert found[-1].suspected_std > 0.1


def test_a_weight_that_hangs_there_from_the_start_is_found_out(hand):
    moving = swinging(9)
    state, carried = begin(hand), weight(moving, 0.3)
    for block in blocks(moving, carried):
        state = on_block(state, block, hand)
    found = estimate(state, hand)
    assert found.state == TRACKING and found.mass == pytest.approx(arm.MASS + 0.3, rel=0.01)


def test_readings_that_say_nothing_are_not_called_tracking():
    known = calibration()
    tracker = Tracker(payload_model(known))
    assert tracker.estimate.state == FROZEN
    recording = on_the_rig(0.0, parts=TURNS[:1])[0]
    live = LiveObserver(0.5, 0.5)
    live.take_over(design(known))
    live.tracker = tracker
    said = []
    for t, kind, values in events(recording):
        if kind == 'wrench':
            live.on_wrench(t, values)
        elif kind == 'accelerometer':
            live.on_accelerometer(t, values)
        elif kind == 'pose' and t < 0.8:
            live.on_pose(t, values)
        said.append((t, tracker.estimate.state))
    assert {word for t, word in said if 0.2 < t < 0.8} == {TRACKING}
    assert said[-1][1] == FROZEN and tracker.news() is None


@pytest.fixture(scope='module')
def loaded():
    return on_the_rig(1.0, start=2.0, parts=TURNS[:5])


def test_on_the_rig(loaded):
    rig = calibration()
    recording, mass, com = loaded
    result = follow(recording, rig)
    assert next(one.t for one in result.tools if one.state != TRACKING) < 2.0 + HEARD
    last = result.tools[-1]
    assert last.mass == pytest.approx(mass, rel=0.01)
    np.testing.assert_allclose(last.com, com, atol=2e-3)
    settled = result.contact.t > result.announced[-1].t + 1.0
    assert settled.sum() > 1000
    # the payload is no contact any more: 1 % of the weight
    assert np.abs(result.contact.contact[settled, :3].mean(axis=0)).max() < 1.4
    with pytest.raises(UnobservableError, match='no pose'):
        follow(replace(recording, pose=None), rig)


def test_estimate_writes_the_tool_and_says_what_changed(loaded, tmp_path, capsys):
    recording, mass, com = loaded
    write_recording(tmp_path / 'bag', replace(recording, contact_truth=None))
    save(calibration(), tmp_path / 'c.yaml')
    assert main(['estimate', str(tmp_path / 'bag'), '--calibration', str(tmp_path / 'c.yaml'),
                 '--track-tool', '--json', '-o', str(tmp_path / 'out')]) == 0
    tool = json.loads(capsys.readouterr().out)['tool']
    assert tool['state'] == 'tracking' and tool['mass'] == pytest.approx(mass, rel=0.01)
    change, = tool['changes']
    assert 2.0 < change['t'] < 2.0 + KNOWN and change['mass'] == pytest.approx(1.0, abs=0.14)
    assert sum(tool['share'].values()) == pytest.approx(1.0)
    with AnyReader([tmp_path / 'out']) as reader:
        connection, = (one for one in reader.connections if one.topic == '/observer/tool')
        told: list[Any] = [reader.deserialize(data, connection.msgtype)
                           for _, _, data in reader.messages([connection])]
    assert told[0].inertia.m == 13.0 and told[-1].header.frame_id == 'ft_sensor'
    assert told[-1].inertia.m == pytest.approx(mass, rel=0.01)
    assert told[-1].inertia.com.x == pytest.approx(com[0], abs=2e-3)
    assert told[-1].inertia.iyy == 0.15


@pytest.fixture(scope='module')
def real(kuka_data):
    known, free = static_calibration(kuka_data), kuka_recording(kuka_data, '1-baseline')
    return with_delay(known, estimate_delay(free, known)), free


@pytest.mark.parametrize('start', first([0.3, 1.0, 2.5]))
def test_sixty_grams_on_a_real_arm(real, start):
    known, free = real
    point = np.array([0.02, 0.0, 0.08])
    result = follow(laid_on(free, known, 0.06, point, start), known)
    heard = next(one.t for one in result.tools if one.state != TRACKING)
    assert start < heard < start + HEARD
    last, mass = result.tools[-1], float(known.mass) + 0.06
    assert last.state == TRACKING and last.mass == pytest.approx(mass, rel=0.01)
    com = (float(known.mass) * known.com.value + 0.06 * point) / mass
    np.testing.assert_allclose(last.com, com, atol=1.5e-3)


@pytest.mark.long
def test_a_real_arm_that_carries_nothing_and_is_touched_keeps_its_mass(kuka_data, real):
    known, free = real
    result = follow(free, known)
    assert all(one.state == TRACKING for one in result.tools) and result.changes == ()
    np.testing.assert_allclose([one.mass for one in result.tools], float(known.mass), rtol=0.01)
    touched = follow(kuka_recording(kuka_data, '3-vibrations-contact'), known)
    assert touched.changes == ()
    assert all(one.state == FROZEN for one in touched.tools if 0.8 < one.t < 4.1)
