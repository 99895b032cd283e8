"""Parameters declared from a table, with description, unit and range, and checked when set."""

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import partial
from typing import Any

from forcecal_ros.core.errors import ConfigError, ForcecalError, with_id
from forcecal_ros.core.parameters import Parameter
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

live_parameter = partial(Parameter, live=True)
"""A parameter that may be set while the node runs."""

UNBOUNDED = 1e9
"""Bound in the descriptor of a range that is open on one side: beyond any value of a parameter."""

OF_PUBLISHERS = 'qos_overrides.'
"""Parameters that rclpy declares when publishers and subscriptions are made."""


def declare(node: Node, table: Iterable[Parameter],
            check: Callable[[dict[str, Any]], object] | None = None) -> None:
    """
    Declare a table, so that ``ros2 param describe`` reads like a manual.

    Parameters
    ----------
    check : callable, optional
        As of :func:`refuse_changes`; called with changes that every row by itself allows.

    Raises
    ------
    ConfigError
        A value given at start is of another type, out of range or none of the choices, or it is
        of a parameter that the node does not have.
    """
    rows = {row.name: row for row in table}
    for row in rows.values():
        try:
            node.declare_parameter(row.name, row.default, _descriptor(row))
        except ParameterException as error:
            raise ConfigError(_explain(row, _given(node, row))) from error
        _check(row, node.get_parameter(row.name).value)
    _refuse_unknown(node, rows)

    def on_set(changes: list[RosParameter]) -> SetParametersResult:
        try:
            for change in changes:
                if change.name in rows:
                    _check(rows[change.name], change.value)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=with_id(error))
        return SetParametersResult(successful=True)

    if check is not None:
        refuse_changes(node, check)
    node.add_on_set_parameters_callback(on_set)  # rclpy calls the newest first


def _refuse_unknown(node: Node, known: Iterable[str]) -> None:
    """Refuse what was given at start to a parameter that the node does not have."""
    given = node._parameter_overrides  # noqa: SLF001 - no public way in rclpy
    unknown = [name for name in given
               if not (node.has_parameter(name) or name.startswith(OF_PUBLISHERS))]
    if unknown:
        close = get_close_matches(unknown[0], known, 1)
        raise ConfigError(
            f'unknown parameter {", ".join(unknown)}; '
            + (f'did you mean {close[0]}?' if close else
               f'config/{node.get_name()}.yaml lists all of this node'))


def refuse_changes(node: Node, check: Callable[[dict[str, Any]], object]) -> None:
    """
    Refuse changes for which a function raises a ForcecalError.

    Parameters
    ----------
    check : callable
        Takes the new values, by name, of the parameters that change.
    """
    def on_set(changes: list[RosParameter]) -> SetParametersResult:
        try:
            check({change.name: change.value for change in changes})
        except ForcecalError as error:
            return SetParametersResult(successful=False, reason=with_id(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(on_set)


def _descriptor(row: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=row.text, read_only=not row.live)
    bounded = row.low is not None or row.high is not None
    low = row.low if row.low is not None else -UNBOUNDED
    high = row.high if row.high is not None else UNBOUNDED
    if bounded and isinstance(row.default, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif bounded and isinstance(row.default, int):
        descriptor.integer_range = [
            IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor


def _check(row: Parameter, value: Any) -> None:
    if row.choices or isinstance(value, float):
        row.row.take(type(row.default), value, f'parameter {row.name}')


def _given(node: Node, row: Parameter) -> object:
    """Return the value given at start to a parameter that could not be declared."""
    anything = ParameterDescriptor(dynamic_typing=True)
    value = node.declare_parameter(row.name, row.default, anything).value
    node.undeclare_parameter(row.name)
    return value


def _explain(row: Parameter, given: object) -> str:
    kind = type(row.default).__name__
    hint = ''
    if isinstance(row.default, float):
        hint = ', written with a point'
        if row.low is not None or row.high is not None:
            hint += f', from {row.low:g}' if row.low is not None else ''
            hint += f' to {row.high:g}' if row.high is not None else ''
    elif isinstance(row.default, list):
        kind = f'list of {type(row.default[0]).__name__}'
    return f'parameter {row.name} is {given!r}, expected a {kind}{hint}'
