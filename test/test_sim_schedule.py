"""Which command acts in which robot period, live."""

from forcecal_ros.sim.schedule import CommandSchedule
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

PERIOD = 4_000_000
START = 1_000_000_000


def played(stamps, arrivals=None, latency=2 * PERIOD):
    """Return which command each period took, simulated ``latency`` after it began."""
    schedule, taken, arrivals = CommandSchedule(PERIOD, START), [], arrivals or stamps
    waiting = sorted(zip(arrivals, stamps, range(len(stamps))))
    last = max(arrivals)
    for k in range((last - START) // PERIOD + 4):
        now = START + k * PERIOD + latency
        while waiting and waiting[0][0] <= now:
            arrival, stamp, name = waiting.pop(0)
            schedule.add(stamp, arrival, k, name)
        taken.append(schedule.take(k))
    return taken, schedule


def test_a_command_acts_in_the_first_period_that_begins_at_its_stamp_or_later():
    taken, _ = played([START + 8 * PERIOD, START + 20 * PERIOD + 1])
    assert [k for k, name in enumerate(taken) if name is not None] == [8, 21]


@settings(max_examples=100, deadline=None)
@given(phase=st.integers(0, PERIOD - 1),
       jitter=st.lists(st.integers(-PERIOD // 5, PERIOD // 5), min_size=10, max_size=60))
def test_jitter_of_the_stamps_neither_drops_nor_doubles_a_command(phase, jitter):
    stamps = [START + 5 * PERIOD + phase + i * PERIOD + d for i, d in enumerate(jitter)]
    taken, schedule = played(stamps)
    acted = [(k, name) for k, name in enumerate(taken) if name is not None]
    assert [name for _, name in acted] == list(range(len(stamps)))
    first = acted[0][0]
    assert [k for k, _ in acted] == list(range(first, first + len(stamps)))
    assert schedule.late == 0


@settings(max_examples=100, deadline=None)
@given(delays=st.lists(st.integers(0, 2 * PERIOD), min_size=5, max_size=60))
def test_delays_within_the_latency_change_nothing(delays):
    stamps = [START + (5 + i) * PERIOD for i in range(len(delays))]
    arrivals = []
    for stamp, delay in zip(stamps, delays):
        arrivals.append(max([stamp + delay, *arrivals[-1:]]))
    taken, schedule = played(stamps, arrivals)
    undelayed = played(stamps)[0]
    assert taken[:len(undelayed)] == undelayed
    assert schedule.late == 0


def test_a_late_command_acts_in_the_next_period_and_counts():
    taken, schedule = played([START + 5 * PERIOD], [START + 9 * PERIOD])
    assert [k for k, name in enumerate(taken) if name is not None] == [7]
    assert schedule.late == 1


@pytest.mark.parametrize('stamp', [0, START - 10**9, START + 10**12])
def test_a_stamp_of_another_clock_counts_as_now(stamp):
    taken, schedule = played([stamp], [START + 5 * PERIOD])
    assert [k for k, name in enumerate(taken) if name is not None] == [5]
    assert schedule.late == 0


def test_of_two_commands_for_one_period_the_newer_counts():
    taken, _ = played([START + 5 * PERIOD - 2, START + 5 * PERIOD - 1,
                       START + 5 * PERIOD])
    acted = [(k, name) for k, name in enumerate(taken) if name is not None]
    assert acted[-1][1] == 2 and acted[-1][0] <= 7
