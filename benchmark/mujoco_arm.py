"""An arm like a UR10 with a rigid gripper in MuJoCo, which stands for a robot, or its simulation.

The wrench is taken between the last link and the gripper. MuJoCo's force sensor says what the
gripper does to the arm, so its sign is turned; all sensors show the state before a step.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from forcecal_ros.core.geometry import matrix_from_quaternion, quaternion_from_matrix
from forcecal_ros.core.streams import JointStream, PoseStream, Recording, Stream
from forcecal_ros.sim.protocol import Inputs, Parameter
import mujoco
import numpy as np

PERIOD = 0.004
"""Of the commands [s]."""

LINKS = (  # axis, offset of the next joint [m], mass [kg], radius [m], armature, kp, kv
    ('0 0 1', '0 0 0.128', 7.8, 0.07, 3.0, 30000.0, 900.0),
    ('0 1 0', '0 0.17 0', 12.0, 0.07, 3.0, 30000.0, 900.0),
    ('0 1 0', '0.61 -0.11 0', 6.0, 0.06, 2.0, 20000.0, 600.0),
    ('0 1 0', '0.57 0 0', 2.0, 0.05, 0.5, 5000.0, 120.0),
    ('0 0 -1', '0 0.16 0', 2.0, 0.05, 0.5, 5000.0, 120.0),
    ('0 1 0', '0 0 -0.116', 0.4, 0.04, 0.3, 3000.0, 70.0))
"""From the base; the offset is from the joint before."""

JOINTS = tuple(f'joint{i}' for i in range(len(LINKS)))

LOWERED = 0.45
"""Of the second joint, while the arm presses [rad]: lower than its free motion."""

DEEPER = 0.001
"""By which it presses deeper and less, ten times [rad]."""

TABLE = 2e4
"""Stiffness of a table [N/m]."""

TIP = 0.01
"""Radius of the tip that touches a table, at the flange [m]."""

HOME = np.array([0.3, -1.3, 1.7, -1.9, -1.5, 0.4])


@dataclass(frozen=True)
class Arm:
    """
    Numbers of the arm, all relative to the nominal where not said otherwise.

    Attributes
    ----------
    step : float
        Of the integration [s].
    integrator : str
        MuJoCo's name.
    mass, com, inertia : float
        Of the gripper.
    links : tuple of float
        Masses of the links.
    kp, kv, armature : tuple of float
        Of each joint.
    friction : tuple of float
        Dry, of each joint [N m].
    tilt : tuple of float
        Of gravity in the base, a rotation vector about X and Y [rad].
    pull : callable or None
        (position of the flange, time) -> force in base on the flange [N].
    table : float or None
        Height of a table under the flange [m]; None: there is none.
    stiffness : float
        Of the table.
    soft : float or None
        Time constant of MuJoCo's own contact with that table [s]; None: it is a spring.
    play : tuple of float
        Of the drive of each joint, half of it [rad].
    imu : bool
        Whether there is an accelerometer in the flange.
    """

    step: float = 0.001
    integrator: str = 'Euler'
    mass: float = 1.0
    com: float = 1.0
    inertia: float = 1.0
    links: tuple[float, ...] = (1.0,) * 6
    kp: tuple[float, ...] = (1.0,) * 6
    kv: tuple[float, ...] = (1.0,) * 6
    armature: tuple[float, ...] = (1.0,) * 6
    friction: tuple[float, ...] = (1.5, 1.5, 1.0, 0.5, 0.5, 0.3)
    tilt: tuple[float, float] = (0.0, 0.0)
    pull: Callable[[np.ndarray], np.ndarray] | None = field(default=None, compare=False)
    table: float | None = None
    stiffness: float = 1.0
    soft: float | None = None
    play: tuple[float, ...] = (0.0,) * 6
    imu: bool = False


def varied(arm: Arm, rng: np.random.Generator) -> Arm:
    """Make everything differ by 0.5 to 2 %, up or down."""
    def off(n=None):
        return rng.choice([-1.0, 1.0], n) * rng.uniform(0.005, 0.02, n)

    six = {name: tuple(v * (1 + d) for v, d in zip(getattr(arm, name), off(6)))
           for name in ('links', 'kp', 'kv', 'armature', 'friction')}
    arm = replace(arm, mass=arm.mass * (1 + off()), com=arm.com * (1 + off()),
                  inertia=arm.inertia * (1 + off()), **six)
    return arm if arm.table is None else replace(arm, stiffness=arm.stiffness * (1 + off()))


def model_of(arm: Arm) -> mujoco.MjModel:
    """Compile an arm."""
    return mujoco.MjModel.from_xml_string(mjcf_of(arm))


def gravity_of(arm: Arm) -> np.ndarray:
    """Return gravity in the base, shape (3,) [m/s^2]."""
    x, y = arm.tilt
    return 9.80665 * np.array([np.sin(y), -np.sin(x), -np.cos(x) * np.cos(y)])


def mjcf_of(arm: Arm) -> str:
    """Write an arm."""
    gravity = gravity_of(arm)
    bodies, ends = '', ''
    for i, (axis, offset, mass, radius, armature, _, _) in enumerate(LINKS):
        half = 0.08 if i not in (1, 2) else 0.3
        along = '0.3 0 0' if i in (1, 2) else '0 0 0'
        inertia = mass * arm.links[i] * (radius ** 2 / 4 + half ** 2 / 3)
        bodies += (
            f'<body name="link{i}" pos="{offset}">'
            f'<joint name="joint{i}" axis="{axis}" armature="{armature * arm.armature[i]}" '
            f'frictionloss="{arm.friction[i]}"/>'
            f'<inertial pos="{along}" mass="{mass * arm.links[i]}" '
            f'diaginertia="{inertia} {inertia} {mass * arm.links[i] * radius ** 2 / 2}"/>')
        ends += '</body>'
    m, c, k = 1.2 * arm.mass, arm.com, arm.inertia
    tool = (f'<site name="flange" pos="0 0 -0.05"/><body name="gripper" pos="0 0 -0.05">'
            f'<inertial pos="{0.008 * c} {-0.004 * c} {-0.065 * c}" mass="{m}" '
            f'diaginertia="{3e-3 * k} {2.6e-3 * k} {1.4e-3 * k}"/>'
            f'<site name="ft" pos="0 0 0"/>{_tip(arm)}</body>')
    actuators = ''.join(
        f'<position joint="joint{i}" kp="{kp * arm.kp[i]}" kv="{kv * arm.kv[i]}"/>'
        for i, (*_, kp, kv) in enumerate(LINKS))
    return (
        f'<mujoco><option timestep="{arm.step}" integrator="{arm.integrator}" gravity='
        f'"{gravity[0]} {gravity[1]} {gravity[2]}"/><worldbody>{_table(arm)}{bodies}{tool}{ends}'
        f'</worldbody><actuator>{actuators}</actuator><sensor><force site="ft"/>'
        '<torque site="ft"/><framepos objtype="site" objname="ft"/>'
        '<framequat objtype="site" objname="ft"/><accelerometer site="ft"/></sensor></mujoco>')


def _contact(arm):
    """Softness and friction of tip and table, as attributes of a geom."""
    return f'solref="{arm.soft / arm.stiffness ** 0.5} 1" friction="0.3 0.005 0.0001"'


def _table(arm):
    if arm.soft is None:
        return ''
    return (f'<geom name="table" type="plane" size="2 2 0.1" pos="0 0 {arm.table}" '
            f'{_contact(arm)}/>')


def _tip(arm):
    if arm.soft is None:
        return ''
    return f'<geom name="tip" size="{TIP}" mass="0" {_contact(arm)}/>'


def commands(seed: int, seconds: float) -> np.ndarray:
    """Return joint commands that begin and end at rest, and turn the wrist widely."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(round(seconds / PERIOD))
    u = np.clip(t - 2.0, 0.0, seconds - 4.0)
    rise = np.clip(np.minimum(u, seconds - 4.0 - u) / 2.0, 0.0, 1.0)
    rise = rise ** 3 * (10.0 - 15.0 * rise + 6.0 * rise ** 2)
    out = np.tile(HOME, (len(t), 1))
    for joint, most in enumerate((0.3, 0.15, 0.2, 0.6, 0.8, 1.0)):
        for frequency in rng.uniform(0.08, 0.9, 3):
            size = most * rng.uniform(0.3, 0.6) * min(1.0, 0.3 / frequency)
            out[:, joint] += rise * size * np.sin(2 * np.pi * frequency * u
                                                  + rng.uniform(0, 2 * np.pi))
    return out


