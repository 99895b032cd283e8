"""From one estimate to another without a jump, when the model behind it has changed."""

from typing import NamedTuple

from forcecal_ros.observe.filters.memory import Memory
from forcecal_ros.observe.sample import ContactSample, Wrench
from forcecal_ros.observe.step import State


class Fade(NamedTuple):
    """A difference that is still to be taken off, from ``start`` on, over ``duration`` [s]."""

    start: float
    duration: float
    difference: Wrench


def rebased(state: State, before: ContactSample, sample: ContactSample
            ) -> tuple[State, ContactSample]:
    """
    Move the contact filter to where a new model puts it, so that only a fade is seen of that.

    ``state`` is that after ``sample``, the first of the new model; ``before`` is the last of the
    old one. Filters that estimate biases begin anew with a model, and stay as they are.
    """
    if not isinstance(state.filter, Memory):
        return state, sample
    a, b, c, d, e, f = (old + new - was for old, new, was in zip(
        before.contact, sample.measured, before.measured))
    contact = (a, b, c, d, e, f)
    return (state._replace(filter=state.filter._replace(contact=contact)),
            sample._replace(contact=contact))


def begin_fade(t: float, duration: float, before: Wrench, after: Wrench) -> Fade:
    """
    Begin at the first estimate of a new model.

    Parameters
    ----------
    t : float
        Its stamp [s].
    duration : float
        [s]
    before, after : tuple of 6 float
        What was published last, and what the new model says [N, N m].
    """
    a, b, c, d, e, f = (x - y for x, y in zip(before, after))
    return Fade(t, duration, (a, b, c, d, e, f))


def faded(fade: Fade, t: float, wrench: Wrench) -> Wrench | None:
    """
    Take off what is due of the difference at ``t`` [s], smoothly.

    None once the fade is over, or where time went back.
    """
    x = (t - fade.start) / fade.duration
    if not 0.0 <= x < 1.0:
        return None
    k = 1.0 - x * x * (3.0 - 2.0 * x)
    a, b, c, d, e, f = (w + k * difference for w, difference in zip(wrench, fade.difference))
    return a, b, c, d, e, f
