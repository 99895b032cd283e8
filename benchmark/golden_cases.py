"""The cases of golden.py: how each recording is made, by which command it is judged, the truth.

Parameters of effects are frozen here, so that making a recording needs no diagnosis.
"""

from collections.abc import Iterator
import hashlib
import json
from typing import Any, NamedTuple

Options = dict[str, Any]


class Case(NamedTuple):
    """
    A recording and what is asked of it.

    Attributes
    ----------
    name : str
    part : str
        ``calibrations`` or ``diagnoses``.
    family : str
        By which results are counted.
    make : str
        Function of golden_recordings.
    options : dict
        Its arguments.
    command : str
        Key of :data:`COMMANDS`.
    truth : dict
        ``effects``: patterns of names, one for each effect; ``outside``: whether there is
        something that the library lacks; ``neutral``: names that are neither right nor wrong.
        Of a calibration ``spoilt`` and ``cause``, words of a message that name the cause.
    quick : bool
        Whether ``--quick`` takes it.
    """

    name: str
    part: str
    family: str
    make: str
    options: Options
    command: str
    truth: dict[str, Any]
    quick: bool = False

    @property
    def key(self) -> str:
        """Folder of its recordings, which changes with what they are made of."""
        made_of = json.dumps([self.make, self.options], sort_keys=True)
        return (self.name.replace('/', '-').replace(' ', '_').replace(',', '') + '-'
                + hashlib.sha256(made_of.encode()).hexdigest()[:8])


COMMANDS = {
    'rig': ['diagnose a --rig rig.yaml -o out'],
    'rig pair': ['diagnose a --heldout b --rig rig.yaml -o out'],
    'mujoco': ['diagnose a --mujoco arm.xml -o out'],
    'two bags': ['diagnose a --simulated simulated -o out'],
    'along motion': ['diagnose a --calibration known.yaml -o out'],
    'calibrate': ['calibrate a -o out/calibration.yaml'],
    'calibrate ac': ['calibrate a --coupling ac -o out/calibration.yaml'],
    'table': ['import import.yaml --tables . -o out/bag',
              'calibrate out/bag -o out/calibration.yaml'],
    'kuka': ['import import.yaml --tables . -o out/bag',
             'calibrate out/bag --gravity 9.8209 -o out/calibration.yaml'],
    'insitu': ['insitu spec.yaml -o out'],
}
"""Arguments of ``forcecal``, run one after the other in the folder of the recordings."""

SHAPES: dict[str, tuple[dict[str, float], tuple[str, ...], float, str]] = {
    'wrench_delay': ({'delay': 0.004}, ('delay',), 0.0, ''),
    'wrench_lowpass': ({'time_constant': 0.004}, ('time_constant',), 0.0, ''),
    'wrench_bias_drift': ({'fz': 0.05, 'ty': 0.002}, ('fz', 'ty'), 0.0, ''),
    'wrench_gain': ({'fz': 0.05, 'fx': -0.03}, ('fz', 'fx'), 0.14, 'wrench_gain'),
    'wrench_crosstalk': ({'fx_of_fz': 0.03}, ('fx_of_fz',), 0.0, ''),
    'wrench_hysteresis': ({'height': 1.0, 'width': 5.0}, ('height',), 0.0, ''),
    'wrench_saturation': ({'limit': -10.0}, ('limit',), 0.0, ''),
    'wrench_quantisation': ({'step': 0.4, 'torque_step': 0.04}, ('step', 'torque_step'), 0.0, ''),
    'accel_saturation': ({'limit': -1.0}, ('limit',), 0.0, ''),
    'accel_delay': ({'delay': 0.004}, ('delay',), 0.0, ''),
    'accel_gain': ({'z': 0.05}, ('z',), 0.14, 'accelerometer_gain'),
    'accel_bias': ({'x': 0.1, 'z': -0.05}, ('x', 'z'), 0.35, 'accelerometer_offset'),
    'accel_misalignment': ({'y': 0.03, 'x': -0.01}, ('y', 'x'), 0.0, ''),
    'accel_highpass': ({'rate': 0.1, 'before': 0.0}, ('rate',), 0.0, ''),
    'accel_resonance': ({'amplitude': 1.0, 'frequency': 30.0, 'damping': 0.1}, ('amplitude',),
                        0.0, ''),
    'tool_mass': ({'change': 0.05}, ('change',), 0.35, 'mass'),
    'tool_com': ({'x': 0.005, 'z': 0.003}, ('x', 'z'), 0.35, 'com'),
    'tool_stiffness': ({'change': 0.1}, ('change',), 0.175, 'stiffness'),
    'tool_damping': ({'change': 0.3}, ('change',), 0.233, 'damping'),
    'tool_stiffening': ({'cubic': 1e7}, ('cubic',), 0.0, ''),
    'tool_friction': ({'force': 3.0, 'velocity_scale': 0.002}, ('force',), 0.0, ''),
    'tool_backlash': ({'gap': 0.0005}, ('gap',), 0.0, ''),
    'cable_force': ({'x': 2.0, 'z': 2.0, 'y': 1.0}, ('x', 'y', 'z'), 0.0, ''),
    'spindle_vibration': ({'sine_x': 2.0, 'frequency': 41.3}, ('sine_x',), 0.0, ''),
    'robot_delay': ({'delay': 0.004}, ('delay',), 0.0, ''),
    'robot_resonance': ({'gain': 0.2, 'frequency': 9.0, 'damping': 0.06}, ('gain',), 0.0, ''),
    'base_tilt': ({'x': 0.01, 'y': 0.005}, ('x', 'y'), 0.0, ''),
    'contact_stiffness': ({'change': 0.3}, ('change',), 0.35, 'wall_stiffness'),
    'contact_damping': ({'change': 1.0}, ('change',), 0.35, 'wall_damping'),
    'wall_position': ({'shift': 0.001}, ('shift',), 0.35, 'wall_position'),
    'clock_skew': ({'wrench': 2e-4}, ('wrench',), 0.0, ''),
    'dropouts': ({'wrench': 0.02, 'accelerometer': 0.01}, ('wrench', 'accelerometer'), 0.0, ''),
}
"""Effect -> parameters at full size; those that its size scales; of an
effect of a tolerance's name, 3.5 tolerances in full sizes, to which the size is added, and the
tolerance, which is then left alone."""

