"""Effects in the sensors and their clocks that the library names, in forms of their own."""

import math
from typing import Any

from blind.effect import direction, Effect, sensing, sign
from blind.noise import SIGMA
from blind.rig import Rig, rotation
from blind.robot import Array
from blind.sensors import FINE
from numba import njit
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, lfilter, lfilter_zi

Random = np.random.Generator


def delayed(t: Array, signal: Array, delay: float) -> Array:
    """Return the signal as it was ``delay`` ago, held before its start."""
    out: Array = CubicSpline(t, signal)(np.maximum(t - delay, 0.0))
    return out


def second_order(signal: Array, w: float, damping: float) -> Array:
    """Filter by w^2 / (p^2 + 2 damping w p + w^2), at rest at the first sample."""
    b, a = bilinear([w * w], [1.0, 2 * damping * w, w * w], fs=1 / FINE)
    out: Array = lfilter(b, a, signal, axis=0,
                         zi=lfilter_zi(b, a)[:, None] * signal[:1])[0]
    return out


def _wrench_delay(rig: Rig, size: float, rng: Random) -> Rig:
    return sensing(rig, wrench=lambda truth, u, _: delayed(truth.t, u, size))


def _wrench_lowpass(rig: Rig, size: float, rng: Random) -> Rig:
    """Filter by second order; ``size`` is its delay at low frequency."""
    damping = rng.uniform(0.65, 1.0)
    return sensing(rig, wrench=lambda truth, u, _: second_order(u, 2 * damping / size, damping))


def _drift(rig: Rig, size: float, rng: Random) -> Rig:
    """Let the bias settle exponentially, as the sensor warms up."""
    along = np.concatenate([direction(rng), 0.05 * direction(rng)])
    settle = rng.uniform(6.0, 40.0)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        rise = (1 - np.exp(-truth.t / settle)) / (1 - math.exp(-truth.t[-1] / settle))
        return u + size * np.outer(rise, along)

    return sensing(rig, wrench=stage)


def _axes(rng: Random, count: int, most: int) -> Array:
    """Draw some axes, each with a sign."""
    chosen = np.zeros(count)
    picked = rng.choice(count, size=rng.integers(1, most + 1), replace=False)
    chosen[picked] = rng.choice([-1.0, 1.0], len(picked)) * rng.uniform(0.6, 1.0, len(picked))
    return chosen


def _wrench_gain(rig: Rig, size: float, rng: Random) -> Rig:
    sensors = rig.sensors
    gain = sensors.gain * (1 + size * np.concatenate([_axes(rng, 3, 3), np.zeros(3)]))
    return rig._replace(sensors=sensors._replace(gain=gain))


def _wrench_crosstalk(rig: Rig, size: float, rng: Random) -> Rig:
    """Let one or two forces leak into other channels; into torques by a lever of 50 mm."""
    matrix = np.eye(6)
    for _ in range(rng.integers(1, 3)):
        source = rng.integers(3)
        target = rng.choice([i for i in range(6) if i != source])
        matrix[target, source] += sign(rng) * size * (0.05 if target > 2 else 1.0)
    return sensing(rig, wrench=lambda truth, u, _: u @ matrix.T)


@njit(cache=True)
def _bouc_wen(x, width):  # type: ignore[no-untyped-def]
    z = np.zeros_like(x)
    for n in range(1, len(x)):
        for j in range(x.shape[1]):
            step, last = x[n, j] - x[n - 1, j], z[n - 1, j]
            z[n, j] = last + step - (0.6 * abs(step) * last + 0.4 * step * abs(last)) / width[j]
    return z


def _wrench_hysteresis(rig: Rig, size: float, rng: Random) -> Rig:
    """Add a Bouc-Wen loop, smooth everywhere; ``size`` is its half height on the forces."""
    scale = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    yields = scale * rng.uniform(10.0, 25.0)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        return np.asarray(u + size * scale * (_bouc_wen(u, yields) / yields))

    return sensing(rig, wrench=stage)


def _limited(values: Array, limit: float, knee: float) -> Array:
    """Clip at +-limit with a knee that is a share of it wide."""
    x = values / limit
    over = np.maximum(np.abs(x) - (1 - knee), 0.0)
    bent = np.sign(x) * (1 - knee + knee * np.tanh(over / knee))
    return np.asarray(limit * np.where(over > 0, bent, x))


def _wrench_saturation(rig: Rig, size: float, rng: Random) -> Rig:
    """Limit an amplifier, with a knee of 1 %; ``size``: how far below usual peaks."""
    axis = int(rng.integers(3))
    limit = (1 - size) * (90.0, 90.0, 180.0)[axis]

    def stage(truth: Any, u: Array, _: Random) -> Array:
        out = u.copy()
        out[:, axis] = _limited(u[:, axis], limit, 0.01)
        return out

    return sensing(rig, wrench_reading=stage)


def _wrench_quantisation(rig: Rig, size: float, rng: Random) -> Rig:
    """Convert with codes that stand for the middle of their interval."""
    step = size * SIGMA['wrench'] / 0.25
    return sensing(rig, wrench_reading=lambda truth, u, _: step * (np.floor(u / step) + 0.5))


def _accel_delay(rig: Rig, size: float, rng: Random) -> Rig:
    return sensing(rig, specific=lambda truth, f, _: delayed(truth.t, f, size))


