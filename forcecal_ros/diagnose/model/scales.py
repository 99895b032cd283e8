"""Sizes that a discrepancy may have in each stream, in parts of what its channels show."""

from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES

Scales = tuple[float, ...]
"""Part of the signal that a discrepancy has in each stream, in the order of STREAM_SLICES."""

SCALES = (0.0, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3)
"""
Parts of its channels' signals that a discrepancy may have in a stream; the evidence decides which.

Were 1 % allowed, many an effect would be no more than such a function; beside a larger background
effects are weighed by what they explain of the misfit, and leave.
"""

NO_DISCREPANCY: Scales = (0.0,) * len(STREAM_SLICES)
"""Scales that represent no discrepancy in any stream."""

FREE = (*SCALES, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Scales of a discrepancy, channel by channel, where it is removed to estimate the noise."""

STREAM = tuple(i for i, name in enumerate(STREAM_SLICES) for c in CHANNELS if c.stream == name)
"""Place of each channel's stream among the scales."""