LARGEST = {'wrench_saturation': 234.2, 'accel_saturation': 17.39}
"""What these sensors show at most along the motion of seed 1 [N], [m/s^2]: a limit is below."""

FRAGILE = ('wrench_crosstalk', 'robot_resonance', 'accel_saturation', 'accel_resonance',
           'wrench_lowpass', 'wrench_hysteresis')
"""Single effects that ``--quick`` takes at full size."""


def parameters(name: str, size: float) -> dict[str, float]:
    """Return an effect's parameters at a size, 1 being the full one."""
    full, scaled, beyond, _ = SHAPES[name]
    out = {k: round(v * (size + beyond), 9) if k in scaled else v for k, v in full.items()}
    if name in LARGEST:
        out['limit'] += LARGEST[name]
    return out


def effects(*names: str, **more: Any) -> dict[str, Any]:
    """Return the truth of a diagnosis."""
    return {'effects': list(names), **more}


def singles() -> Iterator[Case]:
    """Return every effect alone on the rig, full and a fifth; none; four that failed."""
    for size, word, first in ((1.0, 'full', 1), (0.2, 'fifth', 101)):
        for i, name in enumerate(SHAPES):
            still = [SHAPES[name][3]] if SHAPES[name][3] else []
            seed = 1 if name in LARGEST else first + i
            yield Case(f'rig/{name}/{word}', 'diagnoses', f'rig, {word} size', 'rig', {
                'seed': seed, 'effects': {name: parameters(name, size)}, 'still': still}, 'rig',
                effects(name), word == 'full' and name in FRAGILE)
    for seed in range(201, 207):
        yield Case(f'rig/none/{seed}', 'diagnoses', 'no effect', 'rig', {
            'seed': seed, 'effects': {}}, 'rig', effects(), seed == 201)
    for name, values in (
            ('wrench_crosstalk', {'fx_of_fz': 0.03}),
            ('robot_resonance', {'gain': 0.2, 'frequency': 9.0, 'damping': 0.06}),
            ('accel_saturation', {'limit': 16.39}),
            ('accel_resonance', {'amplitude': 1.0, 'frequency': 60.0, 'damping': 0.1})):
        yield Case(f'nominal rig/{name}', 'diagnoses', 'named in the plan', 'rig', {
            'seed': 1, 'effects': {name: values}, 'nominal': True, 'heldout': True}, 'rig pair',
            effects(name), name in ('wrench_crosstalk', 'accel_resonance'))


