"""What a wrench is worth depends on stamps alone; the step answers soon and never raises."""

from dataclasses import replace
from math import inf, nan

from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import design, level, ObserverSettings, replay, State, Status
from forcecal_ros.observe.playback import events, on_event, run
from forcecal_ros.observe.settings import FILTERS
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from longer import first
import numpy as np
from observing import calibration, push, record, Swing, without_times
import pytest

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2, axis=(0.3, 1.0, 0.2), slide=0.003)
SKEW = ObserverSettings().skew


def shuffled(sequence, rng, skew):
    """Delay each message at random, order within a stream kept."""
    arrivals, last = [], {}
    for i, (t, kind, _) in enumerate(sequence):
        last[kind] = max(last.get(kind, 0.0) + 1e-9, t + rng.uniform(0.0, skew) ** 2 / skew)
        arrivals.append((last[kind], i))
    return [sequence[i] for _, i in sorted(arrivals)]


@pytest.mark.parametrize('delay', first([0.0, 0.0073, -0.0073]))
def test_estimates_do_not_depend_on_the_order_in_which_topics_arrive(delay):
    """Other rates than the wrench's, gaps, late starts, all bit for bit."""
    r = record(2.0, SWING, push(0, 20.0, 0.5), seed=1, delay=delay, rates=(1000., 254., 100.))
    r = replace(
        r, accelerometer=without_times(r.accelerometer, (1.0, 1.04), (1.2, 1.5)),
        pose=without_times(r.pose, (0.0, 0.2), (0.8, 1.1)),
        optidrive=without_times(r.optidrive, (0.0, 0.3), (0.9, 0.95)),
        wrench=without_times(r.wrench, (1.7, 1.71)))
    model = design(calibration(delay))
    sequence = list(events(r))
    _, expected = run(sequence, model)
    assert len(expected) == len(r.wrench)
    assert len({s.status for s in expected}) > 4
    for seed in range(2):
        _, samples = run(shuffled(sequence, np.random.default_rng(seed), 0.98 * SKEW), model)
        assert samples == expected


def test_out_of_order_a_recording_is_replayed_by_the_step_itself():
    r = record(0.5, SWING, seed=2)
    t = r.wrench.t.copy()
    t[[300, 301]] = t[[301, 300]]
    r = replace(r, wrench=Stream(t, r.wrench.values))
    _, samples = run(events(r), design(calibration()))
    estimate = replay(r, calibration())
    assert estimate.dropped == (1, 0, 0, 0)
    assert np.array_equal(estimate.contact, [s.contact for s in samples])
    assert np.array_equal(estimate.status, [s.status for s in samples])


def answered(recording, model):
    """Return each estimate's stamp, and that of the event that brings it less that of it."""
    state, late = State(), []
    for event in events(recording):
        state, out = on_event(state, event, model)
        late.extend((sample.t, event[0] - sample.t) for sample in out)
    return np.array(late).T


def latencies(delay, rates):
    t, late = answered(record(1.0, SWING, delay=delay, rates=rates), design(calibration(delay)))
    return late[t > 0.2]


def test_accelerometer_stamped_alike_adds_no_latency():
    assert latencies(0.0, (1000., 1000., 250.)).max() < 1e-9
    assert latencies(-0.006, (1000., 1000., 250.)).max() < 1e-9


@pytest.mark.parametrize('delay', first([0.0, 0.006]))
def test_latency_is_the_delay_and_at_most_one_period_of_the_accelerometer(delay):
    assert latencies(delay, (1000., 254., 100.)).max() < delay + 1 / 254 + 1e-9
    assert latencies(delay, (1000., 1000., 250.)).max() < delay + 1e-9


@pytest.mark.parametrize(('stream', 'wait'), [
    pytest.param('accelerometer', ObserverSettings().accelerometer_timeout + SKEW,
                 marks=pytest.mark.long),
    ('optidrive', ObserverSettings().accelerometer_timeout + SKEW),
    pytest.param('pose', SKEW, marks=pytest.mark.long)])
def test_a_stream_that_stops_holds_the_output_back_once(stream, wait):
    r = record(1.5, SWING)
    t, late = answered(replace(r, **{
        stream: without_times(getattr(r, stream), (0.7, 2.0))}), design(calibration()))
    assert late.max() <= wait + 0.001
    assert late[(t > 0.3) & (t < 0.69)].max() < 1e-9
    assert late[t > 0.7 + ObserverSettings().pose_timeout + 2 * SKEW + 0.01].max() < 1e-9


numbers = st.one_of(
    st.floats(-2.0, 2.0), st.floats(), st.sampled_from([0.0, inf, -inf, nan, 1e308]))
