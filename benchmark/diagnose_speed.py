"""Cost of ``forcecal diagnose`` against length and rate of the recordings and effects asked.

    python benchmark/diagnose_speed.py [SECONDS ...]

Prints a table and draws diagnose_speed.png beside this file; effects and rate are varied on the
shortest pair. Wanted: 60 s on two cores for the whole library and a pair of 60 s.

Pairs of recordings of the simulated rig with a late force sensor, one to fit on and one to judge
on, swinging and turning; processor time and time on the wall of one diagnosis each.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
import sys
import time

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.diagnose.model import hypotheses
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.signals import Signals
from matplotlib.figure import Figure
import numpy as np
from timing import head, row

LENGTHS = (15.0, 30.0, 60.0)
DELAY = 0.004
PICTURE = Path(__file__).with_suffix('.png')


def commands(seconds: float, hertz: float) -> PoseStream:
    """Rest, then swing along x and turn about two axes; seldom twice the same."""
    rig = load_rig()
    t = np.arange(0.0, seconds, rig.robot.period)
    angle, grow = 2 * np.pi * hertz * t, np.clip((t - 2.0) / 2.0, 0.0, 1.0)[:, np.newaxis]
    position = np.array(rig.home.position) + 0.01 * grow * np.stack(
        [np.sin(2 * angle), np.sin(0.7 * angle), np.sin(1.3 * angle)], axis=1)
    turns = grow * np.stack([0.3 * np.sin(angle), 0.4 * np.sin(0.61 * angle), 0.0 * t], axis=1)
    home = np.diag([1.0, -1.0, -1.0])
    return PoseStream(t, position, np.array([home @ rotation_from_vector(turn)
                                             for turn in turns]))


def thinned(recording: Recording, every: int) -> Recording:
    """Keep every n-th sample of the wrench and the accelerometer."""
    return replace(recording, **{
        name: replace(stream, t=stream.t[::every], values=stream.values[::every])
        for name in ('wrench', 'accelerometer') for stream in [getattr(recording, name)]})


@contextmanager
def counted(rig: Rig) -> Iterator[Counter[str]]:
    """Count seconds of replay asked for, and of them those that were simulated anew."""
    seconds: Counter[str] = Counter()

    def counting(part: str, name: str) -> Callable[[Replay, Rig], Signals]:
        whole: Callable[[Replay, Rig], Signals] = getattr(Replay, name)

        def counts(self: Replay, asked: Rig) -> Signals:
            seconds[part] += self.n_periods * rig.robot.period
            return whole(self, asked)

        setattr(Replay, name, counts)
        return whole

    before = {name: counting(part, name)
              for part, name in (('asked', 'signals'), ('simulated', '_simulated'))}
    try:
        yield seconds
    finally:
        for name, whole in before.items():
            setattr(Replay, name, whole)


def cost(pair: list[Recording], rig: Rig, count: int) -> tuple[float, float, str]:
    """Return processor time and time on the wall [s] with the first effects, and the answer."""
    # late, so that every part of the library has the effect that is there
    asked = [n for n in EFFECTS if n != 'wrench_delay'][:count - 1] + ['wrench_delay']
    hypotheses.EFFECTS = {n: EFFECTS[n] for n in asked}  # type: ignore[attr-defined]
    used, start = time.process_time(), time.perf_counter()
    try:
        found = RigSource(rig).diagnose(pair[0], pair[1]).diagnosis
    finally:
        hypotheses.EFFECTS = EFFECTS  # type: ignore[attr-defined]
    return (time.process_time() - used, time.perf_counter() - start,
            f'{found.verdict} {[e.name for e in found.effects]}')


def draw(curves: dict[str, tuple[list[float], list[float]]], path: Path) -> None:
    """Draw the cost over each quantity, from nothing."""
    figure = Figure(figsize=(10, 3), layout='tight')
    axes = figure.subplots(1, len(curves), sharey=True)
    for axis, (label, (x, seconds)) in zip(axes, curves.items()):
        axis.plot(x, seconds, 'o-')
        axis.set(xlabel=label, xlim=(0, None), ylim=(0, None))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel('processor time [s]')
    figure.savefig(path, dpi=110)


def main() -> None:
    lengths = tuple(float(word) for word in sys.argv[1:]) or LENGTHS
    rig = load_rig()
    faulty = with_effects(rig, {'wrench_delay': {'delay': DELAY}})
    pairs = {seconds: [simulate(faulty, commands(seconds, hertz), seed=seed)
                       for seed, hertz in enumerate((0.8, 1.1))] for seconds in lengths}
    short = pairs[lengths[0]]
    runs = [('length of each recording [s]', s, pair, len(EFFECTS)) for s, pair in pairs.items()]
    runs += [('effects asked', n, short, n) for n in (8, 16, 24, len(EFFECTS))]
    runs += [('rate of wrench and accelerometer [Hz]', 1000 // n,
              [thinned(r, n) for r in short], len(EFFECTS)) for n in (4, 2, 1)]
    curves: dict[str, tuple[list[float], list[float]]] = {}
    head('', '', 'processor time', 'on the wall', 'replayed seconds a second',
         'of them simulated anew', 'verdict')
    for label, x, pair, count in runs:
        with counted(rig) as seconds:
            used, wall, said = cost(pair, rig, count)
        row(label, f'{x:g}', f'{used:.1f} s', f'{wall:.1f} s', f'{seconds["asked"] / used:.0f}',
            f'{seconds["simulated"] / used:.0f}', said)
        for values, value in zip(curves.setdefault(label, ([], [])), (x, used)):
            values.append(value)
    draw(curves, PICTURE)


if __name__ == '__main__':
    main()
