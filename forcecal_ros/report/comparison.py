"""Two calibrations or diagnoses next to each other: what changed, and how sure that is."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import hypot, isfinite, nan
from typing import Any, TYPE_CHECKING

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.quantity import HALF, quantity
from forcecal_ros.core.schema import plain
from forcecal_ros.report.rows import (
    error,
    estimates,
    FINEST,
    HALF_WIDTH,
    handy,
    number,
    Row,
    rows,
    ruled,
    value,
    WRENCH_AXES,
)

if TYPE_CHECKING:
    from forcecal_ros.diagnose.result import Diagnosis

FORMAT = 'forcecal-comparison/1'

CHANGED = 2.0
"""Half-widths of its 95 % interval from which a difference counts as a change: of two calibrations
of the same thing, with 40 numbers each, one pair in 280 has so large a one by chance."""


@dataclass(frozen=True)
class Change:
    """
    One number in both calibrations.

    Attributes
    ----------
    first, second : Row
        Of the same key and unit.
    """

    first: Row
    second: Row

    @property
    def difference(self) -> float:
        """Second less first."""
        return self.second.value - self.first.value

    @property
    def std(self) -> float:
        """Standard error of the difference, the two being independent; NaN: not known."""
        return hypot(self.first.std, self.second.std)

    @property
    def sigmas(self) -> float | None:
        """The difference in its standard errors; None where these are not known."""
        return self.difference / self.std if self.std > 0 else None


@dataclass(frozen=True)
class Comparison:
    """
    What two calibrations, or two diagnoses, have in common, and what not.

    Attributes
    ----------
    changes : tuple of Change
        Every number that both hold, whether it changed or not.
    settings : dict
        Key -> what each states, if they differ; units among them.
    only_first, only_second : tuple of str
        Keys that one of them holds alone.
    """

    changes: tuple[Change, ...]
    settings: dict[str, tuple[Any, Any]]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]

    @property
    def changed(self) -> list[Change]:
        """Those beyond chance, the surest first."""
        beyond = [one for one in self.changes if one.sigmas and abs(one.sigmas) > CHANGED * HALF]
        return sorted(beyond, key=lambda one: -abs(one.sigmas or 0.0))


def compare(first: Calibration, second: Calibration) -> Comparison:
    """Compare two calibrations number by number."""
    return _compare(rows(_all(first)), rows(_all(second)), _settings(first),
                    _settings(second))


def compare_diagnoses(first: 'Diagnosis', second: 'Diagnosis') -> Comparison:
    """Compare two diagnoses: verdicts, parameters of the effects, and the gap."""
    return _compare((*effect_rows(first), *gap_rows(first)),
                    (*effect_rows(second), *gap_rows(second)), _verdict(first), _verdict(second))


def _compare(one: Iterable[Row], other: Iterable[Row], first: Mapping[str, Any],
             second: Mapping[str, Any]) -> Comparison:
    before, after = ({row.key: row for row in found} for found in (one, other))
    units = {key: (before[key].unit, after[key].unit) for key in before
             if key in after and before[key].unit != after[key].unit}
    return Comparison(
        tuple(Change(row, after[key]) for key, row in before.items()
              if key in after and key not in units),
        {**{key: (first[key], second[key]) for key in first if first[key] != second[key]},
         **{f'{key}.unit': both for key, both in units.items()}},
        tuple(key for key in before if key not in after),
        tuple(key for key in after if key not in before))


def effect_rows(d: 'Diagnosis') -> Iterator[Row]:
    """Yield every parameter of the effects that a diagnosis names."""
    for effect in d.effects:
        for key, p in effect.parameters.items():
            yield Row(f'{effect.name} {key}', f'effects.{effect.name}.{key}', p.unit, p.value,
                      p.std)


def gap_rows(d: 'Diagnosis') -> Iterator[Row]:
    """Yield how far recording and simulation are apart; only the share has a standard error."""
    if d.gap is None:
        return
    for key, words in (('nominal', 'gap as the model is'), ('recalibrated', 'gap, recalibrated'),
                       ('explained', 'gap after the effects')):
        yield Row(words, f'gap.{key}', 'noise RMS', getattr(d.gap, key), nan)
    low, high = d.gap.closed_ci95
    yield Row('share explained', 'gap.closed', '1', d.gap.closed, (high - low) / (2.0 * HALF))
    for name, (_, recalibrated, _, noise) in d.gap.channels.items():
        if noise > 0.0:
            yield Row(f'gap of {name}', f'gap.{name}', 'noise RMS', recalibrated / noise, nan)


def _verdict(d: 'Diagnosis') -> dict[str, Any]:
    """Return what a diagnosis states in addition to numbers."""
    place = d.localisation[0] if d.localisation else None
    return {'verdict': d.verdict, 'effects': [effect.name for effect in d.effects] or None,
            'candidates': [name for name, _ in d.candidates] or None,
            'first place': place and f'{place.channel} in {place.phase} ({place.stage})',
            'not excited': sorted(d.not_excited) or None}


def _all(c: Calibration) -> Iterator[tuple[str, str, Estimate, tuple[str, ...]]]:
    """Yield as :func:`estimates` does, what tables of one calibration leave out as well."""
    yield from estimates(c)
    if (a := c.accelerometer) and a.position:
        yield 'accelerometer position', 'accelerometer.position', a.position, tuple('xyz')
    if a and a.cutoff:
        yield 'accelerometer cutoff', 'accelerometer.cutoff', a.cutoff, ()
    if c.matrix:
        force_and_torque, _, raw = c.matrix.unit.partition(' per ')
        units = ', '.join(f'{unit} per {raw}' for unit in force_and_torque.split(', '))
        yield 'matrix', 'matrix', Estimate(c.matrix.value, c.matrix.std, units), tuple(
            f'{axis} {k + 1}' for axis in WRENCH_AXES for k in range(c.matrix.value.shape[1]))
    if c.matrix_offset:
        yield 'matrix offset', 'matrix.offset', c.matrix_offset, tuple(
            str(k + 1) for k in range(len(c.matrix_offset.value)))


def _settings(c: Calibration) -> dict[str, Any]:
    """Return what was chosen, not estimated."""
    return {'gravity': c.gravity, 'gravity_direction': c.gravity_direction,
            'sensor.rotation': c.sensor_rotation,
            'sensor.frame': c.sensor_frame, 'sensor.sign': c.wrench_sign,
            'accelerometer.coupling': c.accelerometer and c.accelerometer.coupling,
            'observer.mode': c.observer and c.observer.mode}


def _change(change: Change) -> tuple[str, str]:
    """Write a difference and half its 95 % interval, however small."""
    if 0 < change.std < FINEST:
        return f'{change.difference:.1e}', f'{HALF * change.std:.0e}'
    return (number(change.difference, change.std),
            error(replace(change.first, std=change.std)))


def _handy(change: Change) -> Change:
    """Return both numbers in one unit, that of the larger, or of its error."""
    first, second = change.first, change.second
    largest = max(abs(x) for one in (first, second) for x in (one.value, one.std) if isfinite(x))
    return Change(handy(first, largest), handy(second, largest))


def as_text(comparison: Comparison) -> str:
    """Return a table of all numbers, then what else differs, and the sum of it in one line."""
    head = ['estimate', 'first', 'second', 'change', '±', 'unit', '']
    changed = {c.first.key for c in comparison.changed}
    body = [[c.first.name, value(c.first), value(c.second), *_change(c),
             '' if c.first.unit == '1' else c.first.unit, 'changed' * (c.first.key in changed)]
            for c in map(_handy, comparison.changes)]
    lines = [*ruled(head, body, left=(0, 5, 6)), HALF_WIDTH, '']
    lines += [f'{key}: {_word(a)}, then {_word(b)}' for key, (a, b) in
              comparison.settings.items()]
    lines += [f'only in the {which}: {", ".join(keys)}' for which, keys in (
        ('first', comparison.only_first), ('second', comparison.only_second)) if keys]
    return '\n'.join([*lines, headline(comparison)])


def headline(comparison: Comparison) -> str:
    """Say in one line how much changed, and what most."""
    known = [one for one in comparison.changes if one.sigmas is not None]
    changed = comparison.changed
    most = ''.join(f', {c.first.name} most: '
                   f'{quantity(c.difference, c.std, c.first.unit, signed=True).strip()}'
                   for c in changed[:1])
    return (f'{len(changed)} of {len(known)} numbers changed by more than twice their '
            f'95 % interval{most}')


def to_document(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison as JSON can hold it; what is not known is None."""
    return {
        'format': FORMAT,
        'estimates': {c.first.key: {
            'first': c.first.value, 'second': c.second.value, 'change': c.difference,
            'std': c.std if isfinite(c.std) else None, 'sigmas': c.sigmas,
            'unit': c.first.unit} for c in comparison.changes},
        'changed': [c.first.key for c in comparison.changed],
        'settings': {key: {'first': plain(a), 'second': plain(b)}
                     for key, (a, b) in comparison.settings.items()},
        'only_first': list(comparison.only_first), 'only_second': list(comparison.only_second)}


def _word(value: Any) -> str:
    if isinstance(value, list):
        return ', '.join(map(str, value))
    return 'not stated' if value is None else str(value)
