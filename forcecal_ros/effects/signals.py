"""Effects on sampled signals and stamps: one function each, from its values to an operator.

An operator takes the next samples and continues where it stopped, so that a live signal is
changed as a recorded one is. The tables list in which order they compose.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from forcecal_ros.core.geometry import Array, rotation_from_vector
from forcecal_ros.core.jit import compiled
from forcecal_ros.effects.library import EFFECTS, FORCES, named_effects, STREAMS
from forcecal_ros.effects.rig import Rig
import numpy as np
from numpy.typing import NDArray

Operator = Callable[[Array], Array]
"""Changes the next samples of a signal, shape (n, k), and keeps what it needs for those after."""


class Delay:
    """
    A delay by any fraction of a sample: Lagrange interpolation between the nearest samples.

    Parameters
    ----------
    delay : float
        [s]
    dt : float
        Between samples [s].
    """

    def __init__(self, delay: float, dt: float) -> None:
        # samples a delay interpolates between; accurate to 1.3e-3 up to a tenth of the
        # sample rate
        taps = 6
        back = delay / dt
        first = max(0, int(np.floor(back)) - (taps // 2 - 1))
        self._offsets = np.arange(first, first + taps)
        others = [np.delete(self._offsets, i) for i in range(taps)]
        self._weights = [np.prod((back - other) / (offset - other))
                         for offset, other in zip(self._offsets, others)]
        self._past: Array | None = None

    def __call__(self, signal: Array) -> Array:
        """Delay the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        reach = int(self._offsets[-1])
        if self._past is None:
            self._past = np.repeat(signal[:1], reach, axis=0)
        line = np.concatenate([self._past, signal])
        self._past = line[len(line) - reach:]
        out = np.zeros_like(signal)
        for weight, offset in zip(self._weights, self._offsets):
            if weight:
                out += weight * line[reach - offset:len(line) - offset]
        return out


class Filter:
    """
    A proper rational transfer function, exact for signals that are linear between samples.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients of powers of s [rad/s], highest first; the numerator has at most as many.
    dt : float
        Between samples [s].
    settled : float
        Share of the first sample that the filter had settled to before.
    """

    def __init__(self, numerator: Sequence[float], denominator: Sequence[float], dt: float,
                 settled: float = 1.0) -> None:
        # takes a second, which a node does not start with
        from scipy.signal import cont2discrete, lfilter, lfiltic

        (b,), a, _ = cont2discrete((numerator, denominator), dt, method='foh')
        before = np.ones(len(a) - 1)
        self._rest = lfiltic(b, a, settled * numerator[-1] / denominator[-1] * before, before)
        self._state: Array | None = None
        self._filter = partial(lfilter, b, a, axis=0)

    def __call__(self, signal: Array) -> Array:
        """Filter the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        if self._state is None:
            self._state = np.outer(self._rest, signal[0])
        out, self._state = self._filter(signal, zi=self._state)
        return np.asarray(out)


class Hysteresis:
    """
    A signal less the part that friction inside the sensor holds back.

    y = x - height / width * z, where z follows x within +-width as Bouc and Wen have it:
    dz = dx (1 - (z / width)^n) on the way to the bound, dz = dx on the way back. At first, z = 0.
    Without softness, n is infinite (an elasto-plastic element): after a reversal by 2 width the
    reading lags by the height again.

    Parameters
    ----------
    height : float
        Largest lag of the reading [unit of the signal].
    width : float
        Travel of the signal after which the lag is full [unit of the signal].
    softness : float
        1 / n: how gradually it gets there, from 0 to 1.
    """

    def __init__(self, height: float, width: float, softness: float = 0.0) -> None:
        self._ratio, self._width = height / width, width
        # softness up to which a hysteresis counts as elasto-plastic: exponents of 50 and more
        self._exponent = 1.0 / softness if softness > 0.02 else 0.0
        self._last: Array | None = None
        self(np.zeros((1, 1)))  # compiles, before it is needed in real time
        self._last = None

    def __call__(self, signal: Array) -> Array:
        """Pass on the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        if self._last is None:
            self._last, self._held = signal[0].copy(), np.zeros(signal.shape[1])
        held = np.empty(signal.shape)
        _stop(np.ascontiguousarray(signal), self._last, self._held, self._width, self._exponent,
              held)
        return signal - self._ratio * held


@compiled
def _stop(signal: Array, last: Array, held: Array, width: float, exponent: float,
          out: Array) -> None:
    """Write what follows the signal within +-width; ``last`` and ``held`` are its state."""
    for i in range(len(signal)):
        for k in range(len(last)):
            step = signal[i, k] - last[k]
            if exponent > 0.0 and step * held[k] > 0.0:
                step *= 1.0 - (abs(held[k]) / width) ** exponent
            held[k] = min(max(held[k] + step, -width), width)
            last[k] = signal[i, k]
            out[i, k] = held[k]


Named = Mapping[str, float]


def _vector(v: Named, *names: str) -> Array:
    return np.array([v[name] for name in names])


