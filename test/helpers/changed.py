"""Recordings of which one stream is changed."""

from dataclasses import replace

import numpy as np


def with_values(recording, change, name='wrench'):
    """Return the recording with the values that ``change`` makes of a copy of a stream's."""
    stream = getattr(recording, name)
    return replace(recording, **{name: replace(stream, values=change(np.array(stream.values)))})


def later(recording, seconds, name='wrench'):
    """Return the recording with one stream stamped later [s]."""
    stream = getattr(recording, name)
    return replace(recording, **{name: replace(stream, t=stream.t + seconds)})
