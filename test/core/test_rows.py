"""One row refuses what it does not allow in one line, and lets everything else through."""

from dataclasses import dataclass
import math
from typing import Annotated

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.parameters import Parameter, parameters_of, section_of
from forcecal_ros.core.schema import Mismatch, plain, read, Row, Section
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

Vector3 = tuple[float, float, float]
Matrix = tuple[Vector3, Vector3]

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.tuples(inner, inner, inner)
    | st.dictionaries(st.sampled_from(['mass', 'com', 'note', 'name', 'first', 'others', 'clock',
                                       'rate', 'mas']) | st.text(max_size=4), inner, max_size=4),
    max_leaves=9)


@pytest.mark.parametrize('kind, row, value, message', [
    (float, Row('', 'kg', above=0.0), 'heavy', "x is 'heavy', expected a number above 0 [kg]"),
    (float, Row('', 'kg', above=0.0), 0.0, 'x is 0.0, expected a number above 0 [kg]'),
    (float, Row('', 'kg', 0.0), -1, 'x is -1, expected a number of at least 0 [kg]'),
    (float, Row('', 'm', -1.0, 1.0), 2.0, 'x is 2.0, expected a number from -1 to 1 [m]'),
    (float, Row('', above=0.0, below=1.0), 1.0, 'x is 1.0, expected a number above 0 and below 1'),
    (float, Row(), math.nan, 'x is nan, expected a finite number'),
    (float, Row(), True, 'x is True, expected a number'),
    (int, Row(), 1.5, 'x is 1.5, expected an integer'),
    (Vector3, Row('', 'm'), [1, 2], 'x is [1, 2], expected a list of 3 numbers [m]'),
    (Vector3, Row(), [1, 2, math.inf], 'expected a list of 3 finite numbers'),
    (Matrix, Row(), [[1, 2, 3], [4, 5]], 'expected 2 rows of 3 numbers'),
    (tuple[float, ...], Row(), [], 'x is [], expected a list of one or more numbers'),
    (np.ndarray, Row(shape=(2, None)), [[1]], 'expected 2 rows of equally many numbers'),
    (str, Row(words=('kalman', 'newton')), 'magic', 'expected one of kalman, newton'),
    (int, Row(words=(1, -1)), True, 'x is True, expected one of 1, -1'),
    (str, Row(), 3, "x is 3, expected a string; put it in quotes: '3'"),
    (str, Row(pattern='.', wording='one character'), ';;', "x is ';;', expected one character"),
    (bool, Row(), 'maybe', "x is 'maybe', expected on or off"),
    (tuple[str, ...], Row(), 'abc', "x is 'abc', expected a list of one or more strings"),
])
def test_a_wrong_value_is_named_with_what_was_expected(kind, row, value, message):
    with pytest.raises(Mismatch) as caught:
        row.take(kind, value, 'x')
    assert message in str(caught.value) and '\n' not in str(caught.value)


@pytest.mark.parametrize('kind, row, value, taken', [
    (float, Row('', 'kg', 0.0), 0, 0.0),
    (float, Row(finite=False), math.inf, math.inf),
    (int, Row(), 3, 3),
    (Vector3, Row(), np.array([1, 2, 3]), (1.0, 2.0, 3.0)),
    (Matrix, Row(), [[1, 2, 3], [4, 5, 6]], ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))),
    (bool, Row(), 'off', False),
    (str, Row(words=('a', 'b')), 'b', 'b'),
    (tuple[str, ...], Row(), ['a', 'b'], ('a', 'b')),
])
def test_a_right_value_is_taken_in_its_own_type(kind, row, value, taken):
    found = row.take(kind, value, 'x')
    assert found == taken and type(found) is type(taken)


@given(ANYTHING, st.sampled_from([float, int, bool, str, Vector3, Matrix, tuple[float, ...],
                                  tuple[str, ...]]),
       st.sampled_from([Row(), Row('', 'm', 0.0), Row(words=('on', 1)), Row(below=2.0),
                        Row(finite=False), Row(pattern='.+')]))
def test_any_value_is_taken_or_refused_in_one_short_line(value, kind, row):
    try:
        row.take(kind, value, 'x')
    except ConfigError as error:
        assert '\n' not in str(error) and len(str(error)) < 300


@dataclass(frozen=True)
class Tool(Section):
    """What hangs on the sensor."""

    mass: Annotated[float, Row('Of it', 'kg', above=0.0)]
    com: Annotated[Vector3, Row('Centre of mass', 'm')]
    note: Annotated[str | None, Row('', omit=True)] = None

    def __post_init__(self):
        super().__post_init__()
        if self.mass > 100.0 and not any(self.com):
            raise self.wrong('com', 'a place other than the origin')