def _delay(v: Named, dt: float) -> Operator:
    return Delay(v['delay'], dt)


def _wrench_lowpass(v: Named, dt: float) -> Operator:
    """1 / (1 + T s + c T^2 s^2): c = 0 is of first order, c = 1/2 a Butterworth of second."""
    lag, curvature = v['time_constant'], v['second_order'] * v['time_constant'] ** 2
    if not lag:
        return lambda wrench: wrench
    return Filter([1.0], [curvature, lag, 1.0] if curvature else [lag, 1.0], dt)


class _Drift:
    """A ramp that begins with the signal, or, where it settles, levels off exponentially."""

    def __init__(self, rates: Array, settling: float, dt: float) -> None:
        self._rates, self._settling, self._dt, self._count = rates, settling, dt, 0

    def __call__(self, signal: Array) -> Array:
        t = self._dt * np.arange(self._count + 1, self._count + len(signal) + 1)
        self._count += len(signal)
        if self._settling:
            t = -np.expm1(-self._settling * t) / self._settling
        return signal + np.outer(t, self._rates)


def _wrench_bias_drift(v: Named, dt: float) -> Operator:
    return _Drift(_vector(v, *FORCES), v['settling'], dt)


def _wrench_gain(v: Named, dt: float) -> Operator:
    gain = 1.0 + _vector(v, *FORCES)
    return lambda wrench: wrench * gain


def _wrench_crosstalk(v: Named, dt: float) -> Operator:
    matrix = np.eye(6)
    for name, value in v.items():
        to, source = name.split('_of_')
        matrix[FORCES.index(to), FORCES.index(source)] = value
    return lambda wrench: wrench @ matrix.T


def _wrench_hysteresis(v: Named, dt: float) -> Operator:
    forces = Hysteresis(v['height'], v['width'], v['softness'])
    torques = Hysteresis(v['torque_height'], v['width'] * v['lever'], v['softness'])
    return lambda wrench: np.hstack([forces(wrench[:, :3]), torques(wrench[:, 3:])])


def _wrench_saturation(v: Named, dt: float) -> Operator:
    limit = np.minimum(np.repeat([v['limit'], v['torque_limit']], 3), _vector(v, *FORCES))
    return lambda wrench: np.clip(wrench, -limit, limit)


def _wrench_quantisation(v: Named, dt: float) -> Operator:
    def rounded(wrench: Array) -> Array:
        out = wrench.copy()
        for part, step in ((slice(0, 3), v['step']), (slice(3, 6), v['torque_step'])):
            if step:
                out[:, part] = step * np.round(out[:, part] / step)
        return out
    return rounded


def _accel_gain(v: Named, dt: float) -> Operator:
    gain = 1.0 + _vector(v, *'xyz')
    return lambda force: force * gain


def _accel_misalignment(v: Named, dt: float) -> Operator:
    """Turn the axes of the accelerometer, by a rotation vector in S."""
    R_sensor_accelerometer = rotation_from_vector(_vector(v, *'xyz'))
    return lambda force: force @ R_sensor_accelerometer


def _accel_highpass(v: Named, dt: float) -> Operator:
    """dy/dt = dx/dt - rate y; before the start, the first x was there for so long."""
    rate = v['rate']
    if not rate:
        return lambda force: force
    slow = Filter([rate], [1.0, rate], dt, settled=-np.expm1(-rate * v['before']))
    return lambda force: force - slow(force)


def _accel_resonance(v: Named, dt: float) -> Operator:
    """1 + amplitude (w^2 / (s^2 + 2 zeta w s + w^2) - 1): at 1, the sensor sits on a spring."""
    w = 2.0 * np.pi * v['frequency']
    mount = Filter([w * w], [1.0, 2.0 * v['damping'] * w, w * w], dt)
    return lambda force: force + v['amplitude'] * (mount(force) - force)


def _accel_saturation(v: Named, dt: float) -> Operator:
    limit = np.minimum(v['limit'], _vector(v, *'xyz'))
    return lambda force: np.clip(force, -limit, limit)


def _accel_bias(v: Named, dt: float) -> Operator:
    bias = _vector(v, *'xyz')
    return lambda volts: volts + bias


Builders = Mapping[str, Callable[[Named, float], Operator]]

WRENCH: Builders = {
    'wrench_hysteresis': _wrench_hysteresis, 'wrench_gain': _wrench_gain,
    'wrench_crosstalk': _wrench_crosstalk, 'wrench_lowpass': _wrench_lowpass,
    'wrench_delay': _delay, 'wrench_bias_drift': _wrench_bias_drift,
}
"""Acting on the wrench without bias and noise [N], [N m]."""

WIRE: Builders = {
    'wrench_saturation': _wrench_saturation, 'wrench_quantisation': _wrench_quantisation,
}
"""Acting on the wrench as on the wire, noise included [N], [N m]."""

