"""An arm of three joints in MuJoCo, and commands for it."""

from forcecal_ros.core.streams import JointStream
import numpy as np

GRAVITY = 9.80665
LINK = ('<body name="link{i}" pos="{place}"><joint name="{name}" axis="{axis}" armature="0.4" '
        'frictionloss="0.5"/><inertial pos="0.1 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>')
TOOL = ('<body name="gripper" pos="0.1 0 0" quat="0 0.6 0 0.8"><inertial pos="0.01 0 0.05" '
        'mass="1.5" diaginertia="3e-3 3e-3 2e-3"/><site name="ft"/></body>')
NAMES = ('pan', 'lift', 'twist')


def mjcf(tool=TOOL, integrator='Euler', sensor='<force site="ft"/>', actuator='position'):
    """Return an arm of three joints on a base that is turned about the vertical."""
    links = ''.join(LINK.format(i=i, place=place, name=name, axis=axis) for i, (name, place, axis)
                    in enumerate(zip(NAMES, ('0 0 0.2', '0.3 0 0', '0.3 0 0'),
                                     ('0 0 1', '0 1 0', '1 0 0'))))
    gains = ' kp="4000" kv="150"' if actuator == 'position' else ''
    driven = ''.join(f'<{actuator} joint="{name}"{gains}/>' for name in NAMES)
    option = f'timestep="0.002" integrator="{integrator}" gravity="0 0 -{GRAVITY}"'
    base = 'name="base" pos="1 2 3" quat="0.8 0 0 0.6"'
    return (f'<mujoco><option {option}/><worldbody><body {base}>{links}{tool}'
            f'</body></body></body></body></worldbody><actuator>{driven}</actuator>'
            f'<sensor>{sensor}</sensor></mujoco>')


def told(seconds, moving=1.0):
    t = np.arange(0.0, seconds, 0.01)
    rise = np.clip(np.minimum(t - 1.0, seconds - 1.0 - t), 0.0, 1.0)
    q = moving * np.stack([0.5 * np.sin(1.3 * t), 0.3 * np.sin(2.1 * t) - 0.2,
                           1.2 * np.sin(1.7 * t)], axis=1) * (rise ** 2 * (3 - 2 * rise))[:, None]
    return JointStream(t, q, '', NAMES)


def nominal(robot):
    return {p.name: p.nominal for p in robot.parameters()}
