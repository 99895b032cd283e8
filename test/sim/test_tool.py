"""Claims about the tool on its slide and about contact, from mechanics on paper."""

from dataclasses import replace

from forcecal_ros.core.geometry import rotation_about
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.plant import kernel_parameters
from forcecal_ros.sim.rig.robot import Motion
from forcecal_ros.sim.rig.tool import Slide, slide_along, tool_at_rest
import numpy as np
import pytest

RIG = load_rig()
AIM = RIG.home.R_base_sensor
AWAY, GAP = np.array([1.0, 0.0, 1.0]), 0.08  # [m] tip to wall there


def changed(rig=RIG, **sections):
    return replace(rig, **{name: replace(getattr(rig, name), **values)
                           for name, values in sections.items()})


def held(n, position=AWAY, R_base_sensor=AIM):
    """Motion of an S that does not move, n steps."""
    motion = Motion(*(np.zeros_like(part) for part in Motion.empty(2 * n + 1)))
    motion.position[:], motion.R_base_sensor[:] = position, R_base_sensor
    return motion


def approaching(n, h, depth):
    """S goes a fraction of a mm into the wall and out again, several times, ever deeper."""
    motion, t = held(n), 0.5 * h * np.arange(2 * n + 1)
    w = 2.0 * np.pi * 3.0
    motion.position[:, 0] += GAP + depth * t * np.sin(w * t)
    motion.velocity[:, 0] = depth * (np.sin(w * t) + w * t * np.cos(w * t))
    motion.acceleration[:, 0] = depth * w * (2.0 * np.cos(w * t) - w * t * np.sin(w * t))
    return motion


def slid(rig, motion, h, slide=None, speed=0.0):
    """Let the tool slide from rest, or from a given state."""
    p = kernel_parameters(rig)[()]
    state = tool_at_rest(p, motion.position[0], motion.R_base_sensor[0])
    if slide is not None:
        state['slide'], state['speed'] = slide, speed
    out = Slide.empty(len(motion.position) // 2 + 1)
    slide_along(p, state[0], motion, h, out)
    return out


def test_tilted_tool_rests_in_contact_where_forces_along_the_slide_balance():
    tilted = AIM @ rotation_about('y', np.radians(20.0))
    tip = tilted @ np.array(RIG.tool.tip)
    position = np.array([1.28 - tip[0] + 0.02, 0.0, 1.0])
    out = slid(RIG, held(2000, position, tilted), 1e-3)
    weight = 13.0 * (tilted[:, 0] @ np.array(RIG.gravity))
    balance = weight - 5000.0 * out.slide - out.push * tilted[0, 0]
    assert out.push[0] > 1.0
    assert np.abs(balance).max() < 1e-9
    assert np.abs(np.diff(out.slide)).max() < 1e-15


def test_bouncing_without_damping_keeps_its_energy():
    lossless = changed(optidrive={'damping': 0.0}, wall={'damping': 0.0})
    out = slid(lossless, held(4000, AWAY + [GAP - 0.002, 0.0, 0.0]), 5e-4, slide=-0.01)
    depth = np.maximum(0.0, out.slide - 0.002)
    energy = 0.5 * (13.0 * out.speed ** 2 + 5000.0 * out.slide ** 2 + 10000.0 * depth ** 2)
    assert np.count_nonzero(np.diff(out.push > 0.0)) > 6  # it does bounce
    assert energy == pytest.approx(0.25, rel=1e-6)


def test_wall_pushes_and_never_pulls():
    sticky = changed(wall={'damping': 2000.0})
    out = slid(sticky, approaching(4000, 5e-4, 0.01), 5e-4)
    assert out.push.min() == 0.0
    assert out.push.max() > 10.0


def test_slide_converges_with_the_fourth_power_of_the_step_through_contact_and_release():
    reference = slid(RIG, approaching(32000, 1.0 / 16000, 0.005), 1.0 / 16000)
    assert np.count_nonzero(np.diff(reference.push > 0.0)) > 6
    errors = []
    for n in (1000, 2000, 4000):
        out = slid(RIG, approaching(n, 2.0 / n, 0.005), 2.0 / n)
        errors.append(np.abs(out.slide - reference.slide[::32000 // n]).max())
    assert errors[1] < 1e-8  # [m] at 1 ms; times k: 5e-5 N
    assert errors[0] / errors[1] > 10.0
    assert errors[1] / errors[2] > 10.0


def test_rigid_tool_does_not_slide_but_meets_the_wall():
    rigid = replace(RIG, optidrive=None)
    out = slid(rigid, approaching(2000, 1e-3, 0.01), 1e-3)
    assert not out.slide.any() and not out.speed.any() and not out.acceleration.any()
    t = 1e-3 * np.arange(2001)
    motion = approaching(2000, 1e-3, 0.01)
    depth, rate = motion.position[::2, 0] - AWAY[0] - GAP, motion.velocity[::2, 0]
    expected = np.where(depth > 0.0, np.maximum(0.0, 10000.0 * depth + 50.0 * rate), 0.0)
    clear = np.abs(depth) > 1e-12
    assert t[out.push > 0.0].size > 100
    assert out.push[clear] == pytest.approx(expected[clear], abs=1e-6)
