"""
A model in MuJoCo as a simulator: loaded, its sensors added, driven by commands of joints.

A force sensor measures all that is below the body of its site, so the tool has to be a body of
its own. MuJoCo's force sensor reports what the tool does to the arm, so its sign is changed. All
sensors of a step show the state before it, and the acceleration that the step integrates.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from xml.etree import ElementTree

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.extras import installing
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import JointStream
from forcecal_ros.sim.mujoco_numbers import (
    BACKLASH,
    carrying,
    contact_numbers,
    Controller,
    Drive,
    Forces,
    found_drives,
    is_scalar,
    JOINT,
    Limit,
    limit_numbers,
    limits_of,
    Number,
    numbers_of,
    of_same_tree,
    reason_not_driven,
    Swing,
    Touched,
    warning_of,
)
from forcecal_ros.sim.protocol import Inputs, Parameter
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

try:
    import mujoco
except ImportError:
    mujoco = None

SETTLING_S = 2.0
"""Simulated at the first command before the recording begins [s]: until an arm hangs still."""


@dataclass
class MujocoRobot:
    """
    A model, its force-torque site, and the numbers that may be off.

    Attributes
    ----------
    path : str
        Of the model's source.
    model : mujoco.MjModel
    tool : str
        Body of the force-torque site.
    drives : tuple of Drive
        Actuators that take positions of joints.
    chain : tuple of str
        Joints that move the tool, or a part of it.
    turned : ndarray, shape (3, 3) or None
        From the accelerometer's axes to those of the force-torque site; None: there is none.
    numbers : tuple
    notes : tuple of str
        What the user should know of the model.
    limits : tuple of Limit
        Of the force of its drives.
    """

    path: str
    model: Any
    tool: str
    drives: tuple[Drive, ...]
    chain: tuple[str, ...]
    turned: Array | None
    numbers: tuple[Number, ...]
    notes: tuple[str, ...]
    limits: tuple[Limit, ...] = ()
    _seen: list['_Seen'] = field(default_factory=list, repr=False)

    def parameters(self) -> Sequence[Parameter]:
        """List what can be set."""
        return [one.parameter for one in self.numbers]

    def idle(self, inputs: Inputs) -> Sequence[str]:
        """Name the parameters of contacts and limits that are not come to under these commands."""
        of_contacts = {p.name for p in self.parameters() if p.stage == 'environment'}
        of_limits = {one.name for one in self.limits}
        if not (of_contacts or of_limits):
            return []
        seen = self._looked_at(inputs)
        return sorted((of_contacts - seen.touched.parameters)
                      | (of_limits - {one.name for one in seen.forces.near()}))

    def remarks(self, inputs: Inputs) -> Sequence[str]:
        """Say which drives are at the limit of their force, and whether the arm rests at first."""
        seen = self._looked_at(inputs)
        # a drive that is too weak to hold its joint is why that moves
        return (list(seen.forces.notes(float(self.model.opt.timestep)))
                or list(seen.swing.notes(SETTLING_S)))

    def _looked_at(self, inputs: Inputs) -> '_Seen':
        """Run it, unless that was done, to see what it touches and what its drives do."""
        for one in self._seen:
            if (one.inputs.joints is inputs.joints
                    and (one.inputs.start, one.inputs.end) == (inputs.start, inputs.end)):
                return one
        seen = _Seen(inputs, Touched(self.model, self.tool), Forces(self.model, self.limits),
                     Swing([one for one in self.drives if one.joint in self.chain]))
        self._simulated(inputs, {}, 1, seen.look)
        self._seen.append(seen)
        return seen

    def simulate(self, inputs: Inputs, parameters: Mapping[str, float]) -> Mapping[str, Any]:
        """
        Drive its actuators by the commands of joints, interpolated as controllers do.

        Raises
        ------
        ConfigError
            The recording has no commands of joints, or of others than the model's, or beyond
            what its actuators take; the simulation is unstable.
        """
        found, warning = self._simulated(inputs, parameters, 1)
        if warning:
            raise ConfigError(
                f'--mujoco {self.path}: the simulation is unstable or incomplete, MuJoCo reports '
                f'"{warning}"; {self._steadier(inputs, parameters)}')
        return found

    def simulate_finer(self, inputs: Inputs, parameters: Mapping[str, float]
                       ) -> Mapping[str, Any]:
        """Simulate with half the model's time step, sampled at the same instants."""
        found, warning = self._in_parts(inputs, parameters, 2)
        if warning:
            raise ConfigError(f'--mujoco {self.path}: with half its timestep the simulation is '
                              f'unstable, MuJoCo reports "{warning}"; fix the model')
        return found

    def _steadier(self, inputs: Inputs, parameters: Mapping[str, float]) -> str:
        """Say with which time step it runs, or that it runs with none."""
        # parts of a time step that are tried where a simulation is unstable: the step that a
        # stiff joint bears is known to a factor of two, and 16 parts take as long as a diagnosis'
        # first 16 runs
        step_parts = (2, 4, 8, 16)
        step = float(self.model.opt.timestep)
        for parts in step_parts:
            if not self._in_parts(inputs, parameters, parts)[1]:
                return f'it runs with timestep {step / parts:g} instead of {step:g}; use that'
        return (f'timestep {step / step_parts[-1]:g} instead of {step:g} fails as well: check for '
                'gains too high for the inertias, bodies that collide, or joints without armature')

    def _in_parts(self, inputs: Inputs, parameters: Mapping[str, float], parts: int
                  ) -> tuple[Mapping[str, Any], str]:
        """Simulate with one of so many parts of the model's own time step."""
        step = float(self.model.opt.timestep)
        self.model.opt.timestep = step / parts
        try:
            return self._simulated(inputs, parameters, parts)
        finally:
            self.model.opt.timestep = step

    def _simulated(self, inputs: Inputs, parameters: Mapping[str, float], parts: int,
                   look: Callable[[Any], None] | None = None) -> tuple[Mapping[str, Any], str]:
        """Simulate; the time step is one of so many parts. Say what MuJoCo warns of."""
        model = self.model
        for one in self.numbers:
            one.write(model, parameters.get(one.parameter.name, one.parameter.nominal))
        data = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        if model.nkey:  # joints that are not commanded, a gripper's, hold that
            mujoco.mj_resetDataKeyframe(model, data, 0)
        given, driven = _commands(model, self.drives, inputs.joints)
        step = float(model.opt.timestep)
        steps = int((inputs.end - inputs.start) / step)
        t: Array = inputs.start + step * np.arange(steps + 1.0)
        controller = Controller(model, driven, given.at(t), step, _backlash(parameters))
        controller.begin(data)
        for _ in range(round(SETTLING_S / step)):
            controller.hold(data)
            mujoco.mj_step(model, data)
        # time between samples, at least [s]: the wrench is compared up to far below 250 Hz
        sensors = _Sensors(model, data)
        rows, places, every = [], [], parts * max(1, round(0.002 / (parts * step)))
        for k in range(len(t)):
            controller.tell(data, k)
            if k % every == 0:
                places.append(data.qpos.copy())
            rows.append(sensors.step())
            if look:
                look(data)
        joints = self._joints(inputs.measured_joints, np.array(places))
        return ({**self._streams(t, np.array(rows), every), 'joints': (t[::every], joints)},
                warning_of(data))

    def _joints(self, names: Sequence[str], places: Array) -> Array:
        """Return a column for each joint that is named, NaN for those that move no tool."""
        out = np.full((len(places), len(names)), np.nan)
        for i, name in enumerate(names):
            if name in self.chain:
                out[:, i] = places[:, int(self.model.joint(name).qposadr[0])]
        return out

    def _streams(self, t: NDArray[Any], rows: Array, every: int) -> Mapping[str, Any]:
        """Sample poses; of forces and accelerations take the mean around each, as sensors do."""
        # centred on its sample: of an even number of steps, half of either end
        weights = np.convolve(np.ones(every), [1.0] if every % 2 else [0.5, 0.5]) / every
        mean = convolve1d(rows, weights, axis=0, mode='nearest')[::every]
        t, rows = t[::every], rows[::every]

        def of(kind: str, rows: Array = mean) -> Array:
            sensor = self.model.sensor(SENSOR_PREFIX + kind)
            return rows[:, int(sensor.adr[0]):int(sensor.adr[0] + sensor.dim[0])]

        xyzw = np.roll(of('quaternion', rows), -1, axis=1)
        found = {'wrench': (t, -np.hstack([of('force'), of('torque')])),
                 'pose': (t, np.hstack([of('position', rows), xyzw]))}
        if self.turned is not None:
            found['accelerometer'] = t, of('accelerometer') @ self.turned.T
        return found

    def patched(self, parameters: Mapping[str, float]) -> str:
        """Return the source with other numbers, an MJCF whose files lie where the model's do."""
        model = mujoco.MjModel.from_xml_path(self.path)
        for one in self.numbers:
            one.write(model, parameters.get(one.parameter.name, one.parameter.nominal))
        with TemporaryDirectory() as folder:
            path = Path(folder, 'model.xml')
            mujoco.mj_saveLastXML(str(path), model)
            root = ElementTree.parse(path).getroot()  # noqa: S314  # MuJoCo's own
        for limit in self.limits:
            if limit.field == JOINT:  # which MuJoCo saves as they were read
                low, high = model.jnt_actfrcrange[limit.row]
                for joint in root.iterfind(f"worldbody//joint[@name='{limit.joint}']"):
                    joint.set('actuatorfrcrange', f'{low:.6g} {high:.6g}')
        comments = ''.join(
            f'<!-- {BACKLASH}[{name}]: MuJoCo has no such number; command the joint through play '
            f'of {half:.4g} to either side -->\n' for name, half in _backlash(parameters).items())
        return f'{comments}{ElementTree.tostring(root, "unicode")}\n'


