"""What the wrench sensor should read when the tool moves as measured, and what may differ."""

from collections.abc import Mapping
from typing import NamedTuple

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.motion.case import ACCEL, LARGEST_DELAY, MotionCase
from forcecal_ros.diagnose.motion.known import Known
from forcecal_ros.geometry import Array, rotation_from_vector
import numpy as np


class Term(NamedTuple):
    """
    One number that may depart from what is known.

    Attributes
    ----------
    name : str
        Of the parameter, as ``bias.fz``.
    effect : str
        That it belongs to.
    axis : str
        Of a term that may come alone; empty where all of the effect come together.
    quantity, unit : str
        What the effect calls it.
    spread : float
        One standard deviation of a sound rig; 0: nothing departs unless the effect is there.
    typical : float
        A size that is clearly visible.
    """

    name: str
    effect: str
    axis: str
    quantity: str
    unit: str
    spread: float
    typical: float

    @property
    def part(self) -> str:
        """What comes as a whole or not at all: the effect, or one axis of it."""
        return f'{self.effect}.{self.axis}' if self.axis else self.effect

    @property
    def unit_size(self) -> float:
        """What it is counted in: a spread, or a typical size where there is none."""
        return self.spread or self.typical


WRENCH_AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
CROSSTALK = tuple(
    (f'{to}_of_{source}', i, j, 'm' if j < 3 <= i else '1', 0.003 if j < 3 <= i else 0.05)
    for i, to in enumerate(WRENCH_AXES) for j, source in enumerate(WRENCH_AXES)
    if i != j and (i >= 3 or j < 3))
"""Name, axis to, axis of, unit, typical size."""
DELAYS = ('wrench_delay', 'accel_delay')
"""Effects that are scanned for: a delay is far from linear."""


def terms_of(known: Known, case: MotionCase) -> tuple[Term, ...]:
    """
    List what may be otherwise, as far as the streams at hand can show it.

    Parameters
    ----------
    known : Known
    case : MotionCase

    Returns
    -------
    tuple of Term
    """
    s = known.spread
    found = [Term('mass', 'tool_mass', '', 'change', 'kg', float(s['mass'][0]),
                  0.05 * known.mass)]
    found += [Term(f'moment.{a}', 'tool_com', '', a, 'kg m', float(s['moment'][i]),
                   0.005 * known.mass) for i, a in enumerate('xyz')]
    for i, axis in enumerate(WRENCH_AXES):
        unit, size = ('N', 1.0) if i < 3 else ('N m', 0.1)
        found += [Term(f'bias.{axis}', 'wrench_bias', '', axis, unit, float(s['bias'][i]), size),
                  Term(f'gain.{axis}', 'wrench_gain', axis, axis, '1', 0.0, 0.05),
                  Term(f'drift.{axis}', 'wrench_bias_drift', axis, axis, f'{unit}/s', 0.0,
                       0.05 * size)]
    found += [Term(f'crosstalk.{name}', 'wrench_crosstalk', name, name, unit, 0.0, size)
              for name, _, _, unit, size in CROSSTALK]
    found += [Term(f'tilt.{a}', 'base_tilt', '', a, 'rad', 0.0, 0.01) for a in 'xy']
    found.append(Term('wrench_delay', 'wrench_delay', '', 'delay', 's', 0.0, 0.004))
    if case.accelerated and not known.dynamic:
        found.append(Term('inertial', 'inertial_force', '', 'fraction', '1', 0.0, 1.0))
    if case.recording.accelerometer is not None and known.sensitivity is not None:
        found += [Term(f'accel.{a}', 'accel_bias', '', a, 'm/s^2', float(s['accel'][i]), 0.3)
                  for i, a in enumerate('xyz')]
        found += [Term(f'turn.{a}', 'accel_misalignment', '', a, 'rad', 0.0, 0.03)
                  for a in 'xyz']
        found += [Term(f'accel_gain.{a}', 'accel_gain', '', a, '1', 0.0, 0.05) for a in 'xyz']
        found.append(Term('accel_delay', 'accel_delay', '', 'delay', 's', 0.0, 0.004))
    return tuple(found)


def predict(case: MotionCase, values: Mapping[str, float]) -> Array:
    """
    Predict every channel.

    Parameters
    ----------
    case : MotionCase
    values : mapping of str to float
        Departure of every parameter by name; 0 where it is not named.

    Returns
    -------
    ndarray, shape (n, 16)
        Zero where the case measures nothing.
    """
    known = case.known

    def of(name: str, axes: tuple[str, ...] = ('x', 'y', 'z')) -> Array:
        return np.array([values.get(f'{name}.{a}', 0.0) for a in axes])

    fraction = values.get('inertial', 0.0) + float(known.dynamic)
    late = float(np.clip(values.get('wrench_delay', 0.0), -LARGEST_DELAY, LARGEST_DELAY))
    behind = known.delay + values.get('accel_delay', 0.0) - late
    zenith = rotation_from_vector([*of('tilt', ('x', 'y')), 0.0])[:, 2]
    up = case.gravity(late, zenith)
    total = case.force(float(np.clip(behind, -LARGEST_DELAY, LARGEST_DELAY)))
    off, scale = of('accel'), 1.0 + of('accel_gain')
    R_accelerometer = rotation_from_vector(of('turn'))
    pulled = ((total - off) / scale) @ R_accelerometer
    f = up + fraction * (pulled - up)
    mass = known.mass + values.get('mass', 0.0)
    moment = mass * known.com + of('moment')
    arm = moment + mass * case.slide[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    out = np.zeros((len(f), len(CHANNELS)))
    out[:, :3] = -mass * f
    out[:, 3:6] = -np.cross(arm, f) - fraction * case.spin
    mixed = np.diag(1.0 + of('gain', WRENCH_AXES))
    for name, i, j, _, _ in CROSSTALK:
        mixed[i, j] = values.get(f'crosstalk.{name}', 0.0)
    out[:, :6] = out[:, :6] @ mixed.T
    elapsed = case.times - case.times[0]
    out[:, :6] += known.bias + of('bias', WRENCH_AXES)
    out[:, :6] += elapsed[:, np.newaxis] * of('drift', WRENCH_AXES)
    out[:, ACCEL] = (up @ R_accelerometer.T) * scale + off
    out[~case.present] = 0.0
    return np.nan_to_num(out)

