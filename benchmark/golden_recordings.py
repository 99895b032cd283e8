"""Makes the recordings of golden.py, from seeds, without the code that is judged by them.

Each function takes an empty folder and fills it. Those of calibrations return the truth, as
``{'mass': value, 'wrench_bias.0': value, ...}``. The package is used for its simulated rig and to
write recordings; the second rig, the blind check and the helpers of the tests do the rest.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
import subprocess
import sys

import numpy as np
from scipy.spatial.transform import Rotation
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark'), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.core.streams import JointStream, Phase, PoseStream, Recording, Stream
from forcecal_ros.io.bags import write_recording
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate

PERIOD = 0.004
"""Of commands [s]."""

START_NS = 1_760_000_000_000_000_000
G = 9.80665


# the nominal rig, along a motion that excites every effect

class Path6:
    """Commands of position and rotation vector from home, with their phases."""

    def __init__(self) -> None:
        self.home = np.array([1.0, 0.0, 1.0])
        self.rows = [np.concatenate([self.home, np.zeros(3)])]
        self.phases: list[Phase] = []

    def add(self, word, rows):
        start = PERIOD * (len(self.rows) - 1)
        self.rows.extend(rows)
        self.phases.append(Phase(word, start, PERIOD * (len(self.rows) - 1)))

    def hold(self, word, seconds):
        self.add(word, np.repeat(self.rows[-1][None], round(seconds / PERIOD), axis=0))

    def go(self, word, offset, turn, seconds):
        n = round(seconds / PERIOD)
        u = np.arange(1, n + 1)[:, None] / n
        way = np.concatenate([self.home + offset, turn]) - self.rows[-1]
        self.add(word, self.rows[-1] + way * (10 * u**3 - 15 * u**4 + 6 * u**5))

    def wave(self, word, size, band, seconds, turn):
        t = PERIOD * np.arange(1, round(seconds / PERIOD) + 1)
        rise = np.clip(np.minimum(t, seconds - t) / 0.5, 0.0, 1.0)
        angle = 2 * np.pi * (band[0] * t + 0.5 * (band[1] - band[0]) * t**2 / seconds)
        ways = [s * np.sin(angle * (1 + 0.13 * i)) for i, s in enumerate(size)]
        ways += [turn * np.sin(np.pi * (1 + 0.2 * i) * t) for i in range(3)]
        self.add(word, self.rows[-1] + (rise**2 * (3 - 2 * rise) * ways).T)

    def commands(self):
        rows = np.array(self.rows)
        R = Rotation.from_euler('x', np.pi) * Rotation.from_rotvec(rows[:, 3:])
        return PoseStream(PERIOD * np.arange(len(rows)), rows[:, :3], R.as_matrix()), tuple(
            self.phases)


def excitation(seed):
    """Poses, a step, a sweep to 6 Hz, a slow swing and a contact, in 13 s."""
    path, rng = Path6(), np.random.default_rng([seed, 7])
    path.hold('measure', 0.5)
    for _ in range(2):
        path.go('move', rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.9, 0.9, 3), 1.0)
        path.hold('settle', 0.2)
        path.hold('measure', 0.5)
    path.go('move', np.zeros(3), np.zeros(3), 1.0)
    path.hold('settle', 0.2)
    path.go('step', [0.01, 0.0, 0.0], np.zeros(3), 0.1)
    path.hold('step', 0.4)
    path.go('step', np.zeros(3), np.zeros(3), 0.1)
    path.hold('step', 0.4)
    path.wave('sweep', (0.006, 0.005, 0.005), (0.5, 6.0), 2.5, 0.05)
    path.wave('reverse', (0.03, 0.02, 0.02), (0.35, 0.35), 2.0, 0.0)
    path.go('approach', [0.079, 0.0, 0.0], np.zeros(3), 0.7)
    path.go('contact', [0.086, 0.0, 0.0], np.zeros(3), 0.3)
    path.wave('contact', (0.002, 0.0, 0.0), (1.0, 3.0), 1.0, 0.0)
    path.go('retract', np.zeros(3), np.zeros(3), 0.7)
    path.hold('settle', 0.2)
    return path.commands()


def poses():
    """Poses at rest and a step, to calibrate by, in some 19 s."""
    path, q = Path6(), np.pi / 2
    path.hold('settle', 0.6)
    path.hold('measure', 0.8)
    for turn in ((0.0, -q, 0.0), (q / 2, 0.0, 0.0), (0.0, 1.5 * q, 0.1)):
        path.go('move', np.zeros(3), np.array(turn), 2.2)
        path.hold('settle', 1.0)
        path.hold('measure', 0.8)
    path.go('move', np.zeros(3), np.zeros(3), 2.4)
    path.hold('settle', 1.0)
    for x in (0.01, 0.0):
        path.go('step', [x, 0.0, 0.0], np.zeros(3), 0.1)
        path.hold('step', 0.7)
    return path.commands()


def rig_file(name='rig.yaml'):
    return yaml.safe_load((ROOT / 'config' / name).read_text())


def astray(rig, seed, still=(), times=1.0):
    """Draw a rig's numbers from its spreads, but for the keys in ``still``."""
    rng, s = np.random.default_rng([seed, 11]), rig['spreads']

    def off(key, n=1):
        drawn = np.clip(rng.standard_normal(n), -2.5, 2.5) * s[key] * times
        return np.zeros(n) if key in still else drawn

    tool, sensor, wall = rig['tool'], rig['wrench_sensor'], rig['wall']
    tool['mass'] *= 1.0 + float(off('mass')[0])
    tool['com'] = (np.array(tool['com']) + off('com', 3)).tolist()
    tool['inertia'] = (np.array(tool['inertia']) * (1.0 + np.diag(off('inertia', 3)))).tolist()
    bias = np.concatenate([off('force_bias', 3), off('torque_bias', 3)])
    sensor['bias'] = (np.array(sensor['bias']) + bias).tolist()
    sensor['gain'] = (np.array(sensor['gain']) * (1.0 + off('wrench_gain', 6))).tolist()
    for key in ('acc1', 'acc2'):
        model = rig['accelerometer'][key]
        model['gain'] = (np.array(model['gain']) * (1.0 + off('accelerometer_gain', 3))).tolist()
        model['offset'] = (np.array(model['offset']) + off('accelerometer_offset', 3)).tolist()
    for key in ('stiffness', 'damping'):
        wall[key] *= 1.0 + float(off(f'wall_{key}')[0])
        rig['optidrive'][key] *= 1.0 + float(off(key)[0])
    wall['position'] += float(off('wall_position')[0])
    return rig


