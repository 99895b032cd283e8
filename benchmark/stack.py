"""Tares at every rate of the wrench, poses from /tf and joints; prints tables of figures.md.

    python benchmark/stack.py                  # 50 seeds each, some four minutes
    python benchmark/stack.py --seeds 0        # poses from /tf and joints alone

Noise is the simulated rig's, stamps jitter by a tenth of a period, one sample in twenty is lost
on every topic. The observer is fed as its node feeds it, and tared at the end.
"""

from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import replace
import os
from pathlib import Path
import sys
import time
from typing import Any

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.io.transforms import TF
from forcecal_ros.io.urdf import Description
from forcecal_ros.nodes.wire import JointsReader, Reader, Writer
from forcecal_ros.observe import design, noise_levels
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.playback import events
from forcecal_ros.observe.pose_sources import JointPose, TransformPose
from geometry_msgs.msg import PoseStamped
import numpy as np
from observing import calibration, lossy, observed, push, record, Swing
from rosbags.typesys import get_typestore, Stores
from scipy.spatial.transform import RigidTransform, Rotation

RATES = (10.0, 50.0, 125.0, 500.0, 1000.0)
"""Of the wrench [Hz]."""

OTHERS = (1000.0, 250.0)
"""Rates of accelerometer and pose where they are the rig's [Hz]."""

SECONDS = 3.5
"""Of each recording: what 20 samples at 10 Hz want, and a second for the filters to settle [s]."""

JOINTS, ROUNDS = (2, 7), 3
"""Transforms between base and sensor, of a gantry and an arm; runs of which the least counts."""

STORE = get_typestore(Stores.ROS2_JAZZY)

AT_REST = {'at rest': {}}
REFUSED = {
    'shaken by 2 mm at 2 Hz': {'swing': Swing(place=(0.002, 0.0, 0.0))},
    'moved by 2 mm/s': {'swing': Swing(place=(0.02, 0.0, 0.0), place_hz=0.016, start=-1.0)},
    'turned by 5 mrad/s': {'swing': Swing(turn=0.05, turn_hz=0.016, axis=(0.0, 1.0, 0.0),
                                          start=-1.0)},
    'pushed by 5 N from 0.25 s on': {'contact': push(0, 5.0, SECONDS - 0.25)}}
"""What happens to the tool while a tare is asked for, by name."""


def calibrated(rate: float) -> Calibration:
    """Return a calibration whose noise was measured at a rate of the wrench."""
    known = calibration()
    assert known.noise is not None
    return replace(known, noise=replace(known.noise, wrench_rate=rate))


def tared(seed: int, rates: tuple[float, float, float], known: Calibration, **scene: object
          ) -> bool:
    """Return whether a tare succeeds."""
    live = observed(lossy(record(SECONDS, seed=seed, rates=rates, **scene), seed), design(known))
    try:
        live.tare(live.model, noise_levels(known.noise))
    except DataError:
        return False
    return True


def row(name: str, cells: list[str]) -> None:
    print(f'| {" | ".join([name, *cells])} |', flush=True)


def counted(name: str, seeds: int, rates: tuple[float, float], calibrated_at: float | None,
            scene: dict[str, object]) -> list[int]:
    """Print how many tares of each rate succeed."""
    counts = [sum(tared(seed, (rate, *rates), calibrated(calibrated_at or rate), **scene)
                  for seed in range(seeds)) for rate in RATES]
    row(name, [f'{count}/{seeds}' for count in counts])
    return counts


def joints_of(pose: PoseStream, count: int) -> list[bytes]:
    """Return what robot_state_publisher says of an arm of so many joints: serialised messages."""
    kind, rng = STORE.types, np.random.default_rng(3)
    stamps = np.round(1e9 * pose.t).astype(int)
    links = [RigidTransform.from_components(
        rng.uniform(-0.3, 0.3, 3), Rotation.from_rotvec(
            np.sin(2.0 * (k + 1) * pose.t)[:, None] * rng.uniform(-1.0, 1.0, 3)))
        for k in range(count - 1)]
    last = RigidTransform.from_components(pose.position, Rotation.from_matrix(pose.R_base_sensor))
    for link in links:
        last = link.inv() * last
    names = ['base', *(f'arm_link_{k + 1}' for k in range(count - 1)), 'ft_sensor']
    parts = [(link.translation, link.rotation.as_quat()) for link in (*links, last)]

    def message(n: int) -> bytes:
        stamp = kind['builtin_interfaces/msg/Time'](*divmod(int(stamps[n]), 10**9))
        return bytes(STORE.serialize_cdr(kind[TF]([
            kind['geometry_msgs/msg/TransformStamped'](
                kind['std_msgs/msg/Header'](stamp, parent), child,
                kind['geometry_msgs/msg/Transform'](
                    kind['geometry_msgs/msg/Vector3'](*p[n]),
                    kind['geometry_msgs/msg/Quaternion'](*q[n])))
            for parent, child, (p, q) in zip(names, names[1:], parts)]), TF))

    return [message(n) for n in range(len(stamps))]


