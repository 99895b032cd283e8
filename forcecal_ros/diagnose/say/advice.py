"""What to record next: the motion that tells two effects apart, or shows what none has shown."""

from collections.abc import Sequence

from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.plan.recording import motion_for
from forcecal_ros.diagnose.say.result import Diagnosis
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

STREAMS = ('wrench', 'accelerometer', 'optidrive')

OPTIONS = {'contact': ' --contact'}
"""Options of forcecal plan that add phases which it leaves out otherwise."""


def advice(diagnosis: Diagnosis, rig: Rig) -> str:
    """
    Say what to record next.

    Parameters
    ----------
    rig : Rig
        As given, without what was found.

    Returns
    -------
    str
        One sentence with one phase of the planned sequence; empty where nothing is missing.
    """
    return _to_tell_apart(diagnosis, rig) or _to_show(diagnosis.not_excited)


def _to_show(names: Sequence[str]) -> str:
    shown: dict[str, list[str]] = {}
    for name in names:
        for phase in EFFECTS[name].excited_by if name in EFFECTS else ():
            shown.setdefault(phase, []).append(name)
    if not shown:
        return ''
    phase = max(shown, key=lambda one: len(shown[one]))
    return (f'{_recorded(phase)}: it shows {_listed(shown[phase])}, which this recording cannot '
            'show.')


def _to_tell_apart(diagnosis: Diagnosis, rig: Rig) -> str:
    named = [e.name for e in diagnosis.effects if e.name in EFFECTS]
    same = {tie.other for tie in diagnosis.ties}  # no motion tells them apart
    others = [n for n, _ in diagnosis.candidates if n in EFFECTS and n not in {*named, *same}]
    if diagnosis.verdict != 'ambiguous' or not named:
        return ''
    for other in others:
        try:
            phase, energy = separating(rig, named[0], other)[0]
        except ForcecalError:
            continue
        return (f'{_recorded(phase)}: it tells {named[0]} from {other}; at typical sizes they '
                f'differ there by {float(f"{energy:.2g}"):,.12g} times the energy of the noise.')
    return ''


def _recorded(phase: str) -> str:
    command = f'forcecal plan{OPTIONS.get(phase, "")} -o plan.yaml'
    return f'Record phase {phase} of the sequence that {command} writes'


def _listed(names: Sequence[str]) -> str:
    return ' and '.join(', '.join(names).rsplit(', ', 1))


def separating(rig: Rig, one: str, other: str) -> list[tuple[str, float]]:
    """
    Rank the motions of the planned sequence by how far apart two effects come in them.

    Parameters
    ----------
    one, other : str
        Effects, taken at their typical sizes.

    Returns
    -------
    list of (str, float)
        Phase and whitened energy of what the one does beyond the other's best imitation, best
        first.
    """
    motion = motion_for(rig, contact=False)
    target, phases = motion.target, motion.phases
    nominal = simulate(rig, target, noise=False)
    deltas = [_difference(simulate(_with(rig, name), target, noise=False), nominal, rig)
              for name in (one, other)]
    overlap = sum(float(a.ravel() @ b.ravel()) for a, b in zip(*(d.values() for d in deltas)))
    size = sum(float(np.sum(b ** 2)) for b in deltas[1].values())
    share = overlap / size if size > 0.0 else 0.0
    energy: dict[str, float] = {}
    for role, a in deltas[0].items():
        t = getattr(nominal, role).t
        rest = np.sum((a - share * deltas[1][role]) ** 2, axis=1)
        for phase in phases:
            rows = (t >= phase.start) & (t < phase.end)
            energy[phase.name] = energy.get(phase.name, 0.0) + float(rest[rows].sum())
    return sorted(energy.items(), key=lambda pair: -pair[1])


def _with(rig: Rig, name: str) -> Rig:
    return with_effects(rig, {name: {q.name: q.typical for q in EFFECTS[name].parameters}})


def _difference(changed: Recording, nominal: Recording, rig: Rig) -> dict[str, Array]:
    """Return what an effect does to each sensor, in its noise."""
    force, torque = rig.wrench_sensor.force_noise, rig.wrench_sensor.torque_noise
    noise = {'wrench': np.repeat([force, torque], 3), 'accelerometer': rig.accelerometer.noise,
             'optidrive': rig.optidrive.noise if rig.optidrive else 1.0}
    return {role: (getattr(changed, role).values - getattr(nominal, role).values) / noise[role]
            for role in STREAMS if getattr(nominal, role) is not None}
