"""What simpler methods make of a case: ranking by RMSE, white-noise BIC, a fit of everything.

They are given this rig's own sensitivities, the very equations the cases are made with, which is
more than any of them would have on a real robot.
"""

from typing import Any, NamedTuple

from blind.cases import LIBRARY
from blind.noise import SIGMA
from blind.rig import ACCELEROMETERS, Commands, follow, nominal, Rig, run
from blind.robot import Array
from blind.sensors import record, Recorded
import numpy as np

STEP = 0.004
CHANNELS = ('force.x', 'force.y', 'force.z', 'torque.x', 'torque.y', 'torque.z', 'accel.x',
            'accel.y', 'accel.z', 'optidrive')
SCALE = np.concatenate([SIGMA['wrench'], SIGMA['volts'], SIGMA['slide']])
LOUD = 1.5
"""RMSE over the noise at rest from which a ranking by RMSE would speak of a gap."""
DIRECTED = ('tool_com', 'cable_force', 'base_tilt', 'wrench_bias_drift', 'wrench_gain',
            'wrench_crosstalk', 'accel_gain', 'accel_bias', 'accel_misalignment')
"""Effects with axes of their own: several columns each."""
SURE = 3.0
"""Standard errors from which a fit of everything would name an effect."""


class Columns(NamedTuple):
    """The nominal answer to commands, and how each effect changes it, in units of the noise."""

    nominal: Array
    effects: dict[str, Array]


def sampled(recorded: Recorded, t: Array) -> Array:
    """Return a recording at instants, in units of the nominal noise, (n, 10)."""
    values = [np.interp(t, stamps, column) for stamps, table in (
        (recorded.wrench_t, recorded.wrench), (recorded.volts_t, recorded.volts),
        (recorded.slide_t, recorded.slide[:, None])) for column in table.T]
    return np.asarray(np.stack(values, axis=1) / SCALE)


def columns(commands: Commands, accelerometer: str, t: Array) -> Columns:
    """Return what the nominal rig does, and its change with each effect of the library."""
    rig = nominal(accelerometer)
    motion = follow(rig.robot, commands)
    moved = run(rig, commands, motion)

    def answer(changed: Rig) -> Array:
        same = changed.robot == rig.robot
        if same and f'{changed.tool} {changed.wall}' == f'{rig.tool} {rig.wall}':
            truth = moved  # only its sensors differ
        else:
            truth = run(changed, commands, motion if same else None)
        return sampled(record(changed, truth, None, 0), t)

    was = answer(rig)
    effects: dict[str, Array] = {}
    for name, effect in LIBRARY.items():
        if not effect.random:
            size = float(np.sqrt(effect.low * effect.high))
            effects[name] = np.stack([
                (answer(effect.apply(rig, size, np.random.default_rng(seed))) - was).ravel()
                for seed in range(3 if name in DIRECTED else 1)], axis=1)
    return Columns(was, effects)


def _nuisances(was: Array) -> Array:
    """Return columns of offset and gain of each channel of wrench and accelerometer."""
    out = []
    for j in range(9):
        for column in (np.ones(len(was)), was[:, j] - was[:, j].mean()):
            table = np.zeros_like(was)
            table[:, j] = column
            out.append(table.ravel())
    return np.stack(out, axis=1)


def asked(recorded: Recorded) -> tuple[Array, Commands, str, Array]:
    """Return instants, commands, the accelerometer's name and what was measured."""
    t = np.arange(STEP, recorded.wrench_t[-1], STEP)
    # recognised by its volts at rest, where both feel gravity along z
    away = {name: abs(float(np.median(recorded.volts[:500, 0])) - offset)
            for name, (_, offset, _) in ACCELEROMETERS.items()}
    return (t, Commands(recorded.target_position, recorded.target_R, recorded.phases),
            min(away, key=lambda name: away[name]), sampled(recorded, t))


def judge(recorded: Recorded) -> dict[str, Any]:
    """
    Return what each baseline says of one recording.

    Returns
    -------
    dict
        ``rmse``: ``gap`` and ``channel``; ``bic`` and ``everything``: ``names``, best first.
    """
    t, commands, accelerometer, measured = asked(recorded)
    known = columns(commands, accelerometer, t)
    residual = measured - known.nominal
    rest = residual[t < recorded.phases[0][2]].std(axis=0)
    loud = np.sqrt(np.mean(residual**2, axis=0)) / rest
    r, N = residual.ravel(), _nuisances(known.nominal)
    Q = np.linalg.qr(N)[0]
    r = r - Q @ (Q.T @ r)
    clean = {name: J - Q @ (Q.T @ J) for name, J in known.effects.items()}
    return {'rmse': {'gap': bool(loud.max() > LOUD), 'channel': CHANNELS[int(loud.argmax())]},
            'bic': {'names': _bic(r, clean)}, 'everything': {'names': _everything(r, clean)}}


def _bic(r: Array, effects: dict[str, Array]) -> list[str]:
    """Return effects that lower the BIC of white noise, best first."""
    n = len(r)
    none = n * np.log(r @ r / n)
    score = {}
    for name, J in effects.items():
        theta = np.linalg.lstsq(J, r, rcond=None)[0]
        left = r - J @ theta
        score[name] = n * np.log(left @ left / n) + J.shape[1] * np.log(n)
    return sorted((name for name in score if score[name] < none), key=lambda name: score[name])


def _everything(r: Array, effects: dict[str, Array]) -> list[str]:
    """Return effects whose size in a fit of all of them is beyond its standard error."""
    J = np.concatenate(list(effects.values()), axis=1)
    owner = [name for name, part in effects.items() for _ in range(part.shape[1])]
    scale = np.linalg.norm(J, axis=0) + 1e-300
    U, s, Vt = np.linalg.svd(J / scale, full_matrices=False)
    kept = s > 1e-9 * s[0]
    theta = Vt[kept].T @ ((U[:, kept].T @ r) / s[kept])
    left = r - (J / scale) @ theta
    variance = float(left @ left) / len(r)
    error = np.sqrt(variance * np.sum((Vt[kept].T / s[kept])**2, axis=1))
    sure: dict[str, float] = {}
    for name, one in zip(owner, np.abs(theta) / (error + 1e-300)):
        sure[name] = max(sure.get(name, 0.0), float(one))
    return sorted((name for name in sure if sure[name] > SURE), key=lambda name: -sure[name])