MECHANICAL = {
    'mass': ({'mass': 1.6}, 'tool_mass|body_mass.*'),
    'com': ({'com': [0.018, 0.004, 0.05]}, 'tool_com|body_ipos.*'),
    'friction': ({'friction': [0.5, 2.5, 0.5]}, 'joint_friction|dof_frictionloss.*'),
    'gain': ({'kp': [4000.0, 2600.0, 4000.0]}, 'joint_gain|kp.*'),
    'tilt': ({'tilt': [0.03, 0.015]}, 'base_tilt|tilt.*|gravity.*'),
    'cable': ({'pull': 20.0}, 'cable_force'),
}
"""Changes of the MuJoCo arm, and the pattern of what they are called."""

CALLED = {pattern.split('|')[0]: pattern for _, pattern in MECHANICAL.values()}

SENSED = {'wrench_delay': 0.008, 'wrench_lowpass': 0.01, 'wrench_gain': 0.08,
          'wrench_crosstalk': 0.05, 'wrench_bias_drift': 0.1, 'wrench_saturation': 15.0}


def arms() -> Iterator[Case]:
    """Return cases of an arm in MuJoCo, against its model and against another simulation."""
    for command, first, chosen in (
            ('mujoco', 301, ('mass', 'com', 'friction', 'gain', 'tilt', 'wrench_delay',
                             'wrench_crosstalk', 'wrench_bias_drift', '', '', '')),
            ('two bags', 321, ('mass', 'com', 'cable', 'wrench_delay', 'wrench_lowpass',
                               'wrench_gain', 'wrench_crosstalk', 'wrench_bias_drift',
                               'wrench_saturation', '', '', ''))):
        for seed, name in enumerate(chosen, first):
            changes, truth = MECHANICAL.get(name, ({}, name))
            options = {'seed': seed, 'changes': changes}
            if name in SENSED:
                options |= {'sensor': name, 'size': SENSED[name]}
            yield Case(f'{command}/{name or f"none/{seed}"}', 'diagnoses',
                       command if name else 'no effect', 'arm', options, command,
                       effects(*[truth] * bool(name)), name in ('mass', 'wrench_delay'))


