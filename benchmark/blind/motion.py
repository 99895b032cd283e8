"""Trajectories: rest, static poses, step, free sweep, slow reversals, contact."""

from collections.abc import Callable
from typing import NamedTuple

from blind.rig import Commands, rotations
from blind.robot import Array
import numpy as np

RATE = 250
HOME = np.array([1.0, 0.0, 1.0])
R_HOME = np.diag([1.0, -1.0, -1.0])
TOUCH = 1.08
"""Where S is when the tip of the unloaded tool touches the screen [m]."""


class Place(NamedTuple):
    """Position in base [m] and rotation vector from home, in S [rad]."""

    position: Array
    turn: Array


def quintic(x: Array) -> Array:
    """Return the minimum-jerk profile from 0 to 1."""
    x = np.clip(x, 0.0, 1.0)
    out: Array = x**3 * (10 - 15 * x + 6 * x**2)
    return out


class Path:
    """A trajectory under construction."""

    def __init__(self) -> None:
        self._positions: list[Array] = []
        self._turns: list[Array] = []
        self._phases: list[tuple[str, float, float]] = []
        self._count = 0
        self.at = Place(HOME.copy(), np.zeros(3))

    def _add(self, phase: str, position: Array, turn: Array) -> None:
        start = self._count / RATE
        self._count += len(position)
        self._positions.append(position)
        self._turns.append(turn)
        end = self._count / RATE
        if self._phases and self._phases[-1][0] == phase:
            self._phases[-1] = (phase, self._phases[-1][1], end)
        else:
            self._phases.append((phase, start, end))
        self.at = Place(position[-1], turn[-1])

    def hold(self, phase: str, seconds: float) -> None:
        """Stay."""
        n = max(1, round(seconds * RATE))
        self._add(phase, np.tile(self.at.position, (n, 1)), np.tile(self.at.turn, (n, 1)))

    def go(self, phase: str, seconds: float, position: Array | None = None,
           turn: Array | None = None) -> None:
        """Go to a place on a minimum-jerk profile."""
        share = quintic(np.arange(1, round(seconds * RATE) + 1) / (seconds * RATE))[:, None]
        goal = self.at.position if position is None else position
        turned = self.at.turn if turn is None else turn
        self._add(phase, self.at.position + share * (goal - self.at.position),
                  self.at.turn + share * (turned - self.at.turn))

    def wave(self, phase: str, seconds: float,
             of: Callable[[Array], tuple[Array, Array]]) -> None:
        """Add an oscillation to where it is, faded in and out; ``of`` takes times."""
        t = np.arange(1, round(seconds * RATE) + 1) / RATE
        fade = (quintic(t / 0.5) * quintic((t[-1] - t) / 0.5))[:, None]
        position, turn = of(t)
        self._add(phase, self.at.position + fade * position, self.at.turn + fade * turn)

    def commands(self) -> Commands:
        """Return the finished trajectory."""
        turns = np.concatenate(self._turns)
        return Commands(np.concatenate(self._positions), R_HOME @ rotations(turns),
                        tuple(self._phases))


def trajectory(seconds: float, rng: np.random.Generator) -> Commands:
    """
    Draw a trajectory with every kind of motion.

    Parameters
    ----------
    seconds : float
        About how long, at least 20.
    rng : numpy.random.Generator

    Returns
    -------
    Commands
    """
    path, unit = Path(), seconds / 30.0
    path.hold('settle', 1.2 + 0.8 * unit)
    _poses(path, max(2, round(3.5 * unit)), rng)
    _step(path, rng)
    _sweep(path, 6.0 * unit, rng)
    _reverse(path, 4.5 * unit, rng)
    for _ in range(max(1, round(unit))):
        _contact(path, 5.0, rng)
    path.hold('settle', 0.5)
    return path.commands()


def lazy(seconds: float, rng: np.random.Generator) -> Commands:
    """Draw a recording with too little motion: a millimetre or nothing at all."""
    path = Path()
    path.hold('settle', 0.4 * seconds)
    if rng.random() < 0.5:
        path.go('move', 4.0, HOME + rng.uniform(-1e-3, 1e-3, 3))
    path.hold('measure', seconds - path.commands().phases[-1][2])
    return path.commands()


