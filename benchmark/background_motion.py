"""Commands that a case's recordings follow, drawn anew for each."""

from collections.abc import Sequence

from forcecal_ros.core.geometry import Array, rotation_about, rotation_from_vector
from forcecal_ros.core.streams import Phase, PoseStream
import numpy as np


class _Path:
    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.home = rng, np.array([1.0, 0.0, 1.0])
        self._poses = [np.concatenate([self.home, np.zeros(3)])[None]]
        self._phases: list[Phase] = []
        self._n = 0

    def _add(self, word: str, poses: Array) -> None:
        self._poses.append(poses)
        self._n += len(poses)
        self._phases.append(Phase(word, 0.004 * (self._n - len(poses)), 0.004 * self._n))

    def hold(self, word: str, seconds: float) -> None:
        self._add(word, np.repeat(self._poses[-1][-1:], round(seconds / 0.004), axis=0))

    def go(self, word: str, offset: Sequence[float], turn: Sequence[float], seconds: float
           ) -> None:
        n = round(seconds / 0.004)
        u = np.arange(1, n + 1)[:, None] / n
        way = np.concatenate([self.home + offset, turn]) - self._poses[-1][-1]
        self._add(word, self._poses[-1][-1] + way * u ** 3 * (10.0 - 15.0 * u + 6.0 * u ** 2))

    def wave(self, word: str, size: Array, band: tuple[float, float], seconds: float) -> None:
        t = 0.004 * np.arange(1, round(seconds / 0.004) + 1)
        rise = np.clip(np.minimum(t, seconds - t) / 0.5, 0.0, 1.0)
        angle = 2.0 * np.pi * (band[0] * t + 0.5 * (band[1] - band[0]) * t ** 2 / seconds)
        own = self.rng.uniform(0.8, 1.25, 6)
        rise = rise ** 2 * (3.0 - 2.0 * rise)
        self._add(word, self._poses[-1][-1] + size * rise[:, None] * np.sin(
            np.outer(angle, own)))

    def commands(self) -> tuple[PoseStream, tuple[Phase, ...]]:
        pose = np.concatenate(self._poses)
        R = rotation_about('x', np.pi) @ rotation_from_vector(pose[:, 3:])
        return PoseStream(0.004 * np.arange(len(pose)), pose[:, :3], R), tuple(self._phases)


def trajectory(rng: np.random.Generator, contact: bool = True
               ) -> tuple[PoseStream, tuple[Phase, ...]]:
    """Draw half a minute of poses, a step, a sweep, slow reversals and two contacts, or none."""
    path, still = _Path(rng), np.zeros(3)
    path.hold('measure', 1.5)
    for _ in range(3 if contact else 7):
        path.go('move', rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.9, 0.9, 3), 1.2)
        path.hold('settle', 0.4)
        path.hold('measure', 0.7)
    path.go('move', still, still, 1.2)
    path.hold('settle', 0.4)
    path.go('step', [0.01, 0.0, 0.0], still, 0.1)
    path.hold('step', 0.7)
    size = np.repeat([0.006, 0.06], 3) * rng.uniform(0.7, 1.3, 6)
    path.wave('sweep', size, (rng.uniform(0.4, 0.8), rng.uniform(4.5, 6.5)), 4.5)
    path.hold('settle', 0.4)
    size = np.array([0.035, 0.02, 0.02, 0.1, 0.1, 0.1]) * rng.uniform(0.7, 1.3, 6)
    path.wave('reverse', size, (0.3, 0.3), 5.0)
    path.hold('settle', 0.4)
    for depth in rng.uniform(0.0035, 0.008, 2 if contact else 0):
        path.go('approach', [0.076 + depth, 0.0, 0.0], still, 1.0)
        path.go('contact', [0.08 + depth, 0.0, 0.0], still, 0.3)
        path.hold('contact', 0.5)
        path.wave('contact', np.array([0.002, 0.004, 0.004, 0.0, 0.0, 0.0]), (1.0, 3.0), 1.4)
        path.go('retract', still, still, 1.0)
        path.hold('settle', 0.3)
    return path.commands()
