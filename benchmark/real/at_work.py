"""Tools at work, in recordings that others published: hands, peelers and cloths touch them."""

from common import by_least_squares, taken, wrench, write_table
import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

ARM = ('x', 'y', 'z', 'q0', 'q1', 'q2', 'q3', 'fx', 'fy', 'fz', 'tx', 'ty', 'tz')
AXES = ('x', 'y', 'z')


def lasa_peeling(data, case, folder):
    trials = loadmat(data / case['files'], squeeze_me=True)['Data_noObj']
    names = [f'{name}_{arm}' for arm in ('peels', 'holds') for name in ARM]
    x, w, turned = (0, 1, 2, 3), (1, 2, 3, 0), ('--sensor-rotation', '0', '0', '-90')
    for k, arm, words, order, options in (
            (0, 'holds', 'from x, as stated', x, ()), (0, 'holds', 'from w', w, ()),
            (1, 'holds', 'from w', w, ()), (0, 'peels', 'from w', w, ()),
            (0, 'peels', f'from w, `{" ".join(turned)}`', w, turned)):
        columns = dict(zip(names, trials[k]))
        write_table(folder / f'{k}.csv', names, trials[k].T)
        pose = {'frame': 'base',
                'position': {'columns': [f'{axis}_{arm}' for axis in AXES], 'unit': 'm'},
                'quaternion_xyzw': [f'q{i}_{arm}' for i in order]}
        R = Rotation.from_quat(np.stack([columns[f'q{i}_{arm}'] for i in order], 1)).as_matrix()
        force = np.stack([columns[f'f{axis}_{arm}'] for axis in AXES], axis=1)
        came = taken(folder, [{'file': f'{k}.csv', 'rate': 100, 'signals': {
            'wrench': wrench('ft', *(
                [f'{kind}{axis}_{arm}' for axis in AXES] for kind in 'ft')),
            'pose': pose}}], *options)
        yield (f'trial {k + 1}, arm that {arm}, quaternions {words}', came,
               f'{by_least_squares(force, R):.4f} kg')


def lasa_wiping(data, case, folder):
    demonstrations = loadmat(data / case['files'], squeeze_me=True, struct_as_record=False)
    for k, one in enumerate(demonstrations['proc_data']):
        write_table(folder / f'{k}.csv', ARM, one.X.T)
        R = Rotation.from_quat(one.X[[4, 5, 6, 3]].T).as_matrix()
        yield (f'demonstration {k + 1}', taken(folder, [{
            'file': f'{k}.csv', 'rate': 1.0 / one.dt, 'signals': {
                'wrench': wrench('ft', ARM[7:10], ARM[10:]),
                'pose': {'frame': 'base', 'quaternion_xyzw': ['q1', 'q2', 'q3', 'q0']}}}]),
            f'{by_least_squares(one.X[7:10].T, R):.4f} kg')


UR5 = ((0.0, 0.089159, 90.0), (-0.425, 0.0, 0.0), (-0.39225, 0.0, 0.0), (0.0, 0.10915, 90.0),
       (0.0, 0.09465, -90.0), (0.0, 0.0823, 0.0))
"""Along x and z [m] and twist [deg] behind each joint, as the author's program states them."""


def ur5():
    """Text of a URDF of these joints."""
    links = ''.join(
        f'<joint name="q{i}" type="revolute"><parent link="{i}"/><child link="turned{i}"/>'
        f'<axis xyz="0 0 1"/></joint><joint name="arm{i}" type="fixed"><parent '
        f'link="turned{i}"/><child link="{i + 1}"/><origin xyz="{a} 0 {d}" '
        f'rpy="{np.radians(twist)} 0 0"/></joint>' for i, (a, d, twist) in enumerate(UR5))
    return f'<robot name="ur5">{links}</robot>'


