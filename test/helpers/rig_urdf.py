"""What hangs on the sensor of a rig as URDF: layouts/rig.urdf, for RViz and Foxglove."""

import sys

from forcecal_ros.core.geometry import Array
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import load_rig
import numpy as np


def _visual(shape: str, centre: Array | tuple[float, ...], colour: str) -> str:
    x, y, z = centre
    return (f'    <visual>\n      <origin xyz="{x:g} {y:g} {z:g}" rpy="0 0 0"/>\n'
            f'      <geometry>{shape}</geometry>\n'
            f'      <material name="{colour}"/>\n    </visual>')


def _inertial(mass: float, com: Array, J: Array) -> str:
    x, y, z = com
    pairs = ' '.join(f'i{"xyz"[i]}{"xyz"[j]}="{J[i, j]:g}"' for i, j in zip(*np.triu_indices(3)))
    return (f'    <inertial>\n      <origin xyz="{x:g} {y:g} {z:g}"/>\n'
            f'      <mass value="{mass:g}"/>\n      <inertia {pairs}/>\n    </inertial>')


def urdf(rig: Rig) -> str:
    """Return the URDF of what hangs on the sensor of a rig."""
    # of the joint, either way: twice what the nominal tool's weight bends its spring [m]
    travel = 0.05
    tool, com, tip = rig.tool, np.array(rig.tool.com), np.array(rig.tool.tip)
    size = 2 * np.abs(com[:2]) + 0.1
    body = f'<box size="{size[0]:g} {size[1]:g} {2 * com[2]:g}"/>'
    joint = 'prismatic' if rig.optidrive is not None else 'fixed'
    limit = ('' if joint == 'fixed' else '\n    <axis xyz="1 0 0"/>\n    '
             f'<limit lower="{-travel}" upper="{travel}" effort="500" velocity="1"/>')
    return '\n'.join((
        '<?xml version="1.0"?>', '<robot name="rig">',
        '  <material name="steel"><color rgba="0.6 0.6 0.65 1"/></material>',
        '  <material name="tool"><color rgba="0.3 0.5 0.8 0.7"/></material>',
        '  <link name="ft_sensor">',
        _visual('<cylinder radius="0.05" length="0.04"/>', (0, 0, -0.02), 'steel'),
        '  </link>',
        f'  <joint name="optidrive" type="{joint}">',
        f'    <parent link="ft_sensor"/>\n    <child link="tool"/>{limit}', '  </joint>',
        '  <link name="tool">', _inertial(tool.mass, com, np.array(tool.inertia)),
        _visual(body, com, 'tool'),
        _visual('<sphere radius="0.01"/>', tip, 'steel'), '  </link>',
        '  <link name="tip"/>',
        '  <joint name="tip" type="fixed">',
        '    <parent link="tool"/>\n    <child link="tip"/>',
        f'    <origin xyz="{tip[0]:g} {tip[1]:g} {tip[2]:g}"/>', '  </joint>',
        '</robot>')) + '\n'


if __name__ == '__main__':
    sys.stdout.write(urdf(load_rig()))
