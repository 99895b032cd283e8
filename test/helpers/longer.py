"""Values that only ``-m long`` takes of a parameter: the usual run takes a few."""

import pytest


def but(values, later):
    """Leave some values to the long run."""
    return [pytest.param(value, marks=pytest.mark.long) if value in later else value
            for value in values]


def first(values, count=1):
    """Leave all but the first few values to the long run."""
    values = [*values]
    return [*values[:count], *(pytest.param(
        *(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.long)
        for value in values[count:])]