def _accel_gain(rig: Rig, size: float, rng: Random) -> Rig:
    sensors = rig.sensors
    return rig._replace(sensors=sensors._replace(
        accel_gain=sensors.accel_gain * (1 + size * _axes(rng, 3, 3))))


def _accel_bias(rig: Rig, size: float, rng: Random) -> Rig:
    sensors = rig.sensors
    return rig._replace(sensors=sensors._replace(
        accel_offset=sensors.accel_offset + size * _axes(rng, 3, 3)))


def _accel_misalignment(rig: Rig, size: float, rng: Random) -> Rig:
    R = rotation(size * direction(rng))
    return sensing(rig, specific=lambda truth, f, _: f @ R)


def _accel_highpass(rig: Rig, size: float, rng: Random) -> Rig:
    """Let a charge amplifier, reset as the recording starts, leak from then on."""
    pole = math.exp(-size * FINE)

    def stage(truth: Any, f: Array, _: Random) -> Array:
        return f - np.asarray(lfilter([1 - pole], [1, -pole], f, axis=0))

    return sensing(rig, specific=stage)


def _accel_saturation(rig: Rig, size: float, rng: Random) -> Rig:
    """Limit the range, with a knee of 1 %; ``size``: how far below usual peaks."""
    axis = int(rng.integers(3))
    limit = (1 - size) * (7.0, 8.0, 14.5)[axis]

    def stage(truth: Any, f: Array, _: Random) -> Array:
        out = f.copy()
        out[:, axis] = _limited(f[:, axis], limit, 0.01)
        return out

    return sensing(rig, specific=stage)


def _accel_resonance(rig: Rig, size: float, rng: Random) -> Rig:
    """Mount it softly: all of its signal passes a second-order system."""
    damping = rng.uniform(0.02, 0.1)
    return sensing(rig, specific=lambda truth, f, _: second_order(
        f, 2 * math.pi / size, damping))


def _clock_skew(rig: Rig, size: float, rng: Random) -> Rig:
    """Stamp by a clock of its own, whose speed changes a little as it warms up."""
    which, fast = str(rng.choice(['wrench_t', 'volts_t'])), sign(rng)
    wander = rng.uniform(0.0, 0.03)

    def stage(truth: Any, recorded: Any, _: Random) -> Any:
        t = getattr(recorded, which)
        warmed = t + wander * 10.0 * (np.exp(-t / 10.0) - 1)
        return recorded._replace(**{which: t + fast * size * warmed})

    return sensing(rig, stamps=stage)


def _dropouts(rig: Rig, size: float, rng: Random) -> Rig:
    """Lose bursts of a few messages (Gilbert), of one topic or of both sensors."""
    burst = rng.uniform(1.0, 6.0)
    topics = [['wrench'], ['volts'], ['wrench', 'volts']][rng.integers(3)]

    def lost(count: int, source: Random) -> Any:
        out = np.zeros(count, bool)
        starts = np.flatnonzero(source.random(count) < size / burst)
        for start in starts:
            out[start:start + source.geometric(1 / burst)] = True
        out[[0, -1]] = False
        return out

    def stage(truth: Any, recorded: Any, source: Random) -> Any:
        for topic in topics:
            kept = ~lost(len(getattr(recorded, topic)), source)
            recorded = recorded._replace(**{
                topic: getattr(recorded, topic)[kept],
                topic + '_t': getattr(recorded, topic + '_t')[kept]})
        return recorded

    return sensing(rig, stamps=stage)


DEGREE = math.pi / 180

EFFECTS = (
    Effect('wrench_delay', 'wrench_sensor', 2e-5, 0.02, 's', _wrench_delay),
    Effect('wrench_lowpass', 'wrench_sensor', 5e-5, 0.03, 's', _wrench_lowpass),
    Effect('wrench_bias_drift', 'wrench_sensor', 0.02, 10.0, 'N', _drift),
    Effect('wrench_gain', 'wrench_sensor', 0.009, 0.2, '1', _wrench_gain, 'wrench_gain'),
    Effect('wrench_crosstalk', 'wrench_sensor', 3e-4, 0.1, '1', _wrench_crosstalk),
    Effect('wrench_hysteresis', 'wrench_sensor', 0.02, 4.0, 'N', _wrench_hysteresis),
    Effect('wrench_saturation', 'wrench_sensor', 0.02, 0.5, '1', _wrench_saturation),
    Effect('wrench_quantisation', 'wrench_sensor', 0.05, 5.0, 'N', _wrench_quantisation,
           random=True),
    Effect('accel_delay', 'accelerometer', 5e-5, 0.02, 's', _accel_delay),
    Effect('accel_gain', 'accelerometer', 0.009, 0.2, '1', _accel_gain, 'accel_gain'),
    Effect('accel_bias', 'accelerometer', 0.045, 1.0, 'V', _accel_bias, 'accel_offset'),
    Effect('accel_misalignment', 'accelerometer', 0.03 * DEGREE, 10 * DEGREE, 'rad',
           _accel_misalignment),
    Effect('accel_highpass', 'accelerometer', 2e-5, 1.0, '1/s', _accel_highpass),
    Effect('accel_saturation', 'accelerometer', 0.02, 0.5, '1', _accel_saturation),
    Effect('accel_resonance', 'accelerometer', 1 / 350, 1 / 20, 's', _accel_resonance),
    Effect('clock_skew', 'timing', 2e-7, 2e-3, '1', _clock_skew, random=True),
    Effect('dropouts', 'timing', 1e-3, 0.1, '1', _dropouts, random=True),
)