@dataclass(frozen=True)
class Cell(Section):
    """Several of them."""

    name: str
    first: Tool
    spare: Tool | None = None
    others: tuple[Tool, ...] = ()
    rate: Annotated[float, Row('', 'Hz', above=0.0, key='clock.rate')] = 250.0


DOCUMENT = {'name': 'left', 'first': {'mass': 2, 'com': [0, 0, 0.1]},
            'others': [{'mass': 1.0, 'com': [0.0, 0.0, 0.0]}], 'clock': {'rate': 500}}


def changed(path, value):
    document = plain(DOCUMENT)
    *groups, key = path
    place = document
    for group in groups:
        place = place[group]
    place[key] = value
    return document


def test_a_document_is_read_into_its_sections_and_written_again():
    cell = read(Cell, DOCUMENT)
    assert cell == Cell('left', Tool(2.0, (0.0, 0.0, 0.1)),
                        others=(Tool(1.0, (0.0, 0.0, 0.0)),), rate=500.0)
    assert plain(cell) == {**DOCUMENT, 'spare': 'not identified'}
    assert read(Cell, plain(cell)) == cell


@pytest.mark.parametrize('path, value, message', [
    (['first', 'mass'], -2, 'first.mass is -2, expected a number above 0 [kg]'),
    (['first', 'mas'], 2, 'first: unknown key mas; did you mean mass?'),
    (['colour'], 'red', 'unknown key colour; expected one of name, first, spare, others, clock'),
    (['a\nb'], 'red', r"unknown key 'a\nb'; expected"),
    (['first'], {'com': [0, 0, 0]}, 'first: missing key mass; add it'),
    (['first'], {}, 'first: missing key mass, com; add them'),
    (['first'], None, 'first is None, expected the keys mass, com, note'),
    (['first', 'com'], None, 'first.com is None, expected a list of 3 numbers [m]'),
    (['others', 0, 'com'], [0], 'others[1].com is [0], expected a list of 3 numbers [m]'),
    (['others'], {}, 'others is {}, expected a list of entries with mass'),
    (['clock'], 5, 'clock is 5, expected a mapping'),
    (['clock', 'rate'], 0, 'clock.rate is 0, expected a number above 0 [Hz]'),
    (['first'], {'mass': 200.0, 'com': [0, 0, 0]},
     'first.com is (0.0, 0.0, 0.0), expected a place other than the origin'),
])
def test_a_wrong_document_is_named_by_the_path_of_its_key(path, value, message):
    with pytest.raises(ConfigError) as caught:
        read(Cell, changed(path, value))
    assert str(caught.value).startswith(message)


def test_keys_that_are_not_known_pass_where_allowed_unless_they_look_like_a_missing_one():
    assert read(Tool, {'mass': 1, 'com': [0, 0, 0], 'colour': 'red'}, extra=True).mass == 1.0
    with pytest.raises(ConfigError, match='unknown key noet; did you mean note'):
        read(Tool, {'mass': 1, 'com': [0, 0, 0], 'noet': 'red'}, extra=True)


def test_a_section_checks_itself_whenever_it_is_made():
    with pytest.raises(ConfigError, match=r'^tool.mass is -1.0, expected a number above 0 \[kg\]'):
        Tool(-1.0, (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Pace:
    """How fast."""

    speed: Annotated[float, Row('Peak speed', 'm/s', 0.1, 2.0)] = 0.5
    turns: Annotated[int, Row('How often')] = 3


def test_the_rows_of_a_section_are_parameters_and_make_it_again():
    rows = parameters_of('pace', Pace(speed=1.5))
    assert rows == (Parameter('pace.speed', 1.5, 'Peak speed', 'm/s', 0.1, 2.0, live=True),
                    Parameter('pace.turns', 3, 'How often', live=True))
    assert parameters_of('pace', Pace(), 'turns', live=False) == (
        Parameter('pace.turns', 3, 'How often'),)
    value = {row.name: row.default for row in rows} | {'limits.speed': 9.0}
    assert section_of(Pace, value, 'pace') == Pace(1.5, 3)
    assert section_of(Pace, {'pace.turns': 7}, 'pace') == Pace(turns=7)


@given(ANYTHING)
def test_any_document_is_read_or_refused_in_one_line(document):
    for kind in (Tool, Cell):
        for extra in (False, True):
            try:
                read(kind, document, extra=extra)
            except ConfigError as error:
                assert '\n' not in str(error) and len(str(error)) < 400