def _poses(path: Path, count: int, rng: np.random.Generator) -> None:
    for i in range(count):
        axis = i % 2
        turn = rng.uniform(-0.3, 0.3, 3)
        turn[1 - axis] = rng.choice([-1, 1]) * rng.uniform(0.3, 0.9)
        path.go('move', 1.3, HOME + rng.uniform([-0.1, -0.15, -0.1], [0.0, 0.15, 0.15]), turn)
        path.hold('settle', 0.7)
        path.hold('measure', 0.6)
    path.go('move', 1.3, HOME + rng.uniform(-0.02, 0.02, 3), np.zeros(3))
    path.hold('settle', 0.5)


def _step(path: Path, rng: np.random.Generator) -> None:
    size = rng.choice([-1, 1]) * rng.uniform(0.008, 0.012)
    path.go('step', rng.uniform(0.1, 0.13), path.at.position + [size, 0.0, 0.0])
    path.hold('step', 0.8)


def _sweep(path: Path, seconds: float, rng: np.random.Generator) -> None:
    """Sweep each axis in frequency, with overlapping sines of its own."""
    low, high = rng.uniform(0.3, 0.6, 6), rng.uniform(3.0, 7.0, 6)
    strength = np.concatenate([rng.uniform(1.0, 2.5, 3), rng.uniform(2.0, 5.0, 3)])
    most = np.concatenate([np.full(3, 0.05), np.full(3, 0.25)])
    start = rng.uniform(0, 2 * np.pi, 6)

    def of(t: Array) -> tuple[Array, Array]:
        hz = low * (high / low) ** (t[:, None] / seconds)
        phase = 2 * np.pi * np.cumsum(hz, axis=0) / RATE + start
        size = np.minimum(strength / (2 * np.pi * hz) ** 2, most)
        wave = size * np.sin(phase)
        return wave[:, :3], wave[:, 3:]

    path.wave('sweep', seconds, of)
    path.hold('settle', 0.4)


def _reverse(path: Path, seconds: float, rng: np.random.Generator) -> None:
    """Tilt slowly to and fro, so that the tool slides and turns back under gravity."""
    size, hz = rng.uniform(0.15, 0.45), rng.uniform(0.3, 0.6)
    sway, other = rng.uniform(0.0, 0.15), rng.uniform(0.15, 0.25)

    def of(t: Array) -> tuple[Array, Array]:
        turn = np.zeros((len(t), 3))
        turn[:, 1] = size * np.sin(2 * np.pi * hz * t)
        turn[:, 0] = sway * np.sin(2 * np.pi * other * t)
        along = np.zeros((len(t), 3))
        along[:, 0] = 0.02 * np.sin(2 * np.pi * other * t)
        return along, turn

    path.wave('reverse', seconds, of)
    path.hold('settle', 0.4)


def _contact(path: Path, seconds: float, rng: np.random.Generator) -> None:
    tilt = np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.15, 0.15), 0.0])
    side = rng.uniform(-0.1, 0.1, 2)
    path.go('move', 1.0, np.array([1.05, *(HOME[1:] + side)]), tilt)
    path.hold('settle', 0.3)
    near = TOUCH + rng.uniform(0.003, 0.008)
    path.go('approach', rng.uniform(0.5, 1.0), np.array([near, *path.at.position[1:]]))
    deep = near + rng.uniform(0.006, 0.02)
    path.go('contact', rng.uniform(0.2, 0.5), np.array([deep, *path.at.position[1:]]))
    press, slide = rng.uniform(0.002, 0.005), rng.uniform(0.005, 0.03, 2)
    hz, slow = rng.uniform(1.0, 3.5), rng.uniform(0.3, 0.7)

    def of(t: Array) -> tuple[Array, Array]:
        along = np.stack([press * np.sin(2 * np.pi * hz * t),
                          slide[0] * np.sin(2 * np.pi * slow * t),
                          slide[1] * (np.cos(2 * np.pi * slow * t) - 1)], axis=1)
        return along, np.zeros((len(t), 3))

    path.wave('contact', seconds - 2.5, of)
    path.go('retract', 0.6, np.array([1.04, *path.at.position[1:]]))
