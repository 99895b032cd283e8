"""Which part of a recording belongs to one rigid body that hangs free, [Traversaro2014] Lemma 1.

There raw measurements are an affine function of the regressors and so span three dimensions at
rest. Contact, a joint that moves and clipping leave that; they are found block by block.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.blocks import Blocks, Mask
import numpy as np

ROUGH_LIMIT = 3.0
"""A block is out when its noise is this many times the usual."""
SHORTEST = 6.0
"""Shortest window [s]."""
SHORTEST_SEGMENT = 3.0
"""Shortest further piece that is kept beside the window [s]."""
POSITIONS = 60
"""Number of positions at which a window's ends are tried before they are refined."""


@dataclass(frozen=True)
class Cut:
    """What was left out: from ``start`` to ``end`` [s], and why."""

    start: float
    end: float
    reason: str


@dataclass(frozen=True)
class Screening:
    """
    What is used of a recording.

    Attributes
    ----------
    kept : tuple of (float, float)
        Stretches, start <= t < end [s].
    cuts : tuple of Cut
        What lies between and around them; of a window that the user gave, what should be cut.
    use : ndarray of bool, shape (b,)
        The blocks inside the stretches.
    """

    kept: tuple[tuple[float, float], ...]
    cuts: tuple[Cut, ...]
    use: Mask


def screen(blocks: Blocks) -> Screening:
    """
    Find the longest window of a rigid body that hangs free, and what else agrees with it.

    Raises
    ------
    DataError
        There is no such window.
    """
    fit = _Fit(blocks)
    use = ~fit.bad
    shortest = SHORTEST
    all_agree = use.sum() * fit.length >= SHORTEST and fit.score(use) > -np.inf
    if not all_agree:
        use[:] = False
    while not all_agree:
        found = _best(fit, use, shortest)
        if found is None:
            break
        use[found] = True
        shortest = SHORTEST_SEGMENT
    if not use.any():
        raise DataError(_refusal(fit))
    return _screened(fit, use & ~fit.out(use))


def given_window(blocks: Blocks, start: float, end: float) -> Screening:
    """
    Use a window as the user states; what should be cut in it is named, not cut.

    Parameters
    ----------
    start, end : float
        start <= t <= end is used [s].

    Raises
    ------
    DataError
        The window holds too little.
    """
    use = (blocks.start >= start - blocks.period / 2) & (blocks.end <= end + blocks.period / 2)
    if use.sum() * blocks.length < SHORTEST_SEGMENT:
        raise DataError(
            f'window {start:g}..{end:g} s has {use.sum() * blocks.samples} samples of a recording '
            f'from {blocks.start[0]:g} to {blocks.end[-1]:g} s; widen it')
    fit = _Fit(blocks)
    suspicious = use & (fit.bad | fit.out(use))
    cuts = tuple(_cut(fit, use & ~suspicious, run) for run in _runs(suspicious))
    return Screening(((start, float(np.nextafter(end, np.inf))),), cuts, use)


def whole(blocks: Blocks) -> Screening:
    """Use everything, unseen."""
    return Screening(((-np.inf, np.inf),), (), np.ones(len(blocks), dtype=bool))


def untouched(blocks: Blocks) -> Screening:
    """Use what is neither clipped nor shaken nor has gaps, however far from affine it is."""
    fit = _Fit(blocks)
    return _screened(fit, ~fit.bad)


