"""Which command acts in which robot period, live."""

from forcecal_ros.sim.rig.simulator import CommandSchedule
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


@settings(max_examples=40, deadline=None)
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


def test_a_late_command_acts_in_the_next_period_and_counts():
    taken, schedule = played([START + 5 * PERIOD], [START + 9 * PERIOD])
    assert [k for k, name in enumerate(taken) if name is not None] == [7]
    assert schedule.late == 1


@pytest.mark.parametrize('stamp', [0, START - 10**9, START + 10**12])
def test_a_stamp_of_another_clock_counts_as_now(stamp):
    taken, schedule = played([stamp], [START + 5 * PERIOD])
    assert [k for k, name in enumerate(taken) if name is not None] == [5]
    assert schedule.late == 0


@settings(max_examples=40, deadline=None)
@given(stalls=st.lists(st.integers(0, 6 * PERIOD), min_size=5, max_size=60))
def test_late_commands_act_one_after_the_other_and_none_is_dropped(stalls):
    stamps = [START + (5 + i) * PERIOD for i in range(len(stalls))]
    arrivals = []
    for stamp, stall in zip(stamps, stalls):
        arrivals.append(max([stamp + stall, *arrivals[-1:]]))
    taken, _ = played(stamps, arrivals)
    acted = [name for name in taken if name is not None]
    assert acted == list(range(len(acted))) and len(acted) > len(stamps) - 7


def test_a_simulation_that_stalled_takes_the_commands_of_that_time_in_their_periods():
    schedule = CommandSchedule(PERIOD, START)
    for k in range(10, 150):
        schedule.add(START + k * PERIOD, START + 150 * PERIOD, 10, k)
    assert [schedule.take(k) for k in range(10, 150)] == list(range(10, 150))


def test_a_lag_ends_when_the_stream_rests():
    schedule = CommandSchedule(PERIOD, START)
    for k in range(3):
        schedule.add(START + k * PERIOD, START + 5 * PERIOD, 5, k)
    for k in range(3, 20):
        schedule.add(START + k * PERIOD, START + max(5, k) * PERIOD, max(5, k), min(k, 10))
    taken = [schedule.take(k) for k in range(20)]
    assert [name for name in taken if name is not None][:11] == list(range(11))
    assert taken[19] == 10
    for k in range(20, 30):
        schedule.add(START + k * PERIOD, START + k * PERIOD, k, k)
    assert [schedule.take(k) for k in range(20, 30)] == list(range(20, 30))


def test_commands_that_wait_while_time_is_skipped_act_one_after_the_other():
    schedule = CommandSchedule(PERIOD, START)
    for k in range(30):
        schedule.add(START + k * PERIOD, START + 30 * PERIOD, 0, k)
    schedule = schedule.restarted(START + 500 * PERIOD)
    schedule.add(START + 502 * PERIOD, START + 502 * PERIOD, 1, 30)
    taken = [schedule.take(k) for k in range(40)]
    assert [name for name in taken if name is not None] == list(range(31))


def test_faster_commands_than_periods_are_thinned_out_and_never_lag_for_long():
    stamps = [START + 5 * PERIOD + i * PERIOD // 4 for i in range(400)]
    taken, _ = played(stamps)
    acted = [(k, name) for k, name in enumerate(taken) if name is not None]
    lags = [k - 5 - name / 4 for k, name in acted]
    assert max(lags) <= 1.5 and acted[-1][1] == 399
