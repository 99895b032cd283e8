"""The diagnosis as data, and as the document ``diagnosis.json``."""

from dataclasses import dataclass
from typing import Any

from forcecal_ros.diagnose.gap import Gap
from forcecal_ros.diagnose.where import Place

FORMAT = 'forcecal-diagnosis/1'


@dataclass(frozen=True)
class Parameter:
    """One estimated number of an effect."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Found:
    """
    An effect that the verdict names.

    Attributes
    ----------
    name : str
    parameters : dict of str to Parameter
    probability : float
    begin : float, optional
        When it began [s]; it was there from the start where none is given.
    begin_ci95 : tuple of float, optional
    recording : int
        0, or 1 where it began in the second one.
    """

    name: str
    parameters: dict[str, Parameter]
    probability: float
    begin: float | None = None
    begin_ci95: tuple[float, float] | None = None
    recording: int = 0


@dataclass(frozen=True)
class Diagnosis:
    """
    The outcome.

    Attributes
    ----------
    verdict : str
        no_gap, identified, ambiguous, partial, unknown, not_excited or invalid_data.
    reason : str
        The verdict in one sentence.
    effects : tuple of Found
    candidates : tuple of (str, float)
        The 95 % set with probabilities, most probable first.
    where : tuple of Place
    gap : Gap or None
    not_excited : tuple of str
        Effects that these recordings could not show.
    notes : tuple of str
    remainder : dict of str to float
        Statistics of what is left.
    used : dict of str to float
        Part of each stream's samples that counts.
    """

    verdict: str
    reason: str
    effects: tuple[Found, ...] = ()
    candidates: tuple[tuple[str, float], ...] = ()
    where: tuple[Place, ...] = ()
    gap: Gap | None = None
    not_excited: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    remainder: dict[str, float] | None = None
    used: dict[str, float] | None = None


def to_document(diagnosis: Diagnosis, units: dict[str, str], rig: str | None) -> dict[str, Any]:
    """
    Return ``diagnosis.json`` as a dictionary.

    Parameters
    ----------
    diagnosis : Diagnosis
    units : dict of str to str
        Of the channels.
    rig : str or None
        Name of the patched rig file beside it.

    Returns
    -------
    dict
    """
    d = diagnosis
    document: dict[str, Any] = {
        'format': FORMAT, 'verdict': d.verdict, 'reason': d.reason,
        'effects': [{
            'name': e.name, 'probability': round(e.probability, 4),
            'parameters': {k: {'value': p.value, 'std': p.std, 'unit': p.unit}
                           for k, p in e.parameters.items()}, **_when(e)} for e in d.effects],
        'candidates': [{'name': n, 'probability': round(p, 4)} for n, p in d.candidates],
        'where': [{'stage': w.stage, 'channel': w.channel, 'phase': w.phase,
                   'band_hz': list(w.band_hz), 'excess': w.excess, 'p': w.p}
                  for w in d.where],
        'not_excited': list(d.not_excited), 'notes': list(d.notes),
        'remainder': d.remainder or {}, 'used': d.used or {}}
    if d.gap is not None:
        g = d.gap
        document['gap'] = {
            'nominal': g.nominal, 'recalibrated': g.recalibrated, 'explained': g.explained,
            'closed': g.closed, 'closed_ci95': list(g.closed_ci95),
            'per_channel': {name: {
                'nominal_rms': v[0], 'recalibrated_rms': v[1], 'explained_rms': v[2],
                'noise_rms': v[3], 'unit': units[name]} for name, v in g.channels.items()},
            'contact_force_error': dict(zip(
                ('nominal', 'recalibrated', 'explained'), g.contact_force))}
    if rig:
        document['rig'] = rig
    return document


def _when(effect: Found) -> dict[str, Any]:
    """Say from when on an effect that began during a recording was there."""
    if effect.begin is None or effect.begin_ci95 is None:
        return {}
    return {'from': effect.begin, 'from_ci95': list(effect.begin_ci95),
            'recording': effect.recording}
