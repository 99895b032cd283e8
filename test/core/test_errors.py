"""A value next to its limit reads as it was compared."""

import ast
from copy import copy
from math import inf, nan, nextafter
from pathlib import Path
import re

import forcecal_ros
from forcecal_ros.core.errors import above, below, DataError, UnobservableError
from forcecal_ros.core.schema import Mismatch
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


def _compared(test, negated=False):
    """Yield both sides of each comparison that holds strictly where a test is true."""
    if isinstance(test, ast.BoolOp):
        for one in test.values:
            yield from _compared(one, negated)
    elif isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        yield from _compared(test.operand, not negated)
    elif isinstance(test, ast.Compare):
        strict = (ast.LtE, ast.GtE) if negated else (ast.Lt, ast.Gt)
        for left, op, right in zip([test.left, *test.comparators], test.ops, test.comparators):
            if isinstance(op, strict):
                yield {ast.unparse(left), ast.unparse(right)}


def _rounded_next_to_its_limit(tree):
    """Yield lines where a message under a comparison rounds a value and prints its limit."""
    for node in (one for one in ast.walk(tree) if isinstance(one, ast.If)):
        pairs = list(_compared(node.test))
        for text in (one for part in node.body * bool(pairs) for one in ast.walk(part)
                     if isinstance(one, ast.JoinedStr)):
            printed = {ast.unparse(one.value): one.format_spec and ast.unparse(one.format_spec)
                       for one in ast.walk(text) if isinstance(one, ast.FormattedValue)}
            for pair in pairs:
                if pair <= {*printed} and {printed[one] for one in pair} - {None, "f'g'"}:
                    yield text.lineno


def test_no_message_rounds_a_value_next_to_its_limit():
    """It would read as a contradiction, as "10.0 s, expected 10 s at least"."""
    bad = ast.parse('if a < LIMIT:\n    raise E(f"{a:.1f} s, expected {LIMIT:g} s at least")')
    assert list(_rounded_next_to_its_limit(bad)) == [2]
    good = ast.parse('if a < LIMIT:\n    raise E(f"{below(a, LIMIT)} s, expected {LIMIT:g} s")')
    assert not list(_rounded_next_to_its_limit(good))
    assert not [f'{path}:{line}' for path in Path(forcecal_ros.__file__).parent.rglob('*.py')
                if re.search(r':\.\d[efg]\}', text := path.read_text())
                for line in _rounded_next_to_its_limit(ast.parse(text))]


@pytest.mark.parametrize('error', [
    Mismatch('tool.mass', -1.0, 'a number above 0'), DataError('two drivers', 'sign'),
    UnobservableError('no motion')])
def test_an_error_comes_back_from_another_process_as_it_was(error):
    back = copy(error)  # by what pickle does
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert vars(back) == vars(error)
