"""The diagnosis as data, and as the document ``diagnosis.json``."""

from collections.abc import Mapping
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from forcecal_ros.core.errors import DataError
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.judge.named_effects import instants, NamedEffect, Parameter
from forcecal_ros.diagnose.judge.ties import Tie
from forcecal_ros.diagnose.localise.localisation import Location

FORMAT = 'forcecal-diagnosis/1'


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
    candidates : tuple of (str, float)
        The 95 % set with probabilities, most probable first.
    not_excited : tuple of str
        Effects that these recordings could not show.
    remainder : dict of str to float
        Statistics of what is unexplained; under that name in ``diagnosis.json``.
    used : dict of str to float
        Part of each stream's samples that counts.
    ties : tuple of Tie
        What no motion tells from effects accepted; notes say so in ``diagnosis.json``.
    """

    verdict: str
    reason: str
    effects: tuple[NamedEffect, ...] = ()
    candidates: tuple[tuple[str, float], ...] = ()
    localisation: tuple[Location, ...] = ()
    gap: Gap | None = None
    not_excited: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    remainder: dict[str, float] | None = None
    used: dict[str, float] | None = None
    ties: tuple[Tie, ...] = ()


NO_MOTION = Diagnosis('not_excited',
                      'the robot does not move; record a motion that turns the tool '
                      'and speeds it up')
"""The diagnosis of a recording in which the robot does not move."""


def to_document(diagnosis: Diagnosis, units: dict[str, str], rig: str | None) -> dict[str, Any]:
    """
    Return ``diagnosis.json`` as a dictionary.

    Parameters
    ----------
    units : dict of str to str
        Of the channels.
    rig : str or None
        Name of the patched rig file beside it.
    """
    d = diagnosis
    document: dict[str, Any] = {
        'format': FORMAT, 'verdict': d.verdict, 'reason': d.reason,
        'effects': [{
            'name': e.name, 'probability': round(e.probability, 4),
            'parameters': {k: _number(p) for k, p in e.parameters.items()},
            **_when(e)} for e in d.effects],
        'candidates': [{'name': n, 'probability': round(p, 4)} for n, p in d.candidates],
        'where': [{'stage': w.stage, 'channel': w.channel, 'phase': w.phase,
                   'band_hz': list(w.band_hz), 'excess': w.excess, 'p': w.p}
                  for w in d.localisation],
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


def _number(p: Parameter) -> dict[str, Any]:
    """Give a number with its standard error, or say that it has none."""
    bound = {'at_bound': True} if p.at_bound else {}
    return {'value': p.value, 'std': p.std, 'unit': p.unit, **bound}


def _when(effect: NamedEffect) -> dict[str, Any]:
    """Say when an effect that began or ended during a recording did."""
    out: dict[str, Any] = {}
    for word, at, ci95 in instants(effect):
        out |= {word: at, f'{word}_ci95': list(ci95)}
    return {**out, 'recording': effect.recording} if out else out


def load(path: Path | str) -> tuple[Diagnosis, dict[str, Any]]:
    """
    Read ``diagnosis.json``, or that of a folder of results.

    Returns
    -------
    diagnosis : Diagnosis
        Without what the file does not hold.
    document : dict
        The whole file.

    Raises
    ------
    DataError
        It cannot be read, or is none.
    """
    path = Path(path)
    path = path / 'diagnosis.json' if path.is_dir() else path
    try:
        document = json.loads(path.read_text())
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror}); name a diagnosis.json of '
                        '`forcecal diagnose`') from error
    except ValueError as error:
        raise DataError(f'{path}: is damaged ({error}); diagnose again') from error
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise DataError(f'{path}: is no diagnosis of this version ({FORMAT}); diagnose again')
    try:
        return _from_document(document), document
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(f'{path}: is damaged ({type(error).__name__} {error}); diagnose again'
                        ) from error


def _from_document(d: Mapping[str, Any]) -> Diagnosis:
    """Turn what :func:`to_document` returns into a diagnosis again."""
    return Diagnosis(
        str(d['verdict']), str(d['reason']),
        effects=tuple(NamedEffect(
            str(e['name']), {key: Parameter(float(p['value']), float(p['std']), str(p['unit']),
                                            bool(p.get('at_bound')))
                             for key, p in e['parameters'].items()}, float(e['probability']),
            e.get('from'), end=e.get('to')) for e in d['effects']),
        candidates=tuple((str(c['name']), float(c['probability'])) for c in d['candidates']),
        localisation=tuple(Location(w['stage'], w['channel'], w['phase'], tuple(w['band_hz']),
                                    float(w['excess']), float(w['p'])) for w in d['where']),
        gap=_gap(d['gap']) if d.get('gap') else None,
        not_excited=tuple(d['not_excited']), notes=tuple(d['notes']))


def _gap(g: Mapping[str, Any]) -> Gap:
    low, high = g['closed_ci95']
    return Gap(
        float(g['nominal']), float(g['recalibrated']), float(g['explained']), float(g['closed']),
        (float(low), float(high)),
        {name: (float(v['nominal_rms']), float(v['recalibrated_rms']), float(v['explained_rms']),
                float(v['noise_rms'])) for name, v in g['per_channel'].items()})
