"""Long signals piece by piece: what is made of many at once fills no memory."""

from collections.abc import Iterator

AT_ONCE = 8192
"""Samples at once, some thirty seconds: of a hundred signals as many fill a processor's cache."""


def pieces(n: int, whole: int = 1) -> Iterator[slice]:
    """
    Give one piece of n samples after the other.

    Parameters
    ----------
    whole : int
        Samples that are kept together.
    """
    length = max(1, AT_ONCE // whole) * whole
    return (slice(i, min(n, i + length)) for i in range(0, n, length))
