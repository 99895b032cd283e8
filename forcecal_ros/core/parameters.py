"""Parameters of nodes as a table, and the parameter file that is made of it."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from math import inf
from textwrap import wrap
from typing import Any, NamedTuple, TypeVar

from forcecal_ros.core.schema import Column, columns, Mismatch, Row, yaml_value
import numpy as np

T = TypeVar('T')


SET_IT = '; edit the lines that end with # SET in the parameter file'
"""Ends the message of a number that :func:`parameter_file` could not know."""

_FLOATS = 'ROS takes a number for a float only when it is written with a point.'


class Parameter(NamedTuple):
    """
    One row of a node's table of parameters.

    Attributes
    ----------
    name : str
    default : bool, int, float, str or list of them
        Its type is the parameter's.
    description : str
    unit : str
    low, high : float
        Range of a number.
    choices : tuple of str
        All words allowed; empty: any.
    live : bool
        Whether it may be set while the node runs.
    per_line : int
        Numbers in a line of the file; 0: all of them.
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    low: float = -inf
    high: float = inf
    choices: tuple[str, ...] = ()
    live: bool = False
    per_line: int = 0

    @property
    def text(self) -> str:
        """What it means, with its unit and its words."""
        text = f'{self.description} [{self.unit}]' if self.unit else self.description
        words = ' | '.join(word or "''" for word in self.choices)
        return f'{text} ({words})' if words else text

    @property
    def row(self) -> Row:
        """Its row: unit, range and words."""
        return Row(self.description, self.unit, self.low, self.high, words=self.choices)


def parameters_of(prefix: str, section: Any, *names: str, live: bool = True
                  ) -> tuple[Parameter, ...]:
    """
    Return the rows of a section, or some of them, as parameters below a prefix.

    The defaults are the section's own values, 0 where a number is None; ``live`` is that of all
    of them. A unit at the end of a field's name is left out of the parameter's.
    """
    return tuple(
        Parameter(_key(prefix, column), _plain(getattr(section, column.name)),
                  column.row.meaning, column.row.unit,
                  0.0 if column.optional and column.row.above == 0.0 else column.row.low,
                  column.row.high, column.row.words, live)
        for column in columns(type(section)) if not names or column.name in names)


def section_of(kind: type[T], value: Mapping[str, Any], prefix: str) -> T:
    """
    Make a section of the parameters below a prefix, by name; others keep their default.

    A number that may be None is None where the parameter is 0.

    Raises
    ------
    ConfigError
        A number is out of range, or still to be set.
    """
    try:
        return kind(**{column.name: value[key] or None if column.optional else value[key]
                       for column in columns(kind) if (key := _key(prefix, column)) in value})
    except Mismatch as error:
        error.args = (f'{error}{SET_IT if "nan" in error.found else ""}',)
        raise


def _key(prefix: str, column: Column) -> str:
    return f'{prefix}.{column.name.removesuffix("_hz")}'


def _plain(value: Any) -> Any:
    if value is None:
        return 0.0
    return value.tolist() if isinstance(value, np.ndarray) else value


def parameter_file(node: str, table: Iterable[Parameter], heading: str,
                   to_set: Collection[str] = ()) -> str:
    """
    Return the text of a node's parameter file, every parameter at its default with its meaning.

    ``heading`` is its first comment, of one line or more. Names without a dot come first, then
    the groups. Lines of parameters in ``to_set`` are marked with ``# SET``.
    """
    groups: dict[str, list[tuple[str, Parameter]]] = {'': []}
    for parameter in table:
        group, dot, name = parameter.name.partition('.')
        groups.setdefault(group if dot else '', []).append((name or group, parameter))
    lines = [line for part in (*heading.splitlines(), _FLOATS) for line in _comment(part, '')]
    lines += [f'/**/{node}:', '  ros__parameters:']
    for group, rows in groups.items():
        lines += [f'    {group}:'] if group else []
        for name, parameter in rows:
            mark = '  # SET' if parameter.name in to_set else ''
            lines += _lines(name, parameter, '      ' if group else '    ', mark)
    return '\n'.join(lines) + '\n'


def _lines(name: str, parameter: Parameter, indent: str, mark: str) -> Iterator[str]:
    range_ = parameter.row.range()
    yield from _comment(parameter.text + (f' ({range_})' if range_ else ''), indent)
    value = _rounded(parameter.default)
    if not parameter.per_line:
        yield f'{indent}{name}: {yaml_value(value)}{mark}'
        return
    yield f'{indent}{name}: [{mark}'
    for start in range(0, len(value), parameter.per_line):
        row = yaml_value(value[start:start + parameter.per_line])[1:-1]
        yield f'{indent}  {row}{"," if start + parameter.per_line < len(value) else "]"}'


def _comment(text: str, indent: str) -> list[str]:
    return wrap(text, 99, initial_indent=f'{indent}# ', subsequent_indent=f'{indent}# ',
                break_long_words=False, break_on_hyphens=False)


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return round(value, 12) + 0.0 if isinstance(value, float) else value