def louder(rig, factor):
    """Scale a rig's noise."""
    for part, keys in (('wrench_sensor', ('force_noise', 'torque_noise')),
                       ('accelerometer', ('noise',)), ('optidrive', ('noise',)),
                       ('pose_sensor', ('position_noise', 'orientation_noise'))):
        for key in keys:
            rig[part][key] *= factor
    return rig


def simulated(folder, rig, motion, seed, **options):
    """Simulate a rig that is given as the content of its file."""
    path = folder / 'true_rig.yaml'
    path.write_text(yaml.safe_dump(rig))
    target, phases = motion
    made = simulate(load_rig(str(path)), target, seed=seed, steps=16, **options)
    path.unlink()
    return replace(made, phases=phases, contact_truth=None, start_ns=START_NS)


def rig(folder, seed, effects, still=(), noise=1.5, nominal=False, heldout=False):
    """Record the rig with effects; ``nominal``: all else is as in its file."""
    true = rig_file() if nominal else astray(louder(rig_file(), noise), seed, still)
    true['effects'] = effects
    for i in range(2 if heldout else 1):
        made = simulated(folder, true, excitation(seed + 1000 * i), 2 * seed + 5000 + i)
        write_recording(folder / 'ab'[i], made)
    (folder / 'rig.yaml').write_text(yaml.safe_dump(rig_file()))


# an arm of three joints in MuJoCo, and another simulation of it

JOINTS = ('pan', 'lift', 'twist')
ARM = {'mass': 1.5, 'com': (0.01, 0.0, 0.05), 'friction': (0.5, 0.5, 0.5), 'kp': (4000.0,) * 3,
       'tilt': (0.0, 0.0), 'pull': 0.0}
STEP = 0.002
"""Of simulation, commands and samples [s]."""

HOOK = np.array([0.6, 0.5, 0.9])
"""Where a cable is fixed, in base [m]."""