class _Seen(NamedTuple):
    """What was looked at while a model was run."""

    inputs: Inputs
    touched: Touched
    forces: Forces
    swing: Swing

    def look(self, data: Any) -> None:
        for one in (self.touched, self.forces, self.swing):
            one.look(data)


class _Sensors:
    """
    What sensors show of the state before a step, and of the motion in that step.

    MuJoCo's own force sensor and accelerometer show the acceleration at the step's begin, before
    dampings that are integrated implicitly act: many times that of the motion, with stiff drives.
    """

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data, self._step = model, data, float(model.opt.timestep)
        # of four stages, after which places are not those of the step's begin
        self._in_stages = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self._shown = mujoco.MjData(model) if self._in_stages else data
        self._velocity = data.qvel

    def step(self) -> Array:
        """Go a step on, and return what the model's sensors show."""
        model, shown, before = self._model, self._shown, self._velocity.copy()
        if self._in_stages:
            mujoco.mj_copyData(shown, model, self._data)
        mujoco.mj_step(model, self._data)
        if self._in_stages:
            mujoco.mj_forward(model, shown)
        after = self._velocity.copy()
        shown.qvel[:], shown.qacc[:] = before, (after - before) / self._step
        mujoco.mj_rnePostConstraint(model, shown)
        mujoco.mj_sensorAcc(model, shown)
        shown.qvel[:] = after
        return np.array(shown.sensordata)


