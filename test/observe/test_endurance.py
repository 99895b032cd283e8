"""The observer in the long run, on any input, and with any covariances."""

from dataclasses import replace
import pickle

from forcecal_ros.calibrate.gain import observer_model, riccati_gain
from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.observe import design, State
from forcecal_ros.observe.playback import events, on_event, run
from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
from observing import calibration, push, record, Swing
import pytest

MODEL = design(calibration())
DAY = 86_400.0
SWING = Swing(place=(0.004, 0.006, 0.006), turn=0.3, axis=(0.2, 1.0, 0.0), slide=0.002)


@given(st.lists(st.sampled_from([0.0, 1e-30, 1e-12, 1e-6, 1.0, 1e6, 1e30]), min_size=4,
                max_size=4), st.floats(0.1, 1000.0))
@example([1e30, 1e-12, 1e30, 1e-30], 1.0)
def test_gains_of_any_covariance_are_finite_or_refused_in_one_line(sizes, mass):
    model = observer_model(mass)
    Q, R = np.diag([0.0, sizes[0]]), np.diag(sizes[1:])
    try:
        assert np.isfinite(riccati_gain(model.A, model.C, Q, R)).all()
    except ForcecalError as error:
        assert '\n' not in str(error)


@pytest.mark.long
def test_estimates_ten_days_later_are_the_same():
    """Stamps at that distance are exact to 1.5e-11 s a day, which the microsecond outlives."""
    recording = record(2.0, SWING, push(0, 20.0, 1.0))
    _, early = run(events(recording), MODEL)
    _, late = run(events(shifted(recording, 10 * DAY)), MODEL)
    assert len(early) == len(late)
    np.testing.assert_allclose([s.t - 10 * DAY for s in late], [s.t for s in early], atol=1e-7)
    np.testing.assert_allclose([s.contact for s in late], [s.contact for s in early], atol=2e-3)


def shifted(recording, by):
    return replace(recording, **{
        name: replace(stream, t=stream.t + by) for name in
        ('wrench', 'accelerometer', 'pose', 'optidrive') if (stream := getattr(recording, name))})


@pytest.mark.long
def test_memory_does_not_grow_and_the_estimate_does_not_drift():
    recording = record(12.0)
    state, sizes, contact = State(), [], []
    for i, event in enumerate(events(recording)):
        state, out = on_event(state, event, MODEL)
        contact += [sample.contact for sample in out]
        if i % 3250 == 3249:
            sizes.append(len(pickle.dumps(state)))
    assert max(sizes[3:]) <= 1.2 * max(sizes[1:3])
    early, late = np.array(contact[2000:6000]), np.array(contact[-4000:])
    sigma = early.std(axis=0) / np.sqrt(20)  # a filter of 16 Hz leaves five samples a second
    assert (np.abs(late.mean(axis=0) - early.mean(axis=0)) < 5 * sigma).all()