stamps = st.one_of(st.floats(0.0, 0.3), st.floats(0.0, 5.0), numbers)
anything = st.lists(st.tuples(
    stamps, st.sampled_from(['wrench', 'accelerometer', 'displacement', 'pose']),
    st.lists(numbers, min_size=7, max_size=7)), max_size=60)


@pytest.mark.parametrize('coupling', first(['ac', 'dc']))
@pytest.mark.parametrize('mode', FILTERS)
@given(sequence=anything, ordered=st.booleans())
@hypothesis_settings(max_examples=12, deadline=None)
def test_no_sample_makes_the_step_raise_or_its_estimate_infinite(
        sequence, ordered, mode, coupling):
    model = design(calibration(wash=0.01 if coupling == 'ac' else 0.0), ObserverSettings(mode))
    if ordered:
        sequence = sorted(sequence, key=lambda e: (e[0] != e[0], e[0]))
    size = {'wrench': 6, 'accelerometer': 3, 'displacement': 1, 'pose': 7}
    _, samples = run([(t, kind, tuple(row[:size[kind]])) for t, kind, row in sequence], model)
    for sample in samples:
        assert np.isfinite(sample.contact).all()
    assert [s.t for s in samples] == sorted(s.t for s in samples) or not ordered


@pytest.mark.long
def test_one_bad_sample_leaves_no_trace_beyond_its_own_instant():
    r = record(2.0, SWING)
    sequence = list(events(r))
    bad = [(1.0005, 'accelerometer', (nan, 5.0, 5.0)), (1.0006, 'pose', (nan,) * 7),
           (0.0, 'wrench', (0.0,) * 6), (1.0007, 'displacement', (inf,)),
           (1.0008, 'pose', (1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0))]
    i = next(i for i, e in enumerate(sequence) if e[0] > 1.0005)
    model = design(calibration())
    _, expected = run(sequence, model)
    state, samples = run(sequence[:i] + bad + sequence[i:], model)
    assert samples == expected
    assert state.refusals.counts == (1, 1, 2, 1)


@pytest.mark.parametrize('value', [nan, 1e10])
def test_a_wrench_that_is_no_reading_repeats_the_last_estimate_and_says_so(value):
    r = record(0.5)
    values = r.wrench.values.copy()
    values[300, 4] = value
    estimate = replay(replace(r, wrench=Stream(r.wrench.t, values)), calibration())
    assert estimate.status[300] == Status.BAD_WRENCH
    assert (estimate.contact[300] == estimate.contact[299]).all()
    assert (estimate.status[301:490] == 0).all()
    assert level(int(estimate.status[300])) == 'error'


def test_a_clock_that_starts_over_starts_the_observer_anew():
    """A recording played twice: the second run is like the first, after two samples."""
    sequence = list(events(record(1.6, SWING)))
    model = design(calibration())
    _, once = run(sequence, model)
    later = [(t + 100.0, kind, row) for t, kind, row in sequence]
    _, twice = run(later + sequence, model)
    again = {s.t: s for s in twice if s.t < 50.0}
    assert len(again) >= len(once) - 2
    error = [np.abs(np.subtract(again[s.t].contact, s.contact)).max()
             for s in once if 0.5 < s.t < 1.55]
    assert max(error) < 0.3


def test_a_pause_of_the_wrench_restarts_the_filter():
    r = record(1.0, contact=push(0, 20.0, 0.5))
    r = replace(r, wrench=without_times(r.wrench, (0.4, 0.6)))
    estimate = replay(r, calibration())
    i = int(np.searchsorted(estimate.t, 0.5999))
    assert estimate.status[i] & Status.RESTARTED
    assert (estimate.contact[i] == estimate.measured[i]).all()


def test_readings_at_the_end_of_a_range_are_flagged():
    r = record(0.5)
    settings = ObserverSettings(wrench_limit=(130.0, 130.0, 130.0, 5.0, 5.0, 5.0))
    assert (replay(r, calibration(), settings).status[:400] & Status.SATURATED).all()
    volts = ObserverSettings(accelerometer_limit=7.0)
    assert (replay(r, calibration(), volts).status[:400] & Status.SATURATED).all()
    wide = ObserverSettings(wrench_limit=(400.0,) * 6, accelerometer_limit=10.0)
    assert not (replay(r, calibration(), wide).status & Status.SATURATED).any()


def test_without_a_wrench_nothing_piles_up():
    model, state = design(calibration()), State()
    for event in events(record(2.0, without=('wrench',))):
        state, _ = on_event(state, event, model)
    memory = 4 * (ObserverSettings().pose_timeout + SKEW)
    assert len(state.accelerometer.samples) <= 1000 * memory + 2
    assert len(state.poses.pending) <= 250 * memory + 2