def mjcf(arm):
    x, y = arm['tilt']
    down = G * np.array([np.sin(y), -np.sin(x), -np.cos(x) * np.cos(y)])
    links = ''.join(
        f'<body name="link{i}" pos="{place}"><joint name="{JOINTS[i]}" axis="{axis}" '
        f'armature="0.4" frictionloss="{arm["friction"][i]}"/><inertial pos="0.1 0 0" mass="2" '
        'diaginertia="0.02 0.02 0.02"/>'
        for i, (place, axis) in enumerate((('0 0 0.2', '0 0 1'), ('0.3 0 0', '0 1 0'),
                                           ('0.3 0 0', '1 0 0'))))
    driven = ''.join(f'<position joint="{j}" kp="{k}" kv="150"/>'
                     for j, k in zip(JOINTS, arm['kp']))
    com = ' '.join(map(str, arm['com']))
    return (f'<mujoco><option timestep="{STEP}" '
            f'gravity="{down[0]} {down[1]} {down[2]}"/><worldbody>{links}<body name="gripper" '
            f'pos="0.1 0 0" quat="0 0.6 0 0.8"><inertial pos="{com}" mass="{arm["mass"]}" '
            'diaginertia="3e-3 3e-3 2e-3"/><site name="ft"/></body></body></body></body>'
            f'</worldbody><actuator>{driven}</actuator><sensor><force site="ft"/><torque '
            'site="ft"/><framepos objtype="site" objname="ft"/><framequat objtype="site" '
            'objname="ft"/></sensor></mujoco>')


def arm_commands(seed, seconds=7.0):
    """Joint commands, one a step, that begin and end at rest."""
    rng, t = np.random.default_rng([seed, 13]), STEP * np.arange(round(seconds / STEP))
    u = np.clip(np.minimum(t - 1.0, seconds - 1.0 - t), 0.0, 1.0)
    waves = [size * np.sin(2 * np.pi * rng.uniform(*band) * (t - 1.0)) for size, band in (
        (0.5, (0.15, 0.3)), (0.3, (0.3, 0.45)), (1.2, (0.2, 0.35)))]
    return t, (u**2 * (3 - 2 * u) * np.array(waves)).T


