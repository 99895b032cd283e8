"""What is no free-hanging rigid body is found, cut or refused, and said."""

from dataclasses import replace

from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.schema import Mismatch
from forcecal_ros.insitu import calibrate, Chunk, DataSet, Options
from forcecal_ros.insitu.blocks import Mounting, prepare, to_blocks
from forcecal_ros.insitu.screen import screen
from forcecal_ros.insitu.uncertainty import causes, departure
import insitu_leg
from insitu_leg import GAUGES, Leg, Load, OFFSET, record
from insitu_runs import chunks_of, data_set, offset_only
import numpy as np
import pytest

ADDED = insitu_leg.PROTOCOL[1]
FOOT = np.array([291.69, -78.82, 38.51, -0.020, -2.869, -1.109])
"""Offset of the foot's sensor by the README of the recording [N, N m]."""


@pytest.fixture(scope='module')
def log():
    return record(ADDED, Leg(), 3)


def screened(log):
    blocks = to_blocks(prepare(chunks_of(log), Mounting(), False))
    return blocks, screen(blocks)


def with_raw(log, raw):
    return replace(log, raw=raw)


def touched(log, start, end, force):
    """Add a contact that comes and goes as a half sine."""
    inside = (log.t >= start) & (log.t < end)
    shape = np.where(inside, np.sin(np.pi * (log.t - start) / (end - start)), 0.0)
    return with_raw(log, log.raw + np.outer(shape, GAUGES @ np.array(force)))


def seconds(kept):
    return sum(min(end, 60.0) - start for start, end in kept)


@pytest.mark.parametrize('leg', [
    Leg(), Leg(noise=0.0), insitu_leg.REAL, Leg(noise=0.1, hysteresis=0.005, inertial=True)])
def test_a_clean_recording_is_kept_whole(leg):
    _, result = screened(record(ADDED, leg, 3))
    assert not result.cuts
    assert seconds(result.kept) == 60.0


@pytest.mark.parametrize('force', [
    (0, 0, 0, 0.5, 0, 0),
    pytest.param((6, -2, 4, 0.4, 0.2, 0.6), marks=pytest.mark.long)])
def test_a_contact_is_cut_and_the_rest_kept(log, force):
    _, result = screened(touched(log, 20.0, 30.0, force))
    assert all(start >= 29.0 or end <= 21.5 for start, end in result.kept)
    assert seconds(result.kept) > 46.0
    assert 'contact' in result.cuts[0].reason


@pytest.mark.long
def test_the_offset_is_right_in_spite_of_a_contact(log):
    result = offset_only(touched(log, 20.0, 30.0, (6, -2, 4, 0.4, 0.2, 0.6)))
    assert (np.abs(result.offset.value - OFFSET) < 4 * result.offset.std).all()
    assert any('was cut' in warning for warning in result.warnings)


def test_a_tap_is_cut(log):
    raw = log.raw.copy()
    raw[3000:3012] += GAUGES @ np.array([40.0, 0, 0, 0, 2.0, 0])
    _, result = screened(with_raw(log, raw))
    assert len(result.cuts) == 1
    assert result.cuts[0].start <= 30.0 and result.cuts[0].end >= 30.11
    assert result.cuts[0].end - result.cuts[0].start < 1.0


@pytest.mark.long
def test_a_knee_that_moves_is_said_to_be_another_body(log):
    bent = record(Load(0.51, (0.20, 0.15, 0.25)), Leg(), 3)
    _, result = screened(with_raw(log, np.where((log.t < 38)[:, None], log.raw, bent.raw)))
    assert seconds(result.kept) == pytest.approx(38.0, abs=1.0)
    assert any('fits another matrix' in cut.reason for cut in result.cuts)


def test_a_clipped_channel_is_found_and_cut(log):
    limit = np.sort(log.raw[:, 2])[-1500]
    raw = log.raw.copy()
    raw[:, 2] = np.minimum(raw[:, 2], limit)
    blocks, result = screened(with_raw(log, raw))
    assert any('channel 3 is clipped' in cut.reason for cut in result.cuts)
    at_limit = (raw[:6000, 2] == limit).reshape(-1, blocks.samples).any(axis=1)
    assert not (at_limit & result.use).any()


def test_coarse_steps_are_not_taken_for_clipping(log):
    blocks, result = screened(with_raw(log, np.round(log.raw / 200) * 200))
    assert not blocks.clipped.any()
    assert seconds(result.kept) > 55.0


def test_a_gap_in_the_stamps_is_cut_around(log):
    keep = (log.t < 20) | (log.t >= 26)
    cut = replace(log, **{name: getattr(log, name)[keep]
                          for name in ('t', 'raw', 'accel', 'gyro', 'wrench')})
    _, result = screened(cut)
    assert any('gap' in one.reason for one in result.cuts)
    assert not any(start < 20.0 and end > 26.0 for start, end in result.kept)


def test_a_recording_that_is_all_contact_is_refused_with_a_reason(log):
    rng = np.random.default_rng(0)
    pushed = log.raw + np.cumsum(rng.normal(size=log.raw.shape), axis=0) * 200
    with pytest.raises(DataError, match='one: no 6 s of the 60 s .* hangs free'):
        offset_only(with_raw(log, pushed))


