"""A whole recording at once is worth what the step makes of it, sample by sample."""

from dataclasses import replace

from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.observe import design, ObserverSettings
from forcecal_ros.observe.batch import estimates, in_order
from forcecal_ros.observe.playback import events, run
import numpy as np
from observing import calibration, orientation_only, push, record, Swing, without_times
import pytest

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2, axis=(0.3, 1.0, 0.2), slide=0.003)


def swing(**options):
    return record(1.2, SWING, push(0, 20.0, 0.5), seed=1, **options)


def with_gaps(**options):
    """Other rates than the wrench's, late starts, gaps of every stream."""
    r = swing(rates=(1000.0, 254.0, 100.0), **options)
    return replace(
        r, accelerometer=without_times(r.accelerometer, (0.5, 0.54), (0.7, 0.9)),
        pose=without_times(r.pose, (0.0, 0.2), (0.45, 0.6)),
        optidrive=without_times(r.optidrive, (0.0, 0.1), (0.6, 0.65)),
        wrench=without_times(r.wrench, (0.95, 0.97)))


def with_bad_samples():
    r = swing()
    wrench, volts, slide = (np.array(stream.values) for stream in (
        r.wrench, r.accelerometer, r.optidrive))
    wrench[100, 2], wrench[200, 1], wrench[300:310] = np.nan, np.inf, 1e12
    volts[400], volts[500:600], volts[900, 1], slide[700] = np.nan, 1e10, np.inf, np.nan
    return replace(r, wrench=Stream(r.wrench.t, wrench), optidrive=Stream(r.optidrive.t, slide),
                   accelerometer=Stream(r.accelerometer.t, volts))


def with_pauses():
    r = swing()
    return replace(r, wrench=without_times(r.wrench, (0.0, 0.4), (0.6, 0.75), (0.8, 1.15)))


def only(*names):
    r = swing()
    return Recording(**{name: getattr(r, name) for name in names})


CASES = {
    'plain': (swing(), calibration(), ObserverSettings()),
    'gaps, later': (with_gaps(delay=0.0073), calibration(0.0073), ObserverSettings()),
    'gaps, earlier': (with_gaps(delay=-0.0073), calibration(-0.0073), ObserverSettings()),
    'gaps, newton': (with_gaps(), calibration(), ObserverSettings('newton')),
    'orientation, coupled by ac': (
        orientation_only(swing(wash=0.5)), calibration(wash=0.5), ObserverSettings()),
    'no pose': (only('wrench', 'accelerometer', 'optidrive'), calibration(), ObserverSettings()),
    'no accelerometer': (only('wrench', 'pose', 'optidrive'), calibration(), ObserverSettings()),
    'wrench alone': (only('wrench'), calibration(), ObserverSettings()),
    'gaps, ukf': (with_gaps(), calibration(), ObserverSettings('ukf')),
    'bad samples, ekf': (with_bad_samples(), calibration(), ObserverSettings('ekf')),
    'gaps, static': (with_gaps(), calibration(), ObserverSettings('static')),
    'limits': (swing(), calibration(), ObserverSettings(
        wrench_limit=(100.0,) * 3 + (3.0,) * 3, accelerometer_limit=6.0)),
    'pauses': (with_pauses(), calibration(), ObserverSettings()),
    'bad samples': (with_bad_samples(), calibration(), ObserverSettings()),
}


@pytest.mark.parametrize('case', CASES)
def test_batch_equals_step(case):
    recording, known, settings = CASES[case]
    model = design(known, settings)
    state, samples = run(events(recording), model)
    found = estimates(recording, model)
    assert found.dropped == state.refusals.counts
    assert found.status.tolist() == [sample.status for sample in samples]
    assert found.t.tolist() == [sample.t for sample in samples]
    for name in ('contact', 'measured', 'innovation', 'inertial'):
        expected = np.array([getattr(sample, name) for sample in samples])
        np.testing.assert_allclose(getattr(found, name), expected, rtol=0, atol=1e-9)
    if model.bias_filter is not None:
        for name, values in found.learned._asdict().items():
            expected = np.array([getattr(sample.learned, name) for sample in samples])
            np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.long
def test_cases_meet_everything_a_status_can_say():
    seen = 0
    for recording, known, settings in CASES.values():
        seen |= int(np.bitwise_or.reduce(estimates(recording, design(known, settings)).status))
    assert seen == 511


def test_stamps_that_repeat_or_fall_are_not_in_order():
    r = swing()
    assert in_order(r)
    for bad in (r.wrench.t[5], np.nan, -1.0):
        t = np.array(r.wrench.t)
        t[6] = bad
        assert not in_order(replace(r, wrench=Stream(t, r.wrench.values)))