def run_arm(arm, told):
    """Return wrench on the wire (n, 6), position, R, joints, after two seconds at rest."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(mjcf(arm))
    data = mujoco.MjData(model)
    body, found, rest = model.body('gripper').id, [], np.repeat(told[:1], round(2.0 / STEP), 0)
    for command in np.concatenate([rest, told]):
        data.ctrl[:] = command
        mujoco.mj_kinematics(model, data)
        force = arm['pull'] * (HOOK - data.site_xpos[0])
        data.xfrc_applied[body] = np.concatenate(
            [force, np.cross(data.site_xpos[0] - data.xipos[body], force)])
        joints = data.qpos.copy()
        mujoco.mj_step(model, data)  # whose sensors are of the state before
        found.append(np.concatenate([data.sensordata, joints]))
    found = np.array(found[len(rest):])
    R = Rotation.from_quat(np.roll(found[:, 9:13], -1, axis=1)).as_matrix()
    return -found[:, :6], found[:, 6:9], R, found[:, 13:]


def sensed(t, wrench, name, size):
    """Let a sensor of the arm show a wrench as an effect of the library does."""
    out, lag = wrench.copy(), {'wrench_delay': size, 'wrench_lowpass': 0.0}.get(name)
    if name == 'wrench_delay':
        out = np.stack([np.interp(t - lag, t, one) for one in wrench.T], axis=1)
    elif name == 'wrench_lowpass':
        share = -np.expm1(-STEP / size)
        for k in range(1, len(t)):
            out[k] = out[k - 1] + share * (wrench[k] - out[k - 1])
    elif name == 'wrench_gain':
        out[:, 2] *= 1.0 + size
        out[:, 0] *= 1.0 - 0.6 * size
    elif name == 'wrench_crosstalk':
        out[:, 0] += size * wrench[:, 2]
    elif name == 'wrench_bias_drift':
        out[:, 2] += size * t
        out[:, 4] += 0.04 * size * t
    elif name == 'wrench_saturation':
        out[:, :3] = np.clip(out[:, :3], -size, size)
    return out


def arm(folder, seed, changes=None, sensor='', size=0.0):
    """Record the arm, its model as MJCF, and what another simulation of it gives."""
    rng, told = np.random.default_rng([seed, 17]), arm_commands(seed)
    true = {**ARM, 'kp': tuple(4000.0 * (1 + 0.02 * rng.standard_normal(3))), **(changes or {})}
    wrench, position, R, joints = run_arm(true, told[1])
    t = told[0]
    wrench = sensed(t, wrench, sensor, size) + np.array([1.0, -2.0, 1.5, 0.1, -0.05, 0.08])
    wrench += np.repeat([0.15, 0.006], 3) * rng.standard_normal(wrench.shape)
    R_seen = R @ Rotation.from_rotvec(1e-4 * rng.standard_normal((len(t), 3))).as_matrix()
    commanded = JointStream(told[0], told[1], '', JOINTS)
    real = Recording(
        wrench=Stream(t, wrench, 'ft_sensor'), joint_commands=commanded, start_ns=START_NS,
        pose=PoseStream(t, position + 1e-4 * rng.standard_normal(position.shape), R_seen),
        joints=JointStream(t, joints + 3e-5 * rng.standard_normal(joints.shape), '', JOINTS))
    write_recording(folder / 'a', real)
    wrench, position, R, joints = run_arm(ARM, told[1])
    write_recording(folder / 'simulated', Recording(
        wrench=Stream(t, wrench, 'ft_sensor'), start_ns=START_NS,
        pose=PoseStream(t, position, R), joint_commands=commanded))
    (folder / 'arm.xml').write_text(mjcf(ARM))


# opened cases of the blind check

@cache
def opened_part(number):
    from blind.second.sealing import Part, planned

    part = Part(ROOT / 'benchmark' / 'blind' / 'second' / f'part-{number}', Path())
    opened = part.read('opened')
    return planned(part.read('plan'), opened['master']), opened['labels']


def opened(folder, number, identity):
    """Make an opened case again; of a real arm its tool is calibrated by the command."""
    from blind.second.case import make
    from blind.second.sealing import generator

    plan = opened_part(number)[0][identity]
    arrays = make(plan, generator(plan.generator)).arrays
    {'rig': _second_rig, 'arm': _second_arm, 'real': _real_arm}[plan.generator](folder, arrays)


def _second_rig(folder, arrays):
    for i, name in enumerate('ab'):
        one = {key.split('.', 1)[1]: v for key, v in arrays.items() if key.startswith(f'{i}.')}
        phases = tuple(Phase(word, float(start), float(end)) for word, start, end in (
            str(line).split() for line in one['phases']))
        write_recording(folder / name, Recording(
            wrench=Stream(one['wrench_t'], one['wrench'], 'ft_sensor'),
            accelerometer=Stream(one['volts_t'], one['volts'], 'accelerometer'),
            optidrive=Stream(one['slide_t'], one['slide'][:, None], 'ft_sensor'),
            pose=PoseStream(one['pose_t'], one['position'], one['R']),
            target=PoseStream(one['target_t'], one['target_position'], one['target_R']),
            phases=phases, start_ns=START_NS))
    (folder / 'rig.yaml').write_text(yaml.safe_dump(rig_file()))


def _second_arm(folder, arrays):
    from blind.second import arm as second

    t, told = arrays['t'], arrays['told']
    told_t = second.PERIOD * np.arange(len(told))
    write_recording(folder / 'a', Recording(
        wrench=Stream(t, arrays['wrench'], 'ft_sensor'), start_ns=START_NS,
        pose=PoseStream(t, arrays['position'], arrays['R']),
        joints=JointStream(t, arrays['joints'], '', second.JOINTS),
        joint_commands=JointStream(told_t, told, '', second.JOINTS)))
    (folder / 'arm.xml').write_text(str(arrays['model']))


def _real_arm(folder, arrays):
    from blind.second.on_real import DATA, measured

    m = measured()
    nowhere = np.full((len(m.pose_t), 3), np.nan)
    write_recording(folder / 'a', Recording(
        wrench=Stream(m.wrench_t, m.wrench + arrays['change'], 'ft_sensor'),
        accelerometer=Stream(m.accel_t, m.accel, 'accelerometer'), accelerometer_unit='m/s^2',
        pose=PoseStream(m.pose_t, nowhere, m.R), start_ns=START_NS))
    kuka(folder, DATA)
    for words in (('import', folder / 'import.yaml', '--tables', folder, '-o', folder / 'poses'),
                  ('calibrate', folder / 'poses', '--gravity', '9.8209', '-o',
                   folder / 'known.yaml')):
        subprocess.run([Path(sys.executable).with_name('forcecal'), *words], check=True,
                       capture_output=True)


def kuka(folder, data=None):
    """Copy the static poses of a real arm, and what its table holds."""
    data = data or real_data() / 'kuka_lbr_med'
    for name, source in (('import.yaml', ROOT / 'config' / 'examples' / 'kuka_poses.yaml'),
                         ('0-calibration_fts-accel.csv', data / '0-calibration_fts-accel.csv')):
        (folder / name).write_bytes(source.read_bytes())
    return {'mass': 0.9323}


def icub(folder):
    """Copy the record of a real foot in the air."""
    for name, source in (
            ('spec.yaml', ROOT / 'config' / 'examples' / 'insitu_icub_foot.yaml'),
            ('right_foot_in_air.csv', real_data() / 'icub_foot' / 'right_foot_in_air.csv')):
        (folder / name).write_bytes(source.read_bytes())
    return {}


def real_data():
    from blind.second.on_real import DATA

    return DATA.parent


# calibrations

def entries(truth):
    """Return numbers by name: ``{'com': [1, 2]}`` becomes ``{'com.0': 1, 'com.1': 2}``."""
    found = {}
    for key, value in truth.items():
        for index, one in np.ndenumerate(np.asarray(value, dtype=float)):
            found['.'.join([key, *map(str, index)])] = float(one)
    return found


def demo(folder, seed, accelerometer='acc1', fault=''):
    """Record the calibration's motion with a rig that is far from its file."""
    true = astray(rig_file(), seed, still=('wrench_gain',), times=5.0)
    made = simulated(folder, true, poses(), seed, accelerometer=accelerometer)
    if fault:
        made = DEMO_FAULTS[fault](made)
    write_recording(folder / 'a', made)
    model, tool = true['accelerometer'][accelerometer], true['tool']
    return entries({
        'mass': tool['mass'], 'com': tool['com'], 'wrench_bias': true['wrench_sensor']['bias'],
        'accelerometer.gain': model['gain'], 'tool.stiffness': true['optidrive']['stiffness']})


