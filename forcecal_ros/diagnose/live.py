"""The gap while the robot runs: simulated second by second, judged against the noise at rest."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.dataset import CHANNELS, MeasuredBlocks
from forcecal_ros.diagnose.model.evidence import fit, Gram, Prior
from forcecal_ros.diagnose.model.jacobian import sensor_change
from forcecal_ros.diagnose.recordings import scale_to_volts
from forcecal_ros.effects.nuisances import nuisances, prior_std
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.simulator import checked_commands, held_commands, Samples, Simulator
from forcecal_ros.sim.signals import BLOCK, RATE, Signals
import numpy as np
from numpy.typing import NDArray

LEARN = 3.0
"""Standstill after the first command in which the noise is learned [s]."""

WINDOW = 5.0
"""Length of what is judged at a time [s]."""

TENTH = 25
"""Blocks in a tenth of a second; in means over these a small but lasting excess shows."""

ALARM = 10.0
"""Sigmas from which a channel's energy is more than noise."""

SMALL = 0.25
"""Excess that is let pass, of blocks or their means, in noise RMS."""


STREAMS = np.array([c.stream for c in CHANNELS])
"""Name of the stream of each channel."""


class Judgement(NamedTuple):
    """
    What the last seconds say.

    Attributes
    ----------
    learning : bool
        The noise is not known yet.
    excess : dict of str to float
        Of every channel, in noise RMS.
    stage : str
        First stage along the chain that is out of its noise now; empty: none.
    channels : tuple of str
        That are.
    first : str
        Stage that left it first since the start; empty: none has.
    """

    learning: bool
    excess: dict[str, float]
    stage: str = ''
    channels: tuple[str, ...] = ()
    first: str = ''


class _Link(NamedTuple):
    """
    One stage of the chain: what it is seen in, and what its nuisances are fitted to.

    What is downstream does not count: a wrong wrench shall not bend the tool.
    """

    stage: str
    seen_in: tuple[str, ...]
    fitted_to: tuple[str, ...]
    touching: bool = False


CHAIN = (
    _Link('robot', ('pose',), ('pose',)),
    _Link('tool', ('optidrive',), ('pose', 'optidrive')),
    _Link('wrench_sensor', ('wrench',), ('optidrive', 'wrench')),
    _Link('accelerometer', ('accelerometer',), ('optidrive', 'accelerometer')),
    _Link('environment', ('optidrive', 'wrench', 'accelerometer'),
          ('optidrive', 'wrench', 'accelerometer'), True),
)
"""Stages in the order in which blame is laid; the environment for what shows in contact only."""

AFTER = 250
"""Blocks after contact that count as contact, since the tool still rings."""


class _Block(NamedTuple):
    """Residual and columns of some blocks, which channels are there, and when it touches."""

    residual: Array
    columns: Array
    present: NDArray[np.bool_]
    touching: NDArray[np.bool_]