def ntnu_ur5(data, case, folder):
    (folder / 'ur5.urdf').write_text(ur5())
    for name in case['files']:
        rows = [line.split() for line in (data / name).read_text().splitlines()]
        table = np.array([row for row in rows if len(row) == len(rows[0])], dtype=float)
        R = Rotation.identity(len(table))
        for joint, (_, _, twist) in zip(table[:, 7:13].T, UR5):
            R = R * Rotation.from_euler('z', joint[:, None]) * Rotation.from_euler(
                'x', twist, degrees=True)
        tables = [{'file': str((data / name).resolve()), 'header': 0, 'delimiter': ' ',
                   'time': {'column': '0', 'unit': 's'}, 'signals': {
                       'wrench': wrench('ft', ('13', '14', '15'), ('16', '17', '18')),
                       'joint_states': {
                           'names': [f'q{i}' for i in range(6)],
                           'position': {'columns': [str(i) for i in range(7, 13)],
                                        'unit': 'rad'}}}}]
        still = np.linalg.norm(table[:, 1:7], axis=1) < 1e-3
        plain = by_least_squares(table[still, 13:16], R.as_matrix()[still])
        for part, options in ((name.rsplit('_', 1)[1], ()), (
                'the same, `--sensor-rotation 0 0 -25`', ('--sensor-rotation', 0, 0, -25))):
            yield part, taken(folder, tables, '--topic', f'pose=urdf:{folder}/ur5.urdf:0:6',
                              *options), f'{plain:.4f} kg, rows without motion'
            plain = by_least_squares(
                table[still, 13:16] @ Rotation.from_euler('z', 25, degrees=True).as_matrix(),
                R.as_matrix()[still])


def iiwa_at_work(data, case, folder):
    def columns(*names):
        return [f'.{name}' for name in names]

    file = str((data / case['files']).resolve())
    force, torque = (columns(*(f'CartesianWrench.wrench.{kind}.{x}' for x in AXES))
                     for kind in ('force', 'torque'))
    pose = {'frame': 'base', 'quaternion_xyzw': columns(
        *(f'CartesianPose.pose.orientation.{x}' for x in 'xyzw'))}
    table = np.genfromtxt(file, delimiter=',', names=True, dtype=None, encoding='utf-8')
    R = Rotation.from_quat(np.stack([table[f'CartesianPoseposeorientation{x}'] for x in 'xyzw'],
                                    axis=1)).as_matrix()
    plain = by_least_squares(np.stack([table[f'CartesianWrenchwrenchforce{x}'] for x in AXES],
                                      axis=1), R)

    def stamps(stream):
        return {'column': f'.{stream}.header.stamp.secs', 'unit': 's',
                'nanoseconds': f'.{stream}.header.stamp.nsecs'}

    both = {'wrench': wrench('flange', force, torque), 'pose': pose}
    yield 'one time for a row, a date', taken(folder, [
        {'file': file, 'time': {'column': 'time', 'unit': 'date'}, 'signals': both}]), (
            f'{plain:.4f} kg')
    yield 'each message by its stamp', taken(folder, [
        {'file': file, 'time': stamps(f'Cartesian{role.title()}'), 'signals': {role: signal}}
        for role, signal in both.items()]), ''


def continuum_tip(data, case, folder):
    log = loadmat(data / case['files'], squeeze_me=True, struct_as_record=False)['dataAll']
    names = ['ms', 'fx', 'fy', 'fz', 'tx', 'ty', 'tz', 'roll', 'pitch', 'yaw']
    write_table(folder / 'log.csv', names, np.column_stack(
        [log.timeStamp - log.timeStamp[0], log.FT_Sensor, log.IMU_Moving]))
    R = Rotation.from_euler('XYZ', log.IMU_Moving, degrees=True).as_matrix()
    signals = {'wrench': wrench('tip', names[1:4], names[4:7]),
               'pose': {'frame': 'base', 'euler_xyz': {'columns': names[7:], 'unit': 'deg'}}}
    yield '', taken(folder, [{'file': 'log.csv', 'time': {'column': 'ms', 'unit': 'ms'},
                              'signals': signals}]), (
        f'{by_least_squares(log.FT_Sensor[:, :3], R):.4f} kg')


def ur5_thesis(data, case, folder):
    for name in case['files']:
        logs = [str((data / name / f'log_{log}.csv').resolve())
                for log in ('force_sensor', 'tool_vector')]
        common = {'header': 0, 'time': {'column': '0', 'unit': 's'}}
        force, pose = (np.genfromtxt(log, delimiter=',', invalid_raise=False) for log in logs)
        turn = np.stack([np.interp(force[:, 0], pose[:, 0], column) for column in pose[:, 4:].T],
                        axis=1)
        plain = by_least_squares(force[:, 1:4], Rotation.from_rotvec(turn).as_matrix())
        yield name.split('/')[-2], taken(folder, [
            {'file': logs[0], **common, 'signals': {'wrench': wrench('ft', '123', '456')}},
            {'file': logs[1], **common, 'signals': {'pose': {
                'frame': 'base', 'position': {'columns': list('123'), 'unit': 'm'},
                'rotation_vector': {'columns': list('456'), 'unit': 'rad'}}}}]), (
            f'{plain:.4f} kg')


AT_WORK = (continuum_tip, iiwa_at_work, lasa_peeling, lasa_wiping, ntnu_ur5, ur5_thesis)
