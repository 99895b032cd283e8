"""A replay of commands: what it remembers, and how much memory that takes."""

from dataclasses import replace
import tracemalloc

from forcecal_ros.effects import with_effects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.replay import Replay
import numpy as np
import pytest
from rig_recordings import FREE, own_recording

RIG = load_rig()


def replay():
    target = own_recording(5, FREE).target
    return Replay(RIG, target, float(target.t[0]), float(target.t[-1]), 'acc1')


def test_signals_are_the_same_whatever_was_simulated_in_between():
    one = replay()
    heavier = replace(RIG, tool=replace(RIG.tool, mass=1.1 * RIG.tool.mass))
    later = with_effects(RIG, {'robot_delay': {'delay': 0.003}})
    first = one.signals(RIG)
    wrench, position = first.wrench.copy(), first.position.copy()
    assert not np.array_equal(one.signals(heavier).wrench, wrench)
    assert not np.array_equal(one.signals(later).position, position)
    again = one.signals(RIG)
    assert np.array_equal(again.wrench, wrench)
    assert np.array_equal(again.position, position)


@pytest.mark.long
def test_no_more_is_kept_than_the_last_motion_and_the_last_signals():
    tracemalloc.start()
    one = replay()
    before = tracemalloc.get_traced_memory()[0]
    for mass in (1.0, 1.1, 1.2):
        one.signals(replace(RIG, tool=replace(RIG.tool, mass=mass)))
    for delay in (0.002, 0.003):
        one.signals(with_effects(RIG, {'robot_delay': {'delay': delay}}))
    kept = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    # numbers of 8 bytes: 24 of motion at two nodes a millisecond; wrench, contact, specific force,
    # slide and its speed at one
    assert kept < 1.1 * 8 * (2 * 24 + 17) * 4 * one.n_blocks