SPECIFIC_FORCE: Builders = {
    'accel_misalignment': _accel_misalignment, 'accel_highpass': _accel_highpass,
    'accel_resonance': _accel_resonance, 'accel_gain': _accel_gain, 'accel_delay': _delay,
}
"""Acting on what the accelerometer responds to [m/s^2]."""

VOLTS: Builders = {'accel_bias': _accel_bias}
"""Acting on the accelerometer's volts without noise."""

READING: Builders = {'accel_saturation': _accel_saturation}
"""Acting on the accelerometer's volts, noise included, as specific force [m/s^2]."""


def _operators(rig: Rig, builders: Builders, dt: float) -> tuple[Operator, ...]:
    named = named_effects(rig.effects)
    return tuple(
        build(named[name], dt) for name, build in builders.items()
        if any(named.get(name, {}).get(q.name, q.nominal) != q.nominal
               for q in EFFECTS[name].parameters))


def _through(operators: tuple[Operator, ...], signal: Array) -> Array:
    for operator in operators:
        signal = operator(signal)
    return signal


class WrenchEffects:
    """
    What a rig's effects do to the signal of its wrench sensor, block after block.

    Parameters
    ----------
    dt : float
        Between samples [s].
    """

    def __init__(self, rig: Rig, dt: float) -> None:
        self._bias = np.array(rig.wrench_sensor.bias)
        self._before, self._after = _operators(rig, WRENCH, dt), _operators(rig, WIRE, dt)

    def before_noise(self, wrench: Array) -> Array:
        """Change the next samples, on the wire but without noise, shape (n, 6)."""
        if not self._before:
            return wrench
        return np.asarray(_through(self._before, wrench - self._bias) + self._bias)

    def after_noise(self, wrench: Array) -> Array:
        """Change the next samples, noise included, shape (n, 6)."""
        return _through(self._after, wrench)


class AccelerometerEffects:
    """
    What a rig's effects do to the signal of its accelerometer, block after block.

    Parameters
    ----------
    accelerometer : str or None
        ``acc1`` or ``acc2``; the mounted one where none is given.
    dt : float
        Between samples [s].
    """

    def __init__(self, rig: Rig, accelerometer: str | None, dt: float) -> None:
        model = rig.accelerometer.model(accelerometer)
        self._gain, self._offset = np.array(model.gain), np.array(model.offset)
        self._force = _operators(rig, SPECIFIC_FORCE, dt)
        self._volts, self._reading = _operators(rig, VOLTS, dt), _operators(rig, READING, dt)

    def before_noise(self, volts: Array) -> Array:
        """Change the next samples without noise, shape (n, 3) [V]."""
        return _through(self._volts, self._as_force(self._force, volts))

    def after_noise(self, volts: Array) -> Array:
        """Change the next samples, noise included, shape (n, 3) [V]."""
        return self._as_force(self._reading, volts)

    def _as_force(self, operators: tuple[Operator, ...], volts: Array) -> Array:
        if not operators:
            return volts
        force = _through(operators, (volts - self._offset) / self._gain)
        return np.asarray(force * self._gain + self._offset)


INVERTIBLE = frozenset({'accel_gain', 'accel_bias', 'accel_misalignment'})
"""Effects of the accelerometer without memory, all of them one to one."""


def specific_force_of(rig: Rig, accelerometer: str | None, volts: Array) -> Array:
    """
    Return the specific force that an accelerometer answers with volts, shape (n, 3) [m/s^2].

    Of a rig's effects it takes the invertible ones for acting, and no other: the inverse of
    ``AccelerometerEffects.before_noise`` with these.
    """
    model, named = rig.accelerometer.model(accelerometer), named_effects(rig.effects)
    bias, gain, turn = (np.array([named.get(name, {}).get(axis, 0.0) for axis in 'xyz'])
                        for name in ('accel_bias', 'accel_gain', 'accel_misalignment'))
    force = (volts - model.offset - bias) / (model.gain * (1.0 + gain))
    return np.asarray(force @ rotation_from_vector(turn).T)


class StampEffects:
    """
    What a rig's effects do to the stamps of its sensors' samples.

    Parameters
    ----------
    seed : numpy.random.SeedSequence
        Of the losses; those of one stream do not depend on the others.
    """

    def __init__(self, rig: Rig, seed: np.random.SeedSequence) -> None:
        named = named_effects(rig.effects)
        self._skew = named.get('clock_skew', {})
        self._lost = named.get('dropouts', {})
        self._generators = dict(zip(STREAMS, map(
            np.random.default_rng, seed.spawn(len(STREAMS)))))

    @property
    def loses(self) -> bool:
        """Whether anything gets lost."""
        return any(self._lost.values())

    def stamps(self, stream: str, t: Array) -> Array:
        """Return what the stream's clock shows at times since the start [s]."""
        return t * (1.0 + self._skew.get(stream, 0.0))

    def arrived(self, stream: str, n: int) -> NDArray[np.bool_]:
        """Say which of the next n samples arrive."""
        fraction = self._lost.get(stream, 0.0)
        return np.asarray(self._generators[stream].random(n) >= fraction)