OPENED = (
    (4, 'bed1f2f187ec', 'library', 'wrench_saturation', 'rig pair',
     ('cable_force', 'tool_mass', 'wrench_bias_drift', 'wrench_gain', 'wrench_hysteresis',
      'wrench_quantisation')),
    (4, 'c23b449fc06b', 'library', 'tool_mass', 'rig pair', ('accel_delay', 'spindle_vibration')),
    (4, '9803110d5a77', 'library', 'contact_stiffness', 'rig pair',
     ('tool_com', 'wrench_bias_drift', 'wrench_gain')),
    (4, '60e939db8724', 'library', 'wrench_lowpass', 'rig pair',
     ('base_tilt', 'cable_force', 'wrench_delay', 'wrench_lowpass')),
    (4, '2a849c465bb9', 'library', 'base_tilt', 'rig pair',
     ('cable_force', 'contact_damping', 'tool_mass', 'wrench_delay', 'wrench_lowpass')),
    (3, 'c5cff73cfac4', 'library', 'tool_friction', 'rig pair', ('spindle_vibration',)),
    (3, 'f0980aab188a', 'library', 'wrench_gain', 'rig pair',
     ('cable_force', 'spindle_vibration', 'wrench_gain')),
    (4, '7e0bb8b67d01', 'none', '', 'rig pair',
     ('contact_stiffness', 'wall_position', 'wrench_delay', 'wrench_gain', 'wrench_lowpass')),
    (4, '5a29fd3959ee', 'none', '', 'rig pair', ('contact_stiffness', 'wall_position')),
    (4, 'd112e21be21b', 'outside', 'reference_walk', 'rig pair',
     ('spindle_vibration', 'wrench_bias_step', 'wrench_gain')),
    (4, '1247b3e551e3', 'outside', 'catenary', 'rig pair', ('cable_force', 'contact_damping')),
    (3, '740904186197', 'library', 'wrench_hysteresis', 'mujoco',
     ('spindle_vibration', 'wrench_gain')),
    (3, '7afcc2cf5f0f', 'library', 'joint_friction', 'mujoco',
     ('tool_com', 'tool_mass', 'wrench_crosstalk', 'wrench_gain')),
    (4, 'd24b196f4203', 'none', '', 'mujoco',
     ('spindle_vibration', 'wrench_bias_drift', 'wrench_bias_step', 'wrench_delay',
      'wrench_gain', 'wrench_lowpass')),
    (4, '672f53bad3d2', 'library', 'wrench_gain', 'along motion', ()),
    (4, '8f4de529b207', 'library', 'wrench_hysteresis', 'along motion',
     ('wrench_bias_drift', 'wrench_delay', 'wrench_gain', 'wrench_hysteresis',
      'wrench_lowpass', 'wrench_quantisation')),
    (4, '65a5493e3662', 'library', 'tool_com', 'along motion',
     ('base_tilt', 'wrench_crosstalk', 'wrench_gain')),
    (4, '0b5cc47365d9', 'library', 'tool_mass', 'along motion',
     ('wrench_hysteresis', 'wrench_quantisation')),
    (4, 'ec4d35588359', 'library', 'wrench_crosstalk', 'along motion',
     ('tool_com', 'wrench_bias_drift', 'wrench_crosstalk', 'wrench_gain')),
    (3, '1062ade6d9ca', 'library', 'tool_com', 'along motion',
     ('base_tilt', 'tool_mass', 'wrench_crosstalk', 'wrench_gain')),
    (3, '16f367045ac1', 'library', 'wrench_gain', 'along motion', ('base_tilt', 'wrench_gain')),
    (3, '0e37a0958692', 'library', 'wrench_bias_drift', 'along motion',
     ('base_tilt', 'tool_com', 'wrench_bias_drift', 'wrench_crosstalk', 'wrench_delay',
      'wrench_gain', 'wrench_lowpass')),
    (3, '468b4c0ec5c8', 'library', 'wrench_crosstalk', 'along motion',
     ('spindle_vibration', 'wrench_gain')),
    (3, 'c651ea7e96e3', 'library', 'tool_mass', 'along motion', ('base_tilt', 'wrench_gain')),
    (4, '2a0a74e2912e', 'none', '', 'along motion',
     ('tool_com', 'wrench_bias_drift', 'wrench_crosstalk', 'wrench_gain')),
    (4, '248bbecf3bbf', 'none', '', 'along motion',
     ('base_tilt', 'wrench_bias_drift', 'wrench_gain')),
    (4, '8184cb6e0607', 'none', '', 'along motion',
     ('base_tilt', 'spindle_vibration', 'wrench_delay', 'wrench_gain', 'wrench_lowpass')),
    (3, '488ab6e409d6', 'outside', 'half_full', 'along motion',
     ('base_tilt', 'spindle_vibration', 'tool_com', 'wrench_crosstalk', 'wrench_delay',
      'wrench_gain', 'wrench_lowpass')),
    (4, '87ebf1772289', 'outside', 'torsion_mode', 'along motion',
     ('wrench_bias_drift', 'wrench_bias_step', 'wrench_delay', 'wrench_gain', 'wrench_lowpass')),
    (4, 'daf1842c8bc1', 'outside', 'creeping_grip', 'along motion',
     ('tool_com', 'wrench_crosstalk')),
)
"""Part, identity, kind, effect, command, names that a background resembles."""


def opened() -> Iterator[Case]:
    """Return opened cases of the blind check, most of them with a background."""
    for i, (part, identity, kind, effect, command, neutral) in enumerate(OPENED):
        yield Case(f'opened/{part}/{identity}', 'diagnoses', f'opened, {command}', 'opened', {
            'number': part, 'identity': identity}, command,
            effects(*[CALLED.get(effect, effect)] * (kind == 'library'), outside=True,
                    neutral=list(neutral)),
            i % 6 == 0 and command == 'along motion')


def sound() -> Iterator[Case]:
    """Return calibrations of fault-free recordings."""
    def case(name: str, make: str, options: Options, command: str, quick: bool = False) -> Case:
        return Case(f'sound/{name}', 'calibrations', 'sound', make, options, command,
                    {'spoilt': False}, quick)

    for seed in range(1, 11):
        kind = 'acc2' if seed % 4 == 0 else 'acc1'
        yield case(f'demo/{seed}', 'demo', {'seed': seed, 'accelerometer': kind},
                   'calibrate ac' if kind == 'acc2' else 'calibrate', seed in (1, 4))
    for seed, rate in enumerate((0.0, 0.0, 0.0, 100.0, 100.0, 100.0, 500.0, 500.0), 1):
        yield case(f'poses/{rate:g} Hz/{seed}', 'static', {'seed': seed, 'rate': rate},
                   'calibrate', seed in (1, 5))
    for seed in (1, 2, 3):
        yield case(f'gripper/{seed}', 'gripper', {'seed': seed}, 'calibrate', seed == 1)
    for seed, kind in enumerate(('matrix', 'quaternion', 'rotation vector', 'degrees'), 21):
        yield case(f'table/{kind}', 'table', {'seed': seed, 'kind': kind}, 'table', seed == 22)
    for seed, leg in ((1, 'plain'), (2, 'plain'), (3, 'real'), (4, 'quiet')):
        yield case(f'in situ/{leg}/{seed}', 'insitu', {'seed': seed, 'leg': leg}, 'insitu',
                   seed == 1)