def pressing(seconds: float) -> np.ndarray:
    """Return joint commands that begin and end at rest, and press on a table in between."""
    def rising(begin, end):
        x = np.clip((t - begin) / (end - begin), 0.0, 1.0)
        return x ** 3 * (10.0 - 15.0 * x + 6.0 * x ** 2)

    t = PERIOD * np.arange(round(seconds / PERIOD)) / seconds
    out = np.tile(HOME, (len(t), 1))
    pressed = rising(0.05, 0.35) - rising(0.65, 0.95)
    out[:, 1] += pressed * (LOWERED + DEEPER * np.sin(20.0 * np.pi * t))
    return out


def run(arm: Arm, joints: np.ndarray, every: float = 0.002) -> Recording:
    """
    Move an arm, whose controller interpolates its commands.

    Parameters
    ----------
    joints : ndarray, shape (n, 6)
        Commands at 250 Hz [rad].
    every : float
        Between samples [s].

    Returns
    -------
    Recording
        Wrench, pose, joints and commands of both, without noise.
    """
    model = model_of(arm)
    data = mujoco.MjData(model)
    data.qpos[:] = joints[0]
    data.ctrl[:] = joints[0]
    site = model.site('ft').id
    body = model.body('gripper').id
    steps, hold = round(every / arm.step), round(PERIOD / arm.step)
    for _ in range(round(2.0 / arm.step)):
        _pulled(arm, data, site, body)
        mujoco.mj_step(model, data)
    at = np.arange(len(joints) * hold) / hold
    fine = np.stack([np.interp(at, np.arange(len(joints)), q) for q in joints.T], axis=1)
    fine = np.stack([_behind_play(q, play) for q, play in zip(fine.T, arm.play)], axis=1)
    rows, places = [], []
    for k in range(len(joints) * hold):
        data.ctrl[:] = fine[k]
        _pulled(arm, data, site, body)
        if k % steps == 0:
            places.append(data.qpos.copy())
        mujoco.mj_step(model, data)
        if k % steps == 0:
            rows.append(data.sensordata.copy())
    t = arm.step * steps * np.arange(len(rows))
    seen = np.array(rows)
    felt = Stream(t, seen[:, 13:], 'ft_sensor') if arm.imu else None
    target, told = forward(model, joints), PERIOD * np.arange(len(joints))
    return Recording(
        wrench=Stream(t, -seen[:, :6], 'ft_sensor'),
        pose=PoseStream(t, seen[:, 6:9],
                        matrix_from_quaternion(np.roll(seen[:, 9:13], -1, axis=1))),
        target=PoseStream(told, *target), accelerometer=felt, accelerometer_unit='m/s^2',
        joints=JointStream(t, np.array(places), '', JOINTS),
        joint_commands=JointStream(told, joints, '', JOINTS))


