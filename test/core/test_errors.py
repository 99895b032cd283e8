"""A value next to its limit reads as it was compared."""

from math import inf, nan, nextafter

from forcecal_ros.core.errors import above, below
import pytest


@pytest.mark.parametrize('limit', [10.0, 0.1, 1e-9, -2.5, 1e6])
def test_a_value_next_to_its_limit_reads_on_its_side(limit):
    for value in (nextafter(limit, inf), limit + abs(limit) / 1e4, limit + abs(limit)):
        assert float(above(value, limit)) > limit
    for value in (nextafter(limit, -inf), limit - abs(limit) / 1e4, limit - abs(limit)):
        assert float(below(value, limit)) < limit


def test_a_value_far_from_its_limit_has_few_digits():
    assert above(12.3456, 10.0) == '12.3' and below(9.8765, 10.0, 2) == '9.9'


def test_what_is_not_on_the_side_is_printed_as_it_is():
    assert above(nan, 1.0) == below(nan, 1.0) == 'nan' and above(1.0, 1.0) == '1'
