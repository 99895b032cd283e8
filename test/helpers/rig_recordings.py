"""The nominal rig recorded over one motion by this package's simulator and by the second rig."""

from dataclasses import replace
from pathlib import Path

from forcecal_ros.core.streams import Phase, PoseStream, Recording
from forcecal_ros.effects import with_effects
from forcecal_ros.io.bags import write_recording
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from scipy.spatial.transform import Rotation

PERIOD = 0.004
HOME = np.array([1.0, 0.0, 1.0])
R_HOME = np.diag([1.0, -1.0, -1.0])

MOTION = (
    ('measure', 1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('move', 1.6, (0.0, 0.0, 0.0), (0.0, -np.pi / 2, 0.0)),
    ('settle', 0.8, (0.0, 0.0, 0.0), (0.0, -np.pi / 2, 0.0)),
    ('measure', 0.8, (0.0, 0.0, 0.0), (0.0, -np.pi / 2, 0.0)),
    ('move', 1.6, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('settle', 0.8, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('measure', 0.8, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('step', 0.1, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('step', 1.4, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('move', 0.5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('approach', 1.0, (0.075, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('settle', 0.4, (0.075, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('contact', 0.6, (0.09, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('contact', 1.0, (0.09, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('retract', 1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('settle', 0.4, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ('move', 1.0, (0.02, 0.05, -0.04), (0.35, 0.25, -0.3)),
    ('move', 1.0, (0.0, -0.03, 0.03), (-0.3, 0.2, 0.4)),
    ('move', 1.0, (0.0, 0.0, 0.0), (0.35, 0.25, -0.3)),
    ('settle', 0.6, (0.0, 0.0, 0.0), (0.35, 0.25, -0.3)),
    ('approach', 1.0, (0.07, 0.0, 0.0), (0.35, 0.25, -0.3)),
    ('contact', 0.6, (0.11, 0.01, 0.0), (0.35, 0.25, -0.3)),
    ('contact', 0.8, (0.11, 0.01, 0.0), (0.35, 0.25, -0.3)),
    ('retract', 1.0, (0.0, 0.0, 0.0), (0.35, 0.25, -0.3)),
    ('settle', 0.6, (0.0, 0.0, 0.0), (0.35, 0.25, -0.3)))
"""Phase, duration [s], where to: from home in base [m], rotation vector from home [rad]."""

FREE = MOTION[:10]
"""Of these the two poses and the step, which is less than half, without a wall."""


def motion(parts=MOTION):
    """Return positions (n, 3) and rotations (n, 3, 3), one every 4 ms, and the phases."""
    at, positions, turns, phases, begin = np.zeros(6), [], [], [], 0.0
    for name, seconds, offset, turn in parts:
        n, goal = round(seconds / PERIOD), np.array([*offset, *turn])
        x = np.arange(n)[:, np.newaxis] / n
        way = at + x**3 * (10.0 - 15.0 * x + 6.0 * x**2) * (goal - at)
        positions.append(HOME + way[:, :3])
        turns.append(way[:, 3:])
        if phases and phases[-1].name == name:
            phases[-1] = replace(phases[-1], end=begin + seconds)
        else:
            phases.append(Phase(name, begin, begin + seconds))
        at, begin = goal, begin + seconds
    rotations = R_HOME @ Rotation.from_rotvec(np.concatenate(turns)).as_matrix()
    return np.concatenate(positions), rotations, tuple(phases)


def commands(parts=MOTION):
    """Return the commands of the motion and its phases."""
    positions, rotations, phases = motion(parts)
    return PoseStream(PERIOD * np.arange(len(positions)), positions, rotations), phases


def switched(before, after, at):
    """Return a recording that goes over to another one of the same motion at an instant [s]."""
    streams = {}
    for name in ('wrench', 'accelerometer', 'optidrive'):
        if (one := getattr(before, name)) is not None:
            streams[name] = replace(one, values=np.where(
                one.t[:, np.newaxis] < at, one.values, getattr(after, name).values))
    return replace(before, **streams)


def swaying(rig, angle, way, rate) -> PoseStream:
    """Return commands of 12 s that turn by an angle [rad], and sway by [m] at a rate [Hz]."""
    t = PERIOD * np.arange(3000)
    u = np.clip(t - 1.5, 0.0, 8.0)
    rise = np.minimum(1.0, np.minimum(u, 8.0 - u))
    rise = rise ** 3 * (10.0 - 15.0 * rise + 6.0 * rise ** 2)
    turns = np.outer(angle * rise * np.sin(u * np.pi / 2.0), [0.5, 1.0, 0.3])
    return PoseStream(
        t, np.array(rig.home.position) + np.outer(rise * np.sin(2.0 * np.pi * rate * u), way),
        np.array(rig.home.R_base_sensor) @ Rotation.from_rotvec(turns).as_matrix())


def shaken(rig, target, rate, size, seed, shown=1.0) -> Recording:
    """Return what a rig measures that shakes, of which poses at half its rate show a part."""
    robot = simulate(rig, shaking(target, rate, size, seed), seed=seed)
    poses = robot if shown == 1.0 else simulate(
        rig, shaking(target, rate, shown * size, seed), seed=seed + 50)
    return replace(robot, pose=poses.pose.rows(slice(None, None, 2)))


def shaking(target, rate, size, seed) -> PoseStream:
    """Return commands that also shake eight times, about a rate [Hz] and by a size [m]."""
    rng, way = np.random.default_rng(seed), np.zeros((len(target), 3))
    for begin in np.arange(2.5, 8.5, 0.75):
        u, own = target.t - begin, rng.uniform(0.9 * rate, 1.1 * rate)
        shake = np.exp(-0.5 * (u / 0.2) ** 2) * np.sin(2.0 * np.pi * (own * u + rng.uniform()))
        way += np.outer(shake, rng.normal(size=3) * size)
    return replace(target, position=target.position + way)


def own_recording(seed: int = 8, parts=MOTION, effects=None) -> Recording:
    """Return what this package's simulator makes of the motion, with noise and some effects."""
    target, phases = commands(parts)
    rig = with_effects(load_rig(), effects or {})
    return replace(simulate(rig, target, seed=seed), phases=phases)


def bare(recording: Recording) -> Recording:
    """Leave wrench, pose and commands, which are diagnosed in half the time."""
    return replace(recording, accelerometer=None, optidrive=None)


def write_second(folder: Path, seed: int = 9) -> Path:
    """
    Let the second rig, which shares no code with this package, run the motion.

    Its recording with white noise is ``folder/bag``; ``folder/clean.npz`` is the same without
    noise, of both accelerometers, with the true contact force. Its steps of 0.125 ms meet the
    edge of the wall, where the force jumps by the damping of 50 N s/m, to ``accuracy`` [N].
    """
    from blind.rig import Commands, nominal, run
    from blind.sensors import record
    from blind_tool import to_recording

    positions, rotations, phases = motion()
    commands = Commands(positions, rotations, tuple((p.name, p.start, p.end) for p in phases))
    rig = nominal()
    truth = run(rig, commands)
    clean, other = (record(one, truth, None, seed) for one in (rig, nominal('acc2')))
    n = len(clean.wrench_t)
    np.savez(folder / 'clean.npz', t=clean.wrench_t, wrench=clean.wrench, volts=clean.volts,
             volts_acc2=other.volts, contact_force=truth.felt.contact[4::4][:n],
             optidrive=clean.slide, position=truth.motion.position[4::4][:n],
             target_t=clean.target_t, target_position=positions, target_rotation=rotations,
             accuracy=2e-3)
    write_recording(folder / 'bag', to_recording(record(rig, truth, white(), seed)))
    return folder


def white():
    """Return the noise of the nominal rig as its description has it, for the second rig."""
    from blind.noise import Colour, SIGMA
    return {name: [Colour(1.0, np.ones(1), np.ones(1)) for _ in sigma]
            for name, sigma in SIGMA.items()}
