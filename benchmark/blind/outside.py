"""Effects that the library under test lacks; ``outside.yaml`` has their equations and sizes."""

from hashlib import sha256
import math
from pathlib import Path
from typing import Any

from blind.effect import Effect, sensing, sign
from blind.effects_sensing import delayed
from blind.rig import GRAVITY, Rig
from blind.robot import Array
import numpy as np
import yaml

Random = np.random.Generator
TABLE = Path(__file__).with_name('outside.yaml')


def _warming(rng: Random) -> Any:
    settle = rng.uniform(8.0, 40.0)
    return lambda t: 1 - np.exp(-t / settle)[:, None]


def _thermal_gain(rig: Rig, size: float, rng: Random) -> Rig:
    rise, way = _warming(rng), sign(rng)
    return sensing(rig, wrench=lambda truth, u, _: u * (1 + way * size * rise(truth.t)))


def _wrench_quadratic(rig: Rig, size: float, rng: Random) -> Rig:
    chosen = np.zeros(6)
    chosen[rng.choice(3, rng.integers(1, 3), replace=False)] = sign(rng) * size / 100.0
    return sensing(rig, wrench=lambda truth, u, _: u + chosen * u**2)


def _torque_hum(rig: Rig, size: float, rng: Random) -> Rig:
    phases = rng.uniform(0, 2 * math.pi, 3)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        turn = 2 * math.pi * 50.02 * truth.t[:, None]
        hum = size * np.sin(turn + phases) + size / 3 * np.sin(3 * turn)
        return np.hstack([u[:, :3], u[:, 3:] + hum])

    return sensing(rig, wrench=stage)


def _wrench_spikes(rig: Rig, size: float, rng: Random) -> Rig:
    rate = rng.uniform(0.5, 3.0)

    def stage(truth: Any, u: Array, source: Random) -> Array:
        out = u.copy()
        hit = np.flatnonzero(source.random(len(u)) < rate / 1000)
        out[hit, :3] += size * source.standard_normal((len(hit), 3))
        return out

    return sensing(rig, wrench_reading=stage)


def _wrench_interference(rig: Rig, size: float, rng: Random) -> Rig:
    axes, start = rng.choice(3, 2, replace=False), rng.uniform(0, 5)

    def stage(truth: Any, u: Array, _: Random) -> Array:
        phase = (truth.t + start) % 5.0
        chirp = np.where(phase < 2, np.sin(2 * math.pi * (phase + phase**2 / 2))
                         * np.sin(math.pi * np.minimum(phase, 2) / 2), 0.0)
        out = u.copy()
        out[:, axes] += size * chirp[:, None]
        return out

    return sensing(rig, wrench=stage)


def _accel_rectification(rig: Rig, size: float, rng: Random) -> Rig:
    return sensing(rig, specific=lambda truth, f, _: f + size / GRAVITY * f**2)


def _accel_thermal_gain(rig: Rig, size: float, rng: Random) -> Rig:
    rise, way = _warming(rng), sign(rng)
    return sensing(rig, specific=lambda truth, f, _: f * (1 + way * size * rise(truth.t)))


def _optidrive_scale(rig: Rig, size: float, rng: Random) -> Rig:
    scale = 1 + sign(rng) * size
    return sensing(rig, slide=lambda truth, s, _: s * scale)


def _optidrive_interpolation(rig: Rig, size: float, rng: Random) -> Rig:
    return sensing(rig, slide=lambda truth, s, _: s + size * np.sin(2 * math.pi * s / 4e-4))


def _pose_latency(rig: Rig, size: float, rng: Random) -> Rig:
    def stage(truth: Any, pose: Any, _: Random) -> Any:
        late = np.maximum(np.arange(len(truth.t)) - round(size / 0.00025), 0)
        return delayed(truth.t, pose[0], size), pose[1][late]

    return sensing(rig, pose=stage)


def _pose_scale(rig: Rig, size: float, rng: Random) -> Rig:
    scale = 1 + sign(rng) * size
    return sensing(rig, pose=lambda truth, pose, _: (
        pose[0][:1] + scale * (pose[0] - pose[0][:1]), pose[1]))


def _servo_ripple(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(robot=rig.robot._replace(ripple=size, ripple_pitch=0.02))


def _turn_servo(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(robot=rig.robot._replace(turn_servo=60.0 / (1 + size)))


def _hertzian_contact(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(power=1 + size, depth=0.003))


def _screen_friction(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(grip=size))


def _screen_adhesion(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(pull=size, reach=0.001))


def _screen_mode(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(wall=rig.wall._replace(mass=size))


def _relaxing_spring(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(tool=rig.tool._replace(
        branch=size, relaxation=float(np.exp(rng.uniform(np.log(0.15), np.log(1.5))))))


def _slide_stop(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(tool=rig.tool._replace(stop=0.020 - size, stop_stiffness=1e5))


def _slosh(rig: Rig, size: float, rng: Random) -> Rig:
    return rig._replace(tool=rig.tool._replace(
        slosh_mass=size, slosh_hz=rng.uniform(1.5, 4.0)))


def _load() -> tuple[Effect, ...]:
    table = yaml.safe_load(TABLE.read_text())['effects']
    return tuple(
        Effect(name, row['stage'], float(row['size']['low']), float(row['size']['high']),
               row['size']['unit'], globals()['_' + name], random=name == 'wrench_spikes')
        for name, row in table.items())


EFFECTS = _load()


def fingerprint() -> dict[str, str]:
    """Return the SHA-256 of the equations and of the code that carries them out."""
    return {path.name: sha256(path.read_bytes()).hexdigest()
            for path in (TABLE, Path(__file__))}
