"""
A model in MuJoCo as a simulator: driven by commands of joints, its sensors in the sign used here.

MuJoCo's force sensor says what the tool does to the arm, so its sign is turned. All sensors of a
step show the state before it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import JointStream
from forcecal_ros.sim.mujoco_contacts import Touched
from forcecal_ros.sim.mujoco_drives import (
    Controller,
    Drive,
    Swing,
    warned,
    why_not,
)
from forcecal_ros.sim.mujoco_limits import Forces, Limit
from forcecal_ros.sim.mujoco_numbers import Number
from forcecal_ros.sim.protocol import Imitation, Inputs, Parameter
import numpy as np
from numpy.typing import NDArray

SETTLING = 2.0
"""Simulated at the first command before the recording begins [s]: until an arm hangs still."""

EVERY = 0.002
"""Between samples, at least [s]: the wrench is compared up to far below 250 Hz."""

SMALLER = (2, 4, 8, 16)
"""
Parts of a time step that are tried where a simulation is unstable: the step that a stiff joint
bears is told to a factor of two, and 16 parts take as long as a diagnosis' first 16 runs.
"""
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
        Actuators that joints can be told positions by.
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
        return (list(seen.forces.said(float(self.model.opt.timestep)))
                or list(seen.swing.said(SETTLING)))

    def imitation(self, name: str, change: float) -> Imitation | None:
        """Say that play in the drive of a joint looks like more friction of that joint."""
        rubs = _named(RUBS, {name: change})
        for one in self.drives:
            if (more := rubs.get(one.joint, 0.0)) > 0.0 and (stiff := one.stiffness(self.model)):
                slides = 'm' if self._slides(one.joint) else 'rad'
                return Imitation(f'{PLAY}[{one.joint}]', more / stiff, slides, NO_PLAY)
        return None

    def _slides(self, joint: str) -> bool:
        import mujoco

        return bool(self.model.jnt_type[self.model.joint(joint).id]
                    == mujoco.mjtJoint.mjJNT_SLIDE)

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
                f'--mujoco {self.path}: the simulation is unstable or incomplete, MuJoCo says '
                f'"{warning}"; {self._steadier(inputs, parameters)}')
        return found

    def simulate_finer(self, inputs: Inputs, parameters: Mapping[str, float]
                       ) -> Mapping[str, Any]:
        """Simulate with half the model's time step, sampled at the same instants."""
        return self._with_less(inputs, parameters, 2, 'half')

    def simulate_finest(self, inputs: Inputs, parameters: Mapping[str, float]
                        ) -> Mapping[str, Any]:
        """Simulate with a quarter of the model's time step, sampled at the same instants."""
        return self._with_less(inputs, parameters, 4, 'a quarter of')

    def _with_less(self, inputs: Inputs, parameters: Mapping[str, float], parts: int, share: str
                   ) -> Mapping[str, Any]:
        """Simulate with a part of the time step; refuse what is unstable then."""
        found, warning = self._in_parts(inputs, parameters, parts)
        if warning:
            raise ConfigError(f'--mujoco {self.path}: with {share} its timestep the simulation is '
                              f'unstable, MuJoCo says "{warning}"; mend the model')
        return found

    def _steadier(self, inputs: Inputs, parameters: Mapping[str, float]) -> str:
        """Say with which time step it runs, or that it runs with none."""
        step = float(self.model.opt.timestep)
        for parts in SMALLER:
            if not self._in_parts(inputs, parameters, parts)[1]:
                return f'with timestep {step / parts:g} for {step:g} it runs: take that'
        return (f'nor does it run with timestep {step / SMALLER[-1]:g} for {step:g}: look for '
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
        import mujoco

        model = self.model
        for one in self.numbers:
            one.write(model, parameters.get(one.parameter.name, one.parameter.nominal))
        data = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        if model.nkey:  # joints that are not commanded, a gripper's, hold that
            mujoco.mj_resetDataKeyframe(model, data, 0)
        given, driven = _commands(mujoco, model, self.drives, inputs.joints)
        step = float(model.opt.timestep)
        t = inputs.start + step * np.arange(int((inputs.end - inputs.start) / step) + 1)
        q = np.stack([np.interp(t, given.t, one) for one in given.values.T], axis=1)
        controller = Controller(model, driven, q, step, _named(PLAY, parameters))
        controller.begin(data)
        for _ in range(round(SETTLING / step)):
            controller.hold(data)
            mujoco.mj_step(model, data)
        rows, places, skipped = [], [], parts * max(1, round(EVERY / (parts * step)))
        for k in range(len(t)):
            controller.tell(data, k)
            if k % skipped == 0:
                places.append(data.qpos.copy())
            mujoco.mj_step(model, data)
            if k % skipped == 0:
                rows.append(data.sensordata.copy())
            if look:
                look(data)
        joints = self._joints(inputs.measured_joints, np.array(places))
        return ({**self._streams(t[::skipped], np.array(rows)), 'joints': (t[::skipped], joints)},
                warned(mujoco, data))

    def _joints(self, names: Sequence[str], places: Array) -> Array:
        """Return a column for each joint that is named, NaN for those that move no tool."""
        out = np.full((len(places), len(names)), np.nan)
        for i, name in enumerate(names):
            if name in self.chain:
                out[:, i] = places[:, int(self.model.joint(name).qposadr[0])]
        return out

    def _streams(self, t: NDArray[Any], rows: Array) -> Mapping[str, Any]:
        def of(kind: str) -> Array:
            sensor = self.model.sensor(OWN + kind)
            return rows[:, int(sensor.adr[0]):int(sensor.adr[0] + sensor.dim[0])]

        wxyz = of('quaternion')
        found = {'wrench': (t, -np.hstack([of('force'), of('torque')])),
                 'pose': (t, np.hstack([of('position'), np.roll(wxyz, -1, axis=1)]))}
        if self.turned is not None:
            found['accelerometer'] = t, of('accelerometer') @ self.turned.T
        return found

    def patched(self, parameters: Mapping[str, float]) -> str:
        """Return the source with other numbers, an MJCF whose files lie where the model's do."""
        import mujoco

        spec = mujoco.MjSpec.from_file(self.path)
        spec.compile()  # numbers its geoms
        for one in self.numbers:
            one.patch(spec, parameters.get(one.parameter.name, one.parameter.nominal))
        return str(spec.to_xml())


class _Seen(NamedTuple):
    """What was looked at while a model was run."""

    inputs: Inputs
    touched: Touched
    forces: Forces
    swing: Swing

    def look(self, data: Any) -> None:
        for one in (self.touched, self.forces, self.swing):
            one.look(data)


RUBS, PLAY = 'dof_frictionloss', 'backlash'

NO_PLAY = ('no number of a model in MuJoCo makes play: let the controller of that joint command '
           'through play of so much to either side')

OWN = 'forcecal_'
"""Before the names of the sensors that are added to a model."""

def _named(field: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return by joint what parameters say of a field."""
    return {name[len(field) + 1:-1]: value for name, value in parameters.items()
            if name.startswith(f'{field}[')}

def _commands(mujoco: Any, model: Any, drives: Sequence[Drive], joints: JointStream | None
              ) -> tuple[JointStream, list[Drive]]:
    """Return the commands, and what each column drives."""
    if joints is None:
        raise ConfigError('--mujoco drives joints, and the recording holds no commands of any; '
                          'record what the controller is told and name it with --topic '
                          'joint_commands=NAME')
    driven = {one.joint: one for one in drives}
    if not joints.names:
        if joints.values.shape[1] != len(driven):
            raise ConfigError(f'the commands are of {joints.values.shape[1]} joints without '
                              f'names, the model drives {len(driven)}: {", ".join(driven)}')
        return joints, list(driven.values())
    for name in joints.names:
        if name not in driven:
            raise ConfigError(f'joint {name} is commanded, but {why_not(mujoco, model, name)}; '
                              f'what can be told positions is {", ".join(driven)}')
    return joints, [driven[name] for name in joints.names]
