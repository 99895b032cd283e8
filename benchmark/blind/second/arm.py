"""An arm of six joints in MuJoCo with a gripper, and its motion by commands of joints."""

from typing import NamedTuple

from blind.robot import Array
import mujoco
import numpy as np

PERIOD = 0.004
"""Of commands and samples [s]."""
SETTLING = 2.0
"""At rest at the first command, before the recording begins [s]."""
HOME = (0.2, -1.2, 1.6, -1.8, -1.5, 0.3)
JOINTS = ('pan', 'lift', 'elbow', 'wrist1', 'wrist2', 'wrist3')

LINKS = (  # axis, place in the last link, mass, half length along x, armature
    ('0 0 1', '0 0 0.13', 7.0, 0.08, 2.5), ('0 1 0', '0 0.16 0', 11.0, 0.29, 2.5),
    ('0 1 0', '0.58 -0.1 0', 5.5, 0.27, 1.8), ('0 1 0', '0.54 0 0', 1.9, 0.07, 0.5),
    ('0 0 -1', '0 0.15 0', 1.9, 0.07, 0.5), ('0 1 0', '0 0 -0.11', 0.5, 0.04, 0.3))


class Numbers(NamedTuple):
    """
    What may be off, in SI units.

    Attributes
    ----------
    mass : float
    com : tuple of float
        In the sensor's frame.
    friction, kp, kv : tuple of float
        Of each joint.
    tilt : tuple of float
        Of the base, about X and Y: gravity is turned the other way [rad].
    pull : float
        Stiffness of a spring from the gripper to ``hook`` [N/m].
    hook : tuple of float
        In base [m].
    """

    mass: float = 1.4
    com: tuple[float, ...] = (0.010, -0.006, -0.070)
    friction: tuple[float, ...] = (1.6, 1.6, 1.0, 0.5, 0.5, 0.3)
    kp: tuple[float, ...] = (28000.0, 28000.0, 18000.0, 5000.0, 5000.0, 3000.0)
    kv: tuple[float, ...] = (850.0, 850.0, 550.0, 120.0, 120.0, 70.0)
    tilt: tuple[float, ...] = (0.0, 0.0)
    pull: float = 0.0
    hook: tuple[float, ...] = (0.4, 0.3, 1.4)


def gravity(n: Numbers) -> Array:
    """Return gravity in the frame of the base [m/s^2]."""
    x, y = n.tilt
    return 9.80665 * np.array([np.sin(y), -np.sin(x), -np.cos(x) * np.cos(y)])


def source(n: Numbers, step: float, integrator: str) -> str:
    """Return the model as an MJCF."""
    links = ''
    for name, friction, (axis, place, mass, half, armature) in zip(JOINTS, n.friction, LINKS):
        spin = mass * (0.0012 + half**2 / 3)
        middle = f'{half} 0 0' if half > 0.1 else '0 0 0'
        links += (f'<body name="{name}_link" pos="{place}"><joint name="{name}" axis="{axis}" '
                  f'armature="{armature}" frictionloss="{friction!r}"/><inertial pos="{middle}" '
                  f'mass="{mass}" diaginertia="{mass * 0.0025} {spin} {spin}"/>')
    com = ' '.join(repr(float(one)) for one in n.com)
    gripper = (f'<body name="gripper" pos="0 0 -0.05"><inertial pos="{com}" mass="{n.mass!r}" '
               'diaginertia="0.0035 0.0030 0.0016"/><site name="ft"/></body>')
    motors = ''.join(f'<position joint="{name}" kp="{kp!r}" kv="{kv!r}"/>'
                     for name, kp, kv in zip(JOINTS, n.kp, n.kv))
    down = ' '.join(repr(float(one)) for one in gravity(n))
    return (f'<mujoco><option timestep="{step}" integrator="{integrator}" gravity="{down}"/>'
            f'<worldbody>{links}{gripper}{"</body>" * 6}</worldbody><actuator>{motors}</actuator>'
            '<sensor><force site="ft"/><torque site="ft"/></sensor></mujoco>')


def commands(seconds: float, rng: np.random.Generator) -> Array:
    """Draw commands of joints (n, 6) that begin and end at rest and turn the wrist widely."""
    t = PERIOD * np.arange(round(seconds / PERIOD))
    u = np.clip(t - 1.5, 0.0, seconds - 3.0)
    x = np.clip(np.minimum(u, seconds - 3.0 - u) / 2.0, 0.0, 1.0)
    out: Array = np.tile(HOME, (len(t), 1))
    for joint, most in enumerate((0.3, 0.15, 0.2, 0.6, 0.8, 1.0)):
        for hz in rng.uniform(0.08, 1.0, 3):
            size = most * rng.uniform(0.3, 0.6) * min(1.0, 0.3 / hz)
            out[:, joint] += x**3 * (10 - 15 * x + 6 * x**2) * size * np.sin(
                2 * np.pi * (hz * u + rng.uniform()))
    return out


class Ran(NamedTuple):
    """
    A run without noise, a row every :data:`PERIOD`.

    Attributes
    ----------
    joints : ndarray, shape (n, 6)
    wrench : ndarray, shape (n, 6)
        At rest the weight, pointing down.
    position, R : ndarray, shape (n, 3), (n, 3, 3)
        Of the sensor in base.
    """

    joints: Array
    wrench: Array
    position: Array
    R: Array


def ran(n: Numbers, told: Array, step: float, integrator: str) -> Ran:
    """Move the arm; the wrench is that which its motion needs, by inverse dynamics."""
    model = mujoco.MjModel.from_xml_string(source(n, step, integrator))
    data, each = mujoco.MjData(model), round(PERIOD / step)
    body, site = model.body('gripper').id, model.site('ft').id
    data.qpos[:] = data.ctrl[:] = told[0]
    for _ in range(round(SETTLING / step)):
        _pull(n, data, body, site)
        mujoco.mj_step(model, data)
    at = np.arange(len(told) * each) / each
    fine = np.stack([np.interp(at, np.arange(len(told)), q) for q in told.T], axis=1)
    q, v = np.empty((len(fine), 6)), np.empty((len(fine), 6))
    for k, now in enumerate(fine):
        q[k], v[k] = data.qpos, data.qvel
        data.ctrl[:] = now
        _pull(n, data, body, site)
        mujoco.mj_step(model, data)
    a = np.gradient(v, step, axis=0)
    rows = range(0, len(fine), each)
    out = Ran(q[::each], np.empty((len(told), 6)), np.empty((len(told), 3)),
              np.empty((len(told), 3, 3)))
    for i, k in enumerate(rows):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        _pull(n, data, body, site)
        mujoco.mj_inverse(model, data)
        out.wrench[i] = -data.sensordata
        out.position[i], out.R[i] = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    return out


def _pull(n: Numbers, data: mujoco.MjData, body: int, site: int) -> None:
    if n.pull:
        force = n.pull * (np.array(n.hook) - data.site_xpos[site])
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = np.cross(data.site_xpos[site] - data.xipos[body], force)