class LiveGap:
    """
    Follows one robot from a command at rest on.

    Parameters
    ----------
    rig : Rig
        Nominal.
    streams : sequence of str
        Sensors there are, of ``wrench``, ``accelerometer``, ``optidrive``, ``pose``.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.
    """

    def __init__(self, rig: Rig, streams: Sequence[str], accelerometer: str | None = None) -> None:
        self._name = accelerometer or rig.accelerometer.mounted
        self._rig = replace(rig, pose_sensor=replace(rig.pose_sensor, rate=RATE))
        self._nuisances = nuisances(self._rig, self._name, tuple(streams))
        self._prior_std = prior_std(self._rig, self._nuisances)
        variants = [n.apply(self._rig, size) for n, size in zip(self._nuisances, self._prior_std)
                    if n.acts_on == 'rig']
        self._simulators = [Simulator(r, self._name) for r in (self._rig, *variants)]
        self._period = rig.robot.period
        self._periods = 0
        self._command = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4))
        self._learned: list[Array] = []
        self._sigma = np.zeros((2, len(CHANNELS)))
        m = len(self._nuisances)
        self._grams = dict.fromkeys(CHAIN, Gram(np.zeros((m, m)), np.zeros(m), 0.0, 0))
        self._recent: list[_Block] = []
        self._since_contact = AFTER
        self._lasting = 0
        self._first = ''

    @property
    def time(self) -> float:
        """How far it has judged since the first command [s]."""
        return self._periods * self._period

    def judge(self, recording: Recording, origin: float, until: float) -> Judgement:
        """
        Take in what was recorded since the last time.

        Parameters
        ----------
        recording : Recording
            With commands and sensors of that time at least.
        origin : float
            When the robot's period 0 began, by the recording's times [s].
        until : float
            All sensors have been received up to then [s].
        """
        n = int(np.floor((until - origin) / self._period + 1e-6)) - self._periods
        if n > 0:
            start = origin + self._periods * self._period
            self._advance(recording, start, n)
        return self._judgement()

    def _advance(self, recording: Recording, start: float, n: int) -> None:
        commands = self._commands(recording, start, n)
        signals = [self._signals(s.run(*commands, noise=False), start) for s in self._simulators]
        self._periods += n
        model = self._rig.accelerometer.model(self._name)
        volts = scale_to_volts(recording, np.array(model.gain), np.array(model.offset))
        measured = MeasuredBlocks(volts, start, n)
        nominal = measured.residual(signals[0])
        touching = self._near_contact(signals[0], n)
        columns = np.zeros((len(self._nuisances), n, len(CHANNELS)))
        varied = iter(signals[1:])
        for i, (nuisance, size) in enumerate(zip(self._nuisances, self._prior_std)):
            if nuisance.acts_on == 'rig':
                columns[i] = nominal - measured.residual(next(varied))
            else:
                channel, columns[i, :, channel] = sensor_change(
                    nuisance, size, self._rig, signals[0], self._name)
        columns *= measured.present
        self._take(_Block(nominal, columns, measured.present, touching))

    def _commands(self, recording: Recording, start: float, n: int) -> tuple[Array, Array]:
        """Return what is commanded in n periods; without a new one, the last command holds."""
        target, (t, positions, xyzw) = recording.target, self._command
        if target is not None:
            new = checked_commands(target.position, target.R_base_sensor)
            t, positions, xyzw = (np.concatenate(both) for both in zip(
                self._command, (target.t, *new)))
        if not len(t):
            raise DataError('no commands were received; the simulator follows target_frame')
        starts = np.asarray(start + self._period * np.arange(n), dtype=np.float64)
        held = held_commands(t, starts, 0.5 * self._period)
        positions, xyzw = positions[held], xyzw[held]
        self._command = np.full(1, -np.inf), positions[-1:].copy(), xyzw[-1:].copy()
        return positions, xyzw

    def _signals(self, s: Samples, start: float) -> Signals:
        nothing = np.zeros((len(s.wrench), 3))
        slide = s.optidrive if len(s.optidrive) else np.zeros(len(s.wrench))
        return Signals(start, s.wrench, s.volts, slide, s.position, s.R_base_sensor, nothing,
                       nothing, nothing, nothing, slide, s.contact, s.specific_force)

    def _take(self, block: _Block) -> None:
        if self.learning:
            self._learned.append(np.where(block.present, block.residual, np.nan))
            if self.time >= LEARN:
                self._learn()
            return
        scale = np.where(self._sigma[0] > 0.0, 1.0 / np.maximum(self._sigma[1], 1e-300), 0.0)
        scale /= np.sqrt(TENTH)
        for link in CHAIN:
            rows = np.ones(len(block.touching), dtype=bool) if link.touching else ~block.touching
            cols = np.flatnonzero(np.isin(STREAMS, link.fitted_to) & (scale > 0.0))
            here = np.ix_(rows, cols)
            white = (block.columns[:, here[0], here[1]] * scale[cols]).reshape(
                len(block.columns), -1)
            r = ((block.residual * block.present)[here] * scale[cols]).ravel()
            self._grams[link] = self._grams[link] + Gram(
                white @ white.T, white @ r, float(r @ r), len(r))
        self._recent.append(block)
        while sum(len(b.residual) for b in self._recent[1:]) * BLOCK >= WINDOW:
            self._recent.pop(0)

    @property
    def learning(self) -> bool:
        """Whether the noise is not known yet."""
        return not self._sigma.any()

    def _learn(self) -> None:
        """Take the noise at rest, of blocks and of means over a tenth of a second."""
        rows = np.concatenate(self._learned)
        rows = rows[:len(rows) // TENTH * TENTH]
        there = np.isfinite(rows).mean(axis=0) > 0.5
        rows = np.nan_to_num(rows - np.nanmean(np.where(there, rows, 0.0), axis=0))
        means = rows.reshape(-1, TENTH, rows.shape[1]).mean(axis=1)
        single = np.std(rows, axis=0)
        self._sigma[0] = np.where(there, single, 0.0)
        self._sigma[1] = np.where(there, np.maximum(np.std(means, axis=0),
                                                    single / np.sqrt(TENTH)), 0.0)

    def _near_contact(self, s: Signals, n: int) -> NDArray[np.bool_]:
        """Say which blocks are in contact, or shortly after it, nominally."""
        touching = np.abs(s.contact).reshape(n, -1).max(axis=1) > 0.0
        block = np.arange(n)
        last = np.maximum.accumulate(np.where(touching, block, -1 - self._since_contact))
        self._since_contact = int(n - 1 - last[-1])
        return np.asarray(block - last <= AFTER)

    def _judgement(self) -> Judgement:
        if not self._recent:
            return Judgement(self.learning, {}, first=self._first)
        excess: dict[str, float] = {}
        stage, out = '', tuple[str, ...]()
        for link in CHAIN:
            here = self._judged(link)
            if not link.touching:
                excess.update({name: value for name, (value, _) in here.items()})
            bad = tuple(name for name, (value, z) in here.items() if z > ALARM and value > SMALL)
            if bad and not stage:
                stage, out = link.stage, bad
        self._lasting = self._lasting + 1 if stage else 0
        if self._lasting < 2:  # judgements in a row
            stage, out = '', ()
        self._first = self._first or stage
        return Judgement(False, excess, stage, out, self._first)

    def _judged(self, link: _Link) -> dict[str, list[float]]:
        """Return excess in noise RMS, and sigmas, of the channels of one stage."""
        m = len(self._nuisances)
        limits = np.array([n.limit for n in self._nuisances])
        x = fit(self._grams[link], Prior(np.zeros(m), np.ones(m), -limits, limits)).x
        parts = [np.where(b.present, b.residual - np.tensordot(x, b.columns, 1), 0.0)[
            b.touching == link.touching] for b in self._recent]
        rest = np.concatenate(parts)
        n = len(rest) // TENTH * TENTH
        if not n:
            return {}
        means = rest[:n].reshape(-1, TENTH, rest.shape[1]).mean(axis=1)
        there = np.flatnonzero(np.isin(STREAMS, link.seen_in) & (self._sigma[0] > 0.0))
        sigma, counts = self._sigma[:, there], np.array([[len(rest)], [len(means)]])
        over = np.stack([np.mean(rows[:, there] ** 2, axis=0) for rows in (rest, means)]
                        ) / sigma ** 2 - 1.0
        excess = np.sqrt(np.maximum(over, 0.0)) * sigma / sigma[0]
        z = over / np.sqrt(2.0 / counts)
        return {CHANNELS[c].name: both for c, *both in zip(
            there, excess.max(axis=0).tolist(), z.max(axis=0).tolist())}