SENSOR_PREFIX = 'forcecal_'
"""Before the names of the sensors that are added to a model."""


def _backlash(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return by joint what parameters say of backlash, where there is some."""
    return {name[len(BACKLASH) + 1:-1]: value for name, value in parameters.items()
            if name.startswith(f'{BACKLASH}[') and value > 0.0}


def _commands(model: Any, drives: Sequence[Drive], joints: JointStream | None
              ) -> tuple[JointStream, list[Drive]]:
    """Return the commands, and what each column drives."""
    if joints is None:
        raise ConfigError('--mujoco requires joint commands, and the recording holds none; '
                          'record the commands of the controller and name them with --topic '
                          'joint_commands=NAME')
    driven = {one.joint: one for one in drives}
    if not joints.names:
        if joints.values.shape[1] != len(driven):
            raise ConfigError(f'the commands are of {joints.values.shape[1]} joints without '
                              f'names, the model drives {len(driven)}: {", ".join(driven)}')
        return joints, list(driven.values())
    for name in joints.names:
        if name not in driven:
            raise ConfigError(f'joint {name} is commanded, but '
                              f'{reason_not_driven(model, name)}; joints that take positions '
                              f'are {", ".join(driven)}')
    return joints, [driven[name] for name in joints.names]


def load_mujoco(path: str, ft_site: str | None = None, imu: str | None = None) -> MujocoRobot:
    """
    Load a model.

    Parameters
    ----------
    path : str
        MJCF.
    ft_site : str, optional
        Where its force sensor sits; that of its only force sensor where none is named.
    imu : str, optional
        Site of an accelerometer, which rides on the tool; none is compared where none is named.

    Raises
    ------
    ConfigError
        MuJoCo is not installed, the model cannot be read, or has no such sites; the force sensor
        is on a link and not on a tool of its own, or the accelerometer on another body.
    """
    if mujoco is None:
        raise ConfigError(f'--mujoco requires MuJoCo: {installing("mujoco")}', 'package')
    mujoco.set_mju_user_warning(_ignore)
    if not Path(path).is_file():
        raise ConfigError(f'--mujoco {path}: no such file; give an MJCF model', 'file')
    try:
        spec = mujoco.MjSpec.from_file(path)
        site = _site(spec, path, ft_site)
        body = spec.site(site).parent
        _refuse_link(body, path, site)
        base = _base_of(body, path, site)
        body.name, base.name = body.name or 'tool', base.name or 'base'
        _add_sensors(spec, site, base.name)
        if imu:
            _add_accelerometer(spec, path, body, imu)
        model = spec.compile()
    except ValueError as error:
        why = ' '.join(str(error).split())
        raise ConfigError(f'--mujoco {path}: MuJoCo reports {why}') from None
    drives = found_drives(model, path)
    own = of_same_tree(model, drives, body.name)
    limits = limits_of(model, own)
    numbers = (*numbers_of(model, own, body.name, site), *limit_numbers(model, limits),
               *contact_numbers(model, body.name))
    turned = _axes(model, site).T @ _axes(model, imu) if imu else None
    return MujocoRobot(path, model, body.name, tuple(drives), _chain(model, body.name),
                       turned, numbers, tuple(_delay_notes(model, own)), tuple(limits))


def _delay_notes(model: Any, drives: Sequence[Drive]) -> Iterator[str]:
    """Report delays: of actuators they act and are no parameters, of sensors they are not used."""
    delays = getattr(model, 'actuator_delay', np.zeros(len(model.actuator_trntype)))
    late = {one.joint: float(delays[one.actuator]) for one in drives if delays[one.actuator] > 0.0}
    if late:
        listed = ', '.join(f'{joint} {1e3 * delay:.3g} ms' for joint, delay in late.items())
        yield (f'the actuator delays of the model ({listed}) are simulated, but not estimated; '
               'robot_delay shows an error of them')
    if (getattr(model, 'sensor_delay', np.zeros(1)) > 0.0).any():
        yield ('the sensor delays of the model are not simulated; wrench_delay or accel_delay '
               'shows a delay of the real sensors')


def _ignore(_: str) -> None:
    """Keep warnings out of MUJOCO_LOG.TXT in the user's folder; the data of a run count them."""


def _chain(model: Any, body: str) -> tuple[str, ...]:
    """Name the joints that move a body, or what hangs on it, of one number each."""
    tool = int(model.body(body).id)
    arm = set(carrying(model, tool))
    return tuple(model.joint(k).name for k in range(model.njnt) if is_scalar(model, k)
                 and ((i := int(model.jnt_bodyid[k])) in arm or tool in carrying(model, i)))


def _site(spec: Any, path: str, given: str | None) -> str:
    if given:
        _refuse_no_site(spec, path, '--ft-site', given)
        return given
    names = [site.name for site in spec.sites]
    found = {one.objname for one in spec.sensors if one.type == mujoco.mjtSensor.mjSENS_FORCE}
    if len(found) != 1:
        raise ConfigError(f'--mujoco {path}: {len(found)} sites have a force sensor; ' + (
            f'select one with --ft-site NAME: {", ".join(filter(None, names))}'
            if any(names) else "add a site with a name to the tool's body"))
    return str(found.pop())


def _refuse_no_site(spec: Any, path: str, option: str, name: str) -> None:
    names = [site.name for site in spec.sites]
    if name not in names:
        raise ConfigError(f'{option} {name}: {path} has no such site; it has '
                          f'{", ".join(filter(None, names)) or "none"}')


def _refuse_link(body: Any, path: str, site: str) -> None:
    """Refuse a sensor that weighs a link of the arm, too."""
    if list(body.joints):
        raise ConfigError(
            f'--mujoco {path}: site {site} is on {body.name}, which joint {body.joints[0].name} '
            "moves, so MuJoCo's force sensor would include that link; make the tool a separate "
            'body, welded to the link, with the site on it')


def _base_of(body: Any, path: str, site: str) -> Any:
    """Return the body that the arm stands on: the parent of the first that a joint moves."""
    chain = [body]
    while chain[-1].name != 'world':
        chain.append(chain[-1].parent)
    moved = [one for one in chain if list(one.joints)]
    if not moved:
        raise ConfigError(f'--mujoco {path}: site {site} is on {body.name or "a body"}, which no '
                          'joint moves; give one on the tool with --ft-site')
    return moved[-1].parent


def _add_sensors(spec: Any, site: str, base: str) -> None:
    kinds, types = mujoco.mjtSensor, mujoco.mjtObj
    for name, kind in (('force', kinds.mjSENS_FORCE), ('torque', kinds.mjSENS_TORQUE)):
        spec.add_sensor(name=SENSOR_PREFIX + name, type=kind, objtype=types.mjOBJ_SITE,
                        objname=site)
    for name, kind in (('position', kinds.mjSENS_FRAMEPOS),
                       ('quaternion', kinds.mjSENS_FRAMEQUAT)):
        spec.add_sensor(name=SENSOR_PREFIX + name, type=kind, objtype=types.mjOBJ_SITE,
                        objname=site, reftype=types.mjOBJ_XBODY, refname=base)


def _add_accelerometer(spec: Any, path: str, tool: Any, imu: str) -> None:
    _refuse_no_site(spec, path, '--imu', imu)
    body = spec.site(imu).parent
    if body.name != tool.name:
        raise ConfigError(f'--imu {imu}: the site is on body {body.name or "(no name)"}, expected '
                          f'one on the tool, {tool.name}')
    spec.add_sensor(name=SENSOR_PREFIX + 'accelerometer',
                    type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
                    objtype=mujoco.mjtObj.mjOBJ_SITE, objname=imu)


def _axes(model: Any, site: str) -> Array:
    """Return the axes of a site in its body."""
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.site_quat[model.site(site).id])
    return axes.reshape(3, 3)