SPOILT = {
    'stamps of whole seconds': 'stamp', 'milliseconds as seconds': 'rate|stamp|second',
    'time of day, past midnight': 'jump', 'an hour apart': '3600|clock',
    'wrench since boot, pose of the epoch': 'clock|stamp', '30 % lost in bursts': 'missing|gap',
    'stamped on arrival, in bursts of 10': 'jitter|burst',
    'another arm on the same topic': 'two|another|several|merged',
    'wrench of another arm': 'same|belong|another|different',
    'frame_id and axes change half-way': 'frame',
    'quaternions w first': 'w, x, y, z|w first|order',
    'pose of base in the sensor': 'inverse|transpos|base in', 'pose repeats at 10 Hz': 'repeat|10',
    'wrench behind a low-pass of 0.5 Hz': 'filter|smooth|low-pass',
    'wrench 80 ms late': 'late|delay|behind|clock',
    'torque about the tool centre': 'centre|point|origin',
    'force alone, torque zero': 'torque', 'force alone, torque NaN': 'finite|torque',
    'counts, 1000 a newton': 'count|mN|unit', 'force and torque exchanged': 'exchang|swap|torque',
    'torque in base, force not': 'base|axes', 'weight taken off by the driver': 'weigh',
    'dead band of 2 N': 'dead band', 'drift compensation of 20 s': 'drift|tare|high-pass',
    'a channel of 16 bits wraps': 'wrap|jump', 'base tilts by 5 deg half-way': 'base|level|tilt',
    'position in mm': 'mm', 'torque in N mm': 'N mm|unit', 'force in kgf': 'kgf|unit',
}
"""Faults of test/helpers/wrong_recordings.py, and what a message says that names the cause."""

DEMO_FAULTS = {
    'sign of the wrench': 'sign', 'wrench clipped': 'clip|satur|limit|range',
    'wrench channel stuck': 'stuck|constant|repeats',
    'accelerometer axis dead': 'dead|constant|stuck|zero|stands',
    'accelerometer clipped': 'clip|satur|limit|range',
    'displacement in mm': 'mm|unit|displacement', 'wrench axis of wrong sign': 'sign|mirror',
    'accelerometer 0.2 s late': 'late|delay|clock',
}
INSITU_FAULTS = {'accelerometer sign': 'sign|mass', 'mass in grams': 'kg|mass|unit',
                 'position in mm': 'mm|unit|position',
                 'one mass only': 'mass|data sets|three|rank'}
QUICK_FAULTS = ('wrench 80 ms late', 'quaternions w first', 'dead band of 2 N', 'force in kgf',
                'pose repeats at 10 Hz', 'wrench channel stuck', 'one mass only')


def spoilt() -> Iterator[Case]:
    """Return calibrations of faulty recordings, and of real ones."""
    def case(name: str, make: str, options: Options, command: str, cause: str) -> Case:
        return Case(f'spoilt/{name}', 'calibrations', 'spoilt', make, options, command,
                    {'spoilt': True, 'cause': cause}, name in QUICK_FAULTS)

    for name, cause in SPOILT.items():
        yield case(name, 'gripper', {'seed': 1, 'wrong': name}, 'calibrate', cause)
    for name, cause in DEMO_FAULTS.items():
        yield case(name, 'demo', {'seed': 1, 'fault': name}, 'calibrate', cause)
    for name, cause in INSITU_FAULTS.items():
        yield case(f'in situ, {name}', 'insitu', {'seed': 1, 'fault': name}, 'insitu', cause)
    yield Case('real/kuka', 'calibrations', 'real', 'kuka', {}, 'kuka', {'spoilt': False}, True)
    yield Case('real/icub', 'calibrations', 'real', 'icub', {}, 'insitu',
               {'spoilt': True, 'cause': 'the affine map of gravity'}, False)


def all_cases() -> list[Case]:
    """Return every case."""
    return [case for some in (sound, spoilt, singles, arms, opened) for case in some()]