def of_stream(role, change):
    def done(made):
        stream = getattr(made, role)
        return replace(made, **{role: replace(stream, values=change(np.array(stream.values)))})
    return done


def stuck(values):
    values[len(values) // 2:, 1] = values[len(values) // 2, 1]
    return values


DEMO_FAULTS = {
    'sign of the wrench': of_stream('wrench', lambda v: -v),
    'wrench clipped': of_stream('wrench', lambda v: np.clip(v, -110.0, 110.0)),
    'wrench channel stuck': of_stream('wrench', stuck),
    'accelerometer axis dead': of_stream('accelerometer', lambda v: v * [1.0, 1.0, 0.0]),
    'accelerometer clipped': of_stream('accelerometer', lambda v: np.clip(v, 3.0, 7.0)),
    'displacement in mm': of_stream('optidrive', lambda v: 1e3 * v),
    'wrench axis of wrong sign': of_stream('wrench', lambda v: v * [1, -1, 1, 1, 1, 1]),
    'accelerometer 0.2 s late': lambda made: replace(made, accelerometer=replace(
        made.accelerometer, t=made.accelerometer.t + 0.2)),
}


def static(folder, seed, rate):
    """Record static poses; ``rate`` 0: one sample a pose."""
    from static_sets import static_set

    made, tool = static_set(seed, rate)
    write_recording(folder / 'a', replace(made, start_ns=START_NS))
    return entries({'mass': tool.mass, 'com': tool.com, 'wrench_bias': tool.bias})


def table(folder, seed, kind):
    """Write static poses as a table, one row a pose, with its import file."""
    from static_sets import static_set

    made, tool = static_set(seed, 0.0)
    R, rows = Rotation.from_matrix(made.pose.R_base_sensor), made.wrench.values
    force, torque, acceleration, separator, pose, names = KINDS_OF_TABLES[kind]
    columns = [rows[:, :3] / force[1], rows[:, 3:] / torque[1],
               made.accelerometer.values / acceleration[1], pose(R)]
    head = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz', 'ax', 'ay', 'az', *names[1]]
    np.savetxt(folder / 'table.csv', np.hstack(columns), fmt='%.9g', delimiter=separator,
               header=separator.join(head), comments='')
    spec = {'format': 'forcecal-import/1', 'tables': [{
        'file': 'table.csv', 'rate': 1.0, 'delimiter': separator,
        'phases': {'each_row': 'measure', 'between': 'move'}, 'signals': {
            'wrench': {'frame': 'ft_sensor', 'force': {'columns': head[:3], 'unit': force[0]},
                       'torque': {'columns': head[3:6], 'unit': torque[0]}},
            'accel': {'frame': 'accelerometer',
                      'acceleration': {'columns': head[6:9], 'unit': acceleration[0]}},
            'pose': {'frame': 'base', names[0]: names[2] if len(names) > 2 else head[9:]}}}]}
    (folder / 'import.yaml').write_text(yaml.safe_dump(spec))
    return entries({'mass': tool.mass, 'com': tool.com, 'wrench_bias': tool.bias})


NINE = [f'r{i}{j}' for i in '123' for j in '123']
KINDS_OF_TABLES = {
    'matrix': (('N', 1.0), ('N m', 1.0), ('m/s^2', 1.0), ',',
               lambda R: R.as_matrix().reshape(-1, 9), ('R_base_sensor', NINE)),
    'quaternion': (('N', 1.0), ('N m', 1.0), ('g', G), ',', lambda R: R.as_quat(),
                   ('quaternion_xyzw', ['qx', 'qy', 'qz', 'qw'])),
    'rotation vector': (('N', 1.0), ('N m', 1.0), ('m/s^2', 1.0), ' ', lambda R: R.as_rotvec(), (
        'rotation_vector', ['vx', 'vy', 'vz'],
        {'columns': ['vx', 'vy', 'vz'], 'unit': 'rad'})),
    'degrees': (('N', 1.0), ('N m', 1.0), ('g', G), ';', lambda R: R.as_rotvec(degrees=True), (
        'rotation_vector', ['vx', 'vy', 'vz'],
        {'columns': ['vx', 'vy', 'vz'], 'unit': 'deg'})),
}
"""Force, torque, acceleration: unit and its size in SI; separator; pose, its key and columns."""


def gripper(folder, seed, wrong='nothing'):
    """Record a gripper in fourteen poses, with a fault of test/helpers/wrong_recordings.py."""
    from wrong_recordings import BIAS, COM, log, MASS, write, WRONG

    write(WRONG[wrong].make(log(seed, hold=1.5), np.random.default_rng(5 + seed)), folder / 'a')
    return entries({'mass': MASS, 'com': COM, 'wrench_bias': BIAS})


def insitu(folder, seed, leg='plain', fault=''):
    """Write tables of a limb with added masses, and the file that describes them."""
    from insitu_leg import BODY_COM, BODY_MASS, Leg, PROTOCOL, REAL, record

    chosen = {'plain': Leg(), 'real': REAL, 'quiet': Leg(noise=0.2)}[leg]
    head, sets = ['t', *(f'raw{k}' for k in range(6)), 'ax', 'ay', 'az'], []
    for k, load in enumerate(PROTOCOL):
        one = record(load, replace(chosen, duration=40.0), 1000 * seed + k)
        sign = -1.0 if fault == 'accelerometer sign' else 1.0
        np.savetxt(folder / f'{k}.csv', np.column_stack([one.t, one.raw, sign * one.accel]),
                   fmt='%.7g', delimiter=',', header=','.join(head), comments='')
        mass = load.mass * (1e3 if fault == 'mass in grams' else 1.0)
        place = [1e3 * x if fault == 'position in mm' else x for x in load.position]
        sets.append({'file': f'{k}.csv', 'use': 'train' if load.train else 'validate',
                     'added_mass': mass, **({'position': place} if load.mass else {})})
    if fault == 'one mass only':
        sets = [sets[0], sets[4]]
    (folder / 'spec.yaml').write_text(yaml.safe_dump({
        'format': 'forcecal-insitu/1', 'time': {'column': 't', 'unit': 's'},
        'accelerometer': {'columns': head[7:]},
        'sensors': {'limb': {'columns': head[1:7], 'unit': 'counts', 'frame': 'limb_ft'}},
        'data_sets': sets}))
    return entries({'matrix_offset': chosen.offset, 'matrix': np.linalg.pinv(chosen.channels),
                    'mass': BODY_MASS, 'com': BODY_COM})