def test_an_accelerometer_in_another_unit_is_refused(log):
    with pytest.raises(DataError, match='1 m/s.* at rest'):
        offset_only(replace(log, accel=log.accel / insitu_leg.G))


def test_a_channel_that_never_changes_is_refused_by_its_number(log):
    raw = log.raw.copy()
    raw[:, 4] = 17.0
    with pytest.raises(DataError, match='one: channel 5 is constant at 17'):
        offset_only(with_raw(log, raw))


def test_an_error_of_any_kind_gets_the_name_of_its_data_set():
    def broken():
        raise Mismatch('rate', 3, 'above 10')

    with pytest.raises(Mismatch, match='^one: rate is 3, expected above 10$') as caught:
        calibrate('leg', [DataSet('one', broken)], Mounting(), Options(matrix=False))
    assert caught.value.where == 'rate'


def test_a_few_blocks_name_no_cause_of_what_is_left(log):
    blocks = to_blocks(prepare(chunks_of(log), Mounting(), False))
    few = np.arange(len(blocks)) < 20
    assert causes([(blocks, few)]) is None


def test_motion_about_one_axis_is_refused_with_the_axis(log):
    t = log.t
    angle = np.deg2rad(40) * np.sin(2 * np.pi * t / 20)
    gravity = insitu_leg.G * np.stack([np.sin(angle), 0 * t, np.cos(angle)], axis=1)
    raw = np.hstack([2.86 * gravity, np.cross(insitu_leg.BODY_COM, 2.86 * gravity)]) @ GAUGES.T
    raw = raw + np.random.default_rng(0).normal(size=raw.shape) * 25
    accel = -gravity + 0.05 * np.random.default_rng(1).normal(size=gravity.shape)
    with pytest.raises(UnobservableError, match='too little along y'):
        offset_only(replace(log, raw=raw, accel=accel))


@pytest.mark.long
def test_noise_alone_leaves_the_subspace_in_no_more_than_a_few_of_a_thousand():
    chances = []
    for seed in range(40):
        blocks, result = screened(record(ADDED, Leg(duration=20.0), 300 + seed))
        chances.append(departure(blocks, result.use).p)
    assert min(chances) > 1e-4
    assert 0.2 < np.mean(chances) < 0.8


def found_causes(leg, seed):
    pairs = [screened(record(load, leg, 100 * seed + k))
             for k, load in enumerate(insitu_leg.PROTOCOL[:4])]
    return causes([(blocks, result.use) for blocks, result in pairs])


@pytest.mark.parametrize('leg, bending, hysteresis', [
    (Leg(), False, False),
    (Leg(flex=np.deg2rad(0.3)), True, False),
    pytest.param(Leg(hysteresis=0.005), False, True, marks=pytest.mark.long),
    (Leg(hysteresis=0.005, flex=np.deg2rad(0.3)), True, True),
])
def test_flex_and_hysteresis_are_told_apart(leg, bending, hysteresis):
    found = found_causes(leg, 2)
    assert (found.bending.significant, found.hysteresis.significant) == (bending, hysteresis)


def calibrated_foot(icub_data, window=None):
    table = np.loadtxt(icub_data / 'right_foot_in_air.csv', delimiter=',', skiprows=1)
    chunk = Chunk(table[:, 0], table[:, 1:7], -table[:, 7:10], None)
    one = DataSet('foot', lambda: chunk, None, True, window)
    return calibrate('foot', [one], Mounting(), Options(matrix=False))


def test_icub_foot_in_the_window_given_has_the_known_offset_and_three_dimensions(icub_data):
    result = calibrated_foot(icub_data, (21.0, 57.0))
    off = np.abs(result.offset.value - FOOT)
    assert (off[:3] < 0.05).all()
    assert (off[3:] < 0.005).all()
    values = result.data_sets[0].singular_values
    np.testing.assert_allclose(values[:3], [2.03, 0.596, 0.1325], rtol=0.03)
    assert values[3] < values[2] / 30


def test_icub_foot_whole_finds_its_window_and_says_that_y_is_weak(icub_data):
    result = calibrated_foot(icub_data)
    (start, end), = result.data_sets[0].kept
    assert abs(start - 21.0) < 2.0
    assert abs(end - 57.0) < 2.0
    off = result.offset.value - FOOT
    assert abs(off[0]) < 0.3 and abs(off[2]) < 0.3 and abs(off[1]) < 1.0
    assert (np.abs(off) < 2 * result.offset.std).all()
    assert result.excitation.weak and result.excitation.weakest == 'y'
    assert 'along y' in result.warnings[0]


def test_a_window_may_be_given_by_the_user_and_is_not_cut(log):
    pushed = touched(log, 20.0, 30.0, (6, -2, 4, 0.4, 0.2, 0.6))
    result = calibrate('leg', [data_set(pushed, window=(10.0, 55.0))], Mounting(),
                       Options(matrix=False))
    assert result.data_sets[0].kept == ((10.0, pytest.approx(55.0)),)
    assert any('should be cut' in warning for warning in result.warnings)
