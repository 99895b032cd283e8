"""Simulators that others wrote: loaded by name, answers checked, parameters known so well."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
import importlib
import math
from pathlib import Path
import sys
import traceback
from typing import Any

from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion
from forcecal_ros.core.safe_yaml import load_yaml
from forcecal_ros.core.schema import instead
from forcecal_ros.core.streams import JointStream, PoseStream, Recording, Stream
from forcecal_ros.sim.protocol import Inputs, Parameter, Simulator
from forcecal_ros.sim.signals import JOINTS
import numpy as np

STREAMS = {'wrench': 6, 'pose': 7, 'accelerometer': 3}
"""What may be simulated, and how many columns it has; beside it as many joints as are measured."""

NEEDED = ('wrench', 'pose')

STAGES = ('robot', 'tool', 'environment')


@dataclass(frozen=True)
class ThirdParty:
    """
    A third-party simulator, whose every answer is checked.

    Attributes
    ----------
    name : str
        For messages.
    simulator : Simulator
    parameters : tuple of Parameter
    notes : tuple of str
        What the user should know of it, where it has such an attribute.
    linear : bool
        Whether values are what its signals are nearly linear in, and not its own numbers.
    """

    name: str
    simulator: Simulator
    parameters: tuple[Parameter, ...]
    notes: tuple[str, ...] = ()
    linear: bool = False

    @property
    def nominal(self) -> tuple[float, ...]:
        """Values of all parameters as they are."""
        return tuple(p.nominal for p in self.parameters)

    def on_linear_scale(self) -> 'ThirdParty':
        """Return it with values that its signals are nearly linear in."""
        return replace(self, linear=True, parameters=tuple(
            p._replace(low=p.to_linear(p.low), high=p.to_linear(p.high))
            for p in self.parameters))

    def numbers(self, values: Sequence[float]) -> dict[str, float]:
        """Return its own numbers by name."""
        return {p.name: float(p.from_linear(v)[0] if self.linear else v)
                for p, v in zip(self.parameters, values)}

    def run(self, inputs: Inputs, values: Sequence[float]) -> Recording:
        """
        Simulate.

        Parameters
        ----------
        values : sequence of float
            One for each parameter.

        Returns
        -------
        Recording
            On the clock of the inputs.

        Raises
        ------
        ConfigError
            It raised an exception, or answers otherwise than the protocol requires.
        """
        return self._recording(inputs, 'simulate', values)

    def acting(self, inputs: Sequence[Inputs]) -> 'ThirdParty':
        """Leave out parameters that, as it states, can act under none of these commands."""
        never = set.intersection(*(set(self._optional('idle', list, one) or ()) for one in inputs))
        return replace(self, parameters=tuple(
            p for p in self.parameters if p.name not in never))

    def remarks(self, inputs: Inputs) -> tuple[str, ...]:
        """Return what it reports of a run under these commands, where it has such a method."""
        return tuple(map(str, self._optional('remarks', list, inputs) or ()))

    def _optional(self, method: str, kind: Callable[[Any], Any], given: Any) -> Any:
        """Call a method that a simulator may have, and make a kind of it; None: it has none."""
        own = getattr(self.simulator, method, None)
        with _blamed(f'{self.name}: {method}'):
            return None if own is None else kind(own(given))

    @property
    def has_finer(self) -> bool:
        """Whether it can be run with half its step of integration."""
        return callable(getattr(self.simulator, 'simulate_finer', None))

    def run_finer(self, inputs: Inputs, values: Sequence[float]) -> Recording:
        """Simulate with half its step of integration; otherwise as :meth:`run`."""
        return self._recording(inputs, 'simulate_finer', values)

    def _recording(self, inputs: Inputs, method: str, values: Sequence[float]) -> Recording:
        with _blamed(f'{self.name}: {method}'):
            answer = getattr(self.simulator, method)(inputs, self.numbers(values))
        if not isinstance(answer, Mapping):
            raise ConfigError(f'{self.name}: simulate returned {type(answer).__name__}, expected '
                              'a mapping of streams to (stamps, rows)')
        rows = {name: self._stream(name, answer[name]) for name in STREAMS if name in answer}
        for name in NEEDED:
            if name not in rows:
                raise ConfigError(f'{self.name}: simulate returned no {name}, but '
                                  f'{", ".join(sorted(map(str, answer))) or "nothing"}; return '
                                  'wrench and pose')
        joints = self._joints(answer, inputs.measured_joints)
        for name, stream in [*rows.items(), *([('joints', joints)] if joints else [])]:
            if stream.t[0] > inputs.start + 0.1 or stream.t[-1] < inputs.end - 0.1:
                raise ConfigError(
                    f'{self.name}: {name} goes from {stream.t[0]:.2f} to {stream.t[-1]:.2f} s, '
                    f'expected {inputs.start:.2f} to {inputs.end:.2f} s; use inputs.start and end')
        return Recording(wrench=rows['wrench'], pose=_poses(self.name, rows['pose']),
                         accelerometer=rows.get('accelerometer'), accelerometer_unit='m/s^2',
                         joints=joints,
                         target=inputs.target, source=self.name)

    def patched(self, values: Sequence[float]) -> str | None:
        """Return the text of a model with other values; None of a simulator that writes none."""
        text = self._optional('patched', lambda one: one, self.numbers(values))
        if not isinstance(text, str | None):
            raise ConfigError(f'{self.name}: patched returned {type(text).__name__}, expected the '
                              'text of a model')
        return text

    def _joints(self, answer: Mapping[str, Any], names: tuple[str, ...]) -> JointStream | None:
        """Return the positions of those joints that the simulator has, of the first eight."""
        if 'joints' not in answer or not names:
            return None
        t, rows = self._numbers('joints', answer['joints'], len(names))
        had = np.flatnonzero(~np.isnan(rows).all(axis=0))[:JOINTS]
        if not len(had):
            return None
        stream = self._checked_stream('joints', t, rows[:, had])
        return JointStream(stream.t, stream.values, '', tuple(names[i] for i in had))

    def _stream(self, name: str, answer: Any) -> Stream:
        return self._checked_stream(name, *self._numbers(name, answer, STREAMS[name]))

    def _numbers(self, name: str, answer: Any, columns: int) -> tuple[Array, Array]:
        where = f'{self.name}: {name}'
        try:
            t, rows = (np.asarray(part, dtype=float) for part in answer)
        except (TypeError, ValueError):
            raise ConfigError(f'{where}: expected (stamps, rows) of numbers, got '
                              f'{type(answer).__name__}') from None
        if t.ndim != 1 or rows.shape != (len(t), columns) or len(t) < 20:
            raise ConfigError(f'{where}: stamps {t.shape} and rows {rows.shape}, expected (n,) '
                              f'and (n, {columns}), n at least 20')
        return t, rows

    def _checked_stream(self, name: str, t: Array, rows: Array) -> Stream:
        where = f'{self.name}: {name}'
        for what, part in (('stamp', t), ('row', rows)):
            bad = np.flatnonzero(~np.isfinite(part.reshape(len(t), -1)).all(axis=1))
            if len(bad):
                raise DataError(f'{where}: {what} {bad[0]} is not finite ({len(bad)} of '
                                f'{len(t)}); the simulation has diverged; check its time step')
        if (np.diff(t) <= 0.0).any():
            at = int(np.argmax(np.diff(t) <= 0.0))
            raise ConfigError(f'{where}: stamps do not increase at {t[at]:.6f} s')
        return Stream(t, rows)


def load_simulator(spec: str) -> ThirdParty:
    """
    Load a simulator by ``module:factory`` and ask it for its parameters.

    The module is looked for in the current folder, too. Its code is executed.

    Parameters
    ----------
    spec : str
        ``factory`` is called without arguments.

    Raises
    ------
    ConfigError
        No such module or factory; it raises an exception; it is no simulator.
    """
    module, colon, factory = spec.partition(':')
    if not (module and colon and factory):
        raise ConfigError(f'--simulator {spec}: expected MODULE:FACTORY, e.g. my_robot:simulator')
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    with _blamed(f'--simulator {spec}: importing {module}'):
        try:
            loaded = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or module.split('.')[0] != error.name.split('.')[0]:
                raise
            raise ConfigError(f'--simulator {spec}: no module {module} in this folder or in the '
                              'Python path') from None
    make = getattr(loaded, factory, None)
    if not callable(make):
        raise ConfigError(f'--simulator {spec}: {module} has no function {factory}')
    with _blamed(f'--simulator {spec}: {factory}()'):
        simulator = make()
    return third_party(spec, simulator)


def third_party(name: str, simulator: Any) -> ThirdParty:
    """
    Check that an object is a simulator, and its parameters.

    Parameters
    ----------
    name : str
        For messages.

    Raises
    ------
    ConfigError
        A method is missing; a parameter is twice there, has no sigma, or is out of its limits.
    """
    for method in ('parameters', 'simulate'):
        if not callable(getattr(simulator, method, None)):
            raise ConfigError(f'{name}: {type(simulator).__name__} has no method {method}; '
                              'a simulator has parameters() and simulate(inputs, parameters)')
    with _blamed(f'{name}: parameters'):
        listed = tuple(simulator.parameters())
    seen: set[str] = set()
    for p in listed:
        if not isinstance(p, Parameter):
            raise ConfigError(f'{name}: parameters returned {p!r}; expected '
                              'forcecal_ros.sim.protocol.Parameter')
        _check_parameter(name, p)
        if p.name in seen:
            raise ConfigError(f'{name}: parameter {p.name} is listed twice')
        seen.add(p.name)
    return ThirdParty(name, simulator, listed, tuple(getattr(simulator, 'notes', ())))


def _check_parameter(name: str, p: Parameter) -> None:
    where = f'{name}: parameter {p.name!r}'
    if not (isinstance(p.name, str) and p.name):
        raise ConfigError(f'{where}: expected a name')
    if not (np.isfinite(p.nominal) and p.low <= p.nominal <= p.high):
        raise ConfigError(f'{where}: nominal {p.nominal} is not within {p.low} to {p.high}')
    if not (np.isfinite(p.sigma) and p.sigma > 0.0):
        raise ConfigError(f'{where}: sigma {p.sigma}, expected a standard deviation above 0')
    if p.logarithmic and not p.low > 0.0:
        raise ConfigError(f'{where}: low {p.low}, expected above 0, as its logarithm is used')
    if p.stage not in STAGES:
        raise ConfigError(f'{where}: stage {p.stage!r}, expected one of {", ".join(STAGES)}')


def _poses(name: str, stream: Stream) -> PoseStream:
    norm = np.linalg.norm(stream.values[:, 3:], axis=1)
    worst = int(np.argmax(np.abs(norm - 1.0)))
    # unit: how far the norm of a quaternion may be from 1: what seven digits lose, and more
    if abs(norm[worst] - 1.0) > 1e-3:
        raise ConfigError(f'{name}: pose: the quaternion at {stream.t[worst]:.3f} s has norm '
                          f'{norm[worst]:.4f}; expected x, y, z, w of a unit quaternion')
    return PoseStream(stream.t, stream.values[:, :3],
                      matrix_from_quaternion(stream.values[:, 3:]))


@contextmanager
def _blamed(what: str) -> Iterator[None]:
    """Say in one line what third-party code raises, and where."""
    try:
        yield
    except ForcecalError:
        raise
    except Exception as error:  # any error of that code
        at = traceback.extract_tb(error.__traceback__)[-1]
        raise ConfigError(f'{what} raised {type(error).__name__}: {error} '
                          f'({at.filename}:{at.lineno})') from error


def with_priors(simulator: ThirdParty, path: str) -> ThirdParty:
    """
    Replace standard deviations of parameters by those of a file.

    Parameters
    ----------
    path : str
        YAML, ``name: sigma`` in the parameter's unit.

    Raises
    ------
    ConfigError
        The file cannot be read; a name is none of a parameter; a sigma is not above 0.
    """
    try:
        document = load_yaml(Path(path).read_bytes(), path)
    except OSError as error:
        raise ConfigError(f'--priors {path}: {error.strerror or error}') from None
    if not isinstance(document, Mapping) or not document:
        raise ConfigError(f'--priors {path}: expected lines of NAME: SIGMA, got '
                          f'{type(document).__name__}')
    units = {p.name: p.unit for p in simulator.parameters}
    for name, sigma in document.items():
        if name not in units:
            raise ConfigError(f'--priors {path}: {simulator.name} has no parameter {name}; '
                              + instead(name, units))
        if isinstance(sigma, bool) or not isinstance(sigma, (int, float)) or not (
                0.0 < sigma < math.inf):
            raise ConfigError(f'--priors {path}: {name}: got {sigma!r}, expected a standard '
                              f'deviation above 0 [{units[name]}]')
    return replace(simulator, parameters=tuple(
        p._replace(sigma=float(document.get(p.name, p.sigma))) for p in simulator.parameters))