def _pulled(arm, data, site, body):
    if arm.pull is None and arm.table is None:
        return
    force = np.zeros(3) if arm.pull is None else arm.pull(data.site_xpos[site])
    if arm.table is not None and arm.soft is None:
        force[2] += TABLE * arm.stiffness * max(0.0, arm.table - data.site_xpos[site][2])
    data.xfrc_applied[body, :3] = force
    data.xfrc_applied[body, 3:] = np.cross(data.site_xpos[site] - data.xipos[body], force)


def _behind_play(q, play):
    """Follow a command as a drive with play does, whose friction holds it in between."""
    if not play:
        return q
    out = q.copy()
    for k in range(1, len(q)):
        out[k] = np.clip(out[k - 1], q[k] - play, q[k] + play)
    return out


def forward(model, joints):
    data = mujoco.MjData(model)
    position, R = np.empty((len(joints), 3)), np.empty((len(joints), 3, 3))
    site = model.site('ft').id
    for i, q in enumerate(joints):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        position[i], R[i] = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    return position, R


class ArmSimulator:
    """The nominal arm, or one like it, as a simulator that can be run again with other numbers."""

    def __init__(self, arm: Arm = Arm()) -> None:
        self.arm = arm

    def parameters(self) -> list[Parameter]:
        """List payload, joints and the tilt of the base, all as well known as by a drawing."""
        arm = Arm()
        joints = [Parameter(f'frictionloss[{i}]', f, 0.1, 'N m', 0.0)
                  for i, f in enumerate(arm.friction)]
        joints += [Parameter(f'{name}[{i}]', 1.0, sigma, '1', 0.2, 5.0)
                   for name, sigma in (('kp', 0.02), ('kv', 0.03)) for i in range(len(LINKS))]
        tilts = [Parameter(f'tilt.{a}', 0.0, 0.003, 'rad', -0.5, 0.5, 'robot', ('base_tilt',))
                 for a in 'xy']
        table = [] if self.arm.table is None else [
            Parameter('table', TABLE, 0.05 * TABLE, 'N/m', 0.1 * TABLE, 5.0 * TABLE,
                      'environment')]
        return [Parameter('payload', 1.2, 0.012, 'kg', 0.1, 5.0, 'tool', ('tool_mass',)),
                *joints, *tilts, *table]

    def simulate(self, inputs: Inputs, parameters: Mapping[str, float]):
        """Move the arm by the commands of its joints."""
        told = inputs.joints

        def each(name):
            return tuple(parameters[f'{name}[{i}]'] for i in range(len(LINKS)))

        made = run(replace(
            self.arm, mass=parameters['payload'] / 1.2, friction=each('frictionloss'),
            kp=each('kp'), kv=each('kv'), tilt=(parameters['tilt.x'], parameters['tilt.y']),
            stiffness=parameters.get('table', TABLE) / TABLE), told.values)
        t, pose = made.wrench.t + told.t[0], made.pose
        found = {'wrench': (t, made.wrench.values), 'joints': (t, made.joints.values),
                 'pose': (t, np.hstack([pose.position,
                                        quaternion_from_matrix(pose.R_base_sensor)]))}
        if made.accelerometer is not None:
            found['accelerometer'] = t, made.accelerometer.values
        if not inputs.measured_joints:
            del found['joints']
        return found