class _Fit:
    """Affine model of whitened raw means on the regressors, over any choice of blocks."""

    def __init__(self, blocks: Blocks) -> None:
        self.blocks = blocks
        self.length = blocks.length
        noise = blocks.raw_noise / blocks.samples
        self.white = np.linalg.solve(np.linalg.cholesky(noise), blocks.raw.T).T
        self.white -= np.median(self.white, axis=0)
        self.x = np.column_stack([np.ones(len(blocks)), blocks.regressors])
        self.bad = blocks.gap | blocks.clipped.any(axis=1) | (blocks.roughness > ROUGH_LIMIT)
        self.usual = 0.0
        self.usual = self._usual()

    def _usual(self) -> float:
        """Residual that a quarter of all stretches of some seconds stay below, 0 where few."""
        # length of these stretches [s]
        seconds = 15.0
        length, found = round(seconds / self.length), []
        for start in range(0, len(self.bad) - length + 1, max(1, len(self.bad) // POSITIONS)):
            use = np.zeros(len(self.bad), dtype=bool)
            use[start:start + length] = ~self.bad[start:start + length]
            if use.sum() > 0.8 * length and length > 2 * self.x.shape[1]:
                norms = np.linalg.norm(self.residual(use)[0][use], axis=1)
                found.append(np.quantile(norms, 0.95))
        return float(np.quantile(found, 0.25)) if len(found) > 3 else 0.0

    def residual(self, use: Mask) -> tuple[Array, float, float]:
        """Whitened residual of all blocks under the fit to some; what its norm should, may be."""
        theta = np.linalg.lstsq(self.x[use], self.white[use], rcond=None)[0]
        fitted = self.x @ theta
        moved = fitted[use] - fitted[use].mean(axis=0)
        signal = np.sqrt((moved ** 2).sum(axis=1).mean())
        # a block is out when its whitened residual exceeds so many deviations of a mean's noise,
        # so large a share of what gravity moves the channels by, and so many times what is usual
        # in quiet stretches (hysteresis and the like), but never more than the last share
        of_noise, of_signal, of_usual, at_most = 6.0, 0.03, 3.0, 0.15
        limit = max(of_noise * np.sqrt(self.white.shape[1]), of_signal * signal)
        most = max(limit, min(of_usual * self.usual, at_most * signal))
        return self.white - fitted, float(limit), float(most)

    def out(self, use: Mask) -> Mask:
        """Return which blocks do not agree with the fit to some."""
        residual, _, most = self.residual(use)
        return np.asarray(np.linalg.norm(residual, axis=1) > most)

    def score(self, use: Mask) -> float:
        """
        How much a choice of blocks is worth: one a block, less its squared residual over limit.

        Minus infinity when more than a few stray blocks disagree with the choice's own fit.
        """
        if use.sum() <= self.x.shape[1]:
            return -np.inf
        residual, limit, most = self.residual(use)
        norms = np.linalg.norm(residual[use], axis=1)
        # share of a window's blocks that may be out (and are cut) without ending the window
        stray = 0.01
        if (norms > most).mean() > stray:
            return -np.inf
        return float((1 - (norms / limit) ** 2).sum())


def _best(fit: _Fit, base: Mask, shortest: float) -> slice | None:
    """Best run of blocks beside those already in use, None if all are too short."""
    least = max(1, round(shortest / fit.length))
    free = list(_runs(~fit.bad & ~base))
    step = max(1, sum(run.stop - run.start for run in free) // POSITIONS)
    tries = sorted(((b - a, a, b, run) for run in free
                    for a in range(run.start, run.stop, step)
                    for b in range(run.stop, a, -step) if b - a >= least),
                   key=lambda entry: entry[0], reverse=True)
    best, found, already = fit.score(base), None, int(base.sum())
    for length, a, b, run in tries:
        if already + length <= best:
            break
        score = fit.score(_with(base, a, b))
        if score > best:
            best, found = score, (a, b, run)
    return None if found is None else _refine(fit, base, best, *found)


def _refine(fit: _Fit, base: Mask, best: float, a: int, b: int, run: slice) -> slice:
    """Move both ends block by block for as long as the score grows."""
    moves = ((-1, 0), (0, 1), (1, 0), (0, -1))
    grown = True
    while grown:
        grown = False
        for left, right in moves:
            start, stop = a + left, b + right
            if run.start <= start < stop <= run.stop:
                score = fit.score(_with(base, start, stop))
                if score > best:
                    best, a, b, grown = score, start, stop, True
    return slice(a, b)


def _with(base: Mask, a: int, b: int) -> Mask:
    use = base.copy()
    use[a:b] = True
    return use


def _runs(mask: Mask) -> Iterator[slice]:
    """Return the maximal runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    for a, b in edges.reshape(-1, 2):
        yield slice(int(a), int(b))


def _stretches(blocks: Blocks, use: Mask) -> Iterator[tuple[float, float]]:
    for run in _runs(use):
        end = blocks.start[run.stop] if run.stop < len(blocks) else np.inf
        yield float(blocks.start[run.start]), float(end)


def _screened(fit: _Fit, use: Mask) -> Screening:
    return Screening(tuple(_stretches(fit.blocks, use)),
                     tuple(_cut(fit, use, run) for run in _runs(~use)), use)


def _cut(fit: _Fit, use: Mask, run: slice) -> Cut:
    """Say why a run of blocks is not used."""
    blocks = fit.blocks
    residual, *_ = fit.residual(use)
    channel = int(np.abs(residual[run]).max(axis=0).argmax())
    clipped = blocks.clipped[run].any(axis=0)
    rough = float(blocks.roughness[run].max())
    mine = np.zeros(len(use), dtype=bool)
    mine[run] = True
    if clipped.any():
        reason = f'channel {int(clipped.argmax()) + 1} is clipped'
    elif blocks.gap[run].any():
        reason = 'the stamps have a gap'
    elif (run.stop - run.start) * fit.length >= SHORTEST and fit.score(mine) > 0:
        reason = ('fits another matrix: a joint or the load moved, the sensor was tared, or there '
                  'was steady contact')
    else:
        size = float(np.linalg.norm(residual[run], axis=1).max() / np.sqrt(len(residual[0])))
        reason = (f'deviates from the affine map of gravity by {size:.0f} times the noise, most '
                  f'in channel {channel + 1}: contact, or a moving joint')
        if rough > ROUGH_LIMIT:
            reason += f'; shaken ({rough:.0f} times the usual noise)'
    return Cut(float(blocks.start[run.start]), float(blocks.end[run.stop - 1]), reason)


def _refusal(fit: _Fit) -> str:
    blocks = fit.blocks
    length = blocks.end[-1] - blocks.start[0]
    usable = ~fit.bad
    counted = ((blocks.clipped.any(axis=1), 'clipped'), (blocks.gap, 'with gaps'),
               (blocks.roughness > ROUGH_LIMIT, 'shaken'))
    why = f'of {len(blocks)} blocks ' + ', '.join(
        f'{int(found.sum())} {word}' for found, word in counted if found.any())
    why = why if fit.bad.any() else f'none of {len(blocks)} blocks clipped, shaken or with gaps'
    if usable.sum() > fit.x.shape[1]:
        out = fit.out(usable)[usable].mean()
        why = f'{out:.0%} of them deviate from the affine map of gravity ({why})'
    return (f'no {SHORTEST:g} s of the {length:.0f} s fit one rigid body that hangs free: {why}; '
            'keep the body off the ground, lock its joints, and check the accelerometer, or use '
            '`rows: poses` for a nonlinear sensor')