def said_by_joints(pose: PoseStream) -> tuple[list[bytes], Callable[[bytes], Any]]:
    """Return serialised JointStates of three slides and three turns, and their reader."""
    kind, names = STORE.types, ['x', 'y', 'z', 'yaw', 'pitch', 'roll']
    middle = Rotation.from_matrix(pose.R_base_sensor[0])
    angles = np.unwrap((Rotation.from_matrix(pose.R_base_sensor) * middle.inv())
                       .as_euler('ZYX'), axis=0)
    parents, axes = ['base', *names], (0, 1, 2, 2, 1, 0)
    joints = ''.join(
        f'<joint name="{name}" type="{"prismatic" if k < 3 else "continuous"}">'
        f'<parent link="{parents[k]}"/><child link="{name}"/>'
        f'<axis xyz="{" ".join(str(int(i == axes[k])) for i in range(3))}"/></joint>'
        for k, name in enumerate(names))
    rpy = ' '.join(map(repr, middle.as_euler('xyz').tolist()))
    text = (f'<robot name="gantry">{joints}<joint name="mount" type="fixed"><parent link="roll"/>'
            f'<child link="ft_sensor"/><origin rpy="{rpy}"/></joint></robot>').encode()

    def message(t: float, positions: Array) -> bytes:
        stamp = kind['builtin_interfaces/msg/Time'](*divmod(round(1e9 * t), 10**9))
        return bytes(STORE.serialize_cdr(kind['sensor_msgs/msg/JointState'](
            kind['std_msgs/msg/Header'](stamp, ''), names, positions, np.zeros(6), np.zeros(6)),
            'sensor_msgs/msg/JointState'))

    poses = JointPose(Description(text, 'gantry'), 'base', 'ft_sensor', 'pose', 'gantry')
    read = JointsReader(poses.drivers)
    return [message(t, one) for t, one in zip(
        pose.t.tolist(), np.hstack([pose.position, angles]))], lambda raw: poses.take(*read(raw))


def run_with(recording: Recording, raw: list[bytes],
             read: Callable[[bytes], Any]) -> tuple[Array, float]:
    """Return the contact wrenches of a recording with poses read from messages, and the time."""
    live, poses, found = LiveObserver(0.5, 0.5), iter(raw), []
    live.take_over(design(calibration()))
    takes = {'wrench': live.on_wrench, 'accelerometer': live.on_accelerometer,
             'displacement': live.on_displacement}
    happened = list(events(recording))
    began = time.process_time()
    for t, kind, values in happened:
        if kind == 'pose':
            stamped = read(next(poses))
            found += live.on_pose(stamped[0] * 1e-9, stamped[1])
        else:
            found += takes[kind](t, values)
    took = time.process_time() - began
    return np.array([sample.contact for sample in found]), 1e6 * took / len(happened)


def transforms() -> bool:
    """Print how far contact wrenches by /tf, joints and a topic are apart, and what each costs."""
    recording = record(4.0, seed=1, rates=(1000.0, 1000.0, 1000.0),
                       swing=Swing(place=(0.02, 0.0, 0.01), turn=0.3), contact=push(0, 20.0, 3.0))
    pose = recording.pose
    write = Writer(PoseStamped, 'base')
    topic = [write(round(1e9 * t), (*p, *q)) for t, p, q in zip(
        pose.t.tolist(), pose.position.tolist(),
        quaternion_from_matrix(pose.R_base_sensor).tolist())]
    row('pose at 1 kHz from', ['time a message', 'ratio', 'contact wrench apart'])
    row('---', ['---'] * 3)
    reference, least = run_with(recording, topic, Reader(PoseStamped))
    for _ in range(ROUNDS):
        least = min(least, run_with(recording, topic, Reader(PoseStamped))[1])
    row('a topic', [f'{least:.1f} us', '', ''])
    good = True
    sources: list[tuple[str, list[bytes], Callable[[], Callable[[bytes], Any]]]] = [
        (f'/tf, {count} transforms', joints_of(pose, count),
         lambda: TransformPose('base', 'ft_sensor').take) for count in JOINTS]
    messages, read = said_by_joints(pose)
    sources.append(('joint_states and a URDF, 6 joints', messages, lambda: read))
    for name, messages, reader in sources:
        runs = [run_with(recording, messages, reader()) for _ in range(ROUNDS)]
        apart, took = np.abs(runs[0][0] - reference).max(), min(took for _, took in runs)
        good = good and apart < 0.02
        row(name, [f'{took:.1f} us', f'{took / least:.2f}', f'{apart:.2g} N, N m'])
    return good


def main() -> int:
    """Count, print; status 1 where tares or contact wrenches are not as they are wanted."""
    parser = ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seeds', type=int, default=50, help='recordings of each cell (50)')
    seeds = parser.parse_args().seeds
    if not transforms():
        return 1
    if not seeds:
        return 0
    print()
    row('tares that succeed, wrench at', [f'{rate:g} Hz' for rate in RATES])
    row('---', ['---'] * len(RATES))
    rest = [counted('at rest', seeds, OTHERS, None, {}),
            counted('at rest, calibrated at 1000 Hz', seeds, OTHERS, 1000.0, {}),
            counted('at rest, accelerometer 125 Hz, poses 50 Hz', seeds, (125.0, 50.0), None, {})]
    moved = [counted(name, seeds, OTHERS, None, scene) for name, scene in REFUSED.items()]
    return int(min(map(min, rest)) < 0.98 * seeds or max(map(max, moved)) > 0)


if __name__ == '__main__':
    raise SystemExit(main())
