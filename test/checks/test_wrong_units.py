"""Units that inertia tells, and kinds of wrong logs that other seeds had hidden."""

from dataclasses import replace

from changed import with_values
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.hypotheses import judge, torque_units_of
from forcecal_ros.checks.signals import clipped
from forcecal_ros.core.errors import DataError
from forcecal_ros.io.bags.header_stamps import usable_stamps
from longer import first
import numpy as np
import pytest
from static_sets import static_set
from wrong_recordings import COM, log, RECEIVED, recording_of, work, WRONG

DOWN = np.array([0.0, 0.0, -9.80665])


def spoilt(name, one):
    return recording_of(WRONG[name].make(one, np.random.default_rng(5)))


@pytest.mark.parametrize('column, factor, said', [
    (3, 1e3, 'torques are in N mm'), (3, 1e2, 'torques are in N cm'),
    (3, 8.8507, 'torques are in lbf in'), (3, 1e-3, 'torques are in kN m'),
    (0, 1 / 9.80665, 'forces are in kgf .* and its torques in N m'),
    (0, 1 / 4.4482, 'forces are in lbf'), (0, 1e3, 'forces are in mN'),
    (0, 1e-3, 'forces are in kN')])
def test_levers_in_another_unit_are_told_by_inertia(column, factor, said):
    recording = recording_of(log(1, hold=2.0, move=1.2, rate=100.0))
    factors = np.where(np.arange(6) // 3 == column // 3, factor, 1.0)
    with pytest.raises(DataError, match=said):
        judge(with_values(recording, lambda values: values * factors), DOWN)


def test_another_point_is_no_other_unit():
    for shown in (COM - [0.0, 0.0, 0.15], COM, np.zeros(3)):
        assert not torque_units_of(shown, COM, 3e-9 * np.eye(3), np.zeros((3, 3)), True)


@pytest.mark.parametrize('seed', first([5, 29, 101, 137], 2))
def test_counts_that_wrap_beside_noise_or_once_are_refused(seed):
    with pytest.raises(DataError, match='counts overflow'):
        checked(spoilt('a channel of 16 bits wraps', log(seed)))


def test_spikes_a_tare_and_joined_poses_do_not_wrap():
    one = log(5)
    rng, wrench = np.random.default_rng(5), one.wrench.copy()
    for i in range(500, len(wrench) - 500, 997):
        wrench[i:i + 3, 2] = 80.0 * rng.choice([-1, 1])
    checked(recording_of(replace(one, wrench=wrench)))
    tared = one.wrench - np.where(one.t[:, None] > 30.0, one.wrench[6000], 0.0)
    checked(recording_of(replace(one, wrench=tared)))
    checked(static_set(0, 100.0)[0])


def test_zeros_of_a_dead_band_are_no_limit_and_do_not_stick():
    recording = checked(spoilt('dead band of 2 N', log(301, rate=500.0)))
    assert any('dead band' in note for note in recording.notes)
    assert not [stop for stop in clipped(recording) if stop.limit == 0.0]


@pytest.mark.parametrize('rate', [50.0, 200.0])
def test_rounded_stamps_give_way_to_times_of_recording_of_any_clock(rate):
    one = WRONG['stamps of single precision, since boot'].make(work(402, rate=rate), None)
    stamps, note = usable_stamps('wrench', one.stamp, RECEIVED(one.t), one.wrench)
    assert 'stamps have a resolution of 7.81 ms' in note
    assert np.ptp(np.diff(stamps)) < 1000
    assert abs(np.median(stamps - 65_536.0e9 - 1e9 * one.t)) < 4e6


def test_regular_stamps_are_no_rounded_ones():
    t = np.arange(0, 60 * 10**9, 7_812_500)
    kept = np.random.default_rng(1).random(len(t)) > 0.1
    values = np.random.default_rng(2).standard_normal((kept.sum(), 6))
    stamps, note = usable_stamps('wrench', t[kept], t[kept] + 10**6, values)
    assert not note
    assert (stamps == t[kept]).all()


@pytest.mark.parametrize('seed', [302, 702])
@pytest.mark.long
def test_a_mean_over_one_second_is_told_at_any_seed(seed):
    note, *_ = judge(spoilt('wrench averaged over 1 s', work(seed)), DOWN)
    assert 'the driver filters the wrench' in note
