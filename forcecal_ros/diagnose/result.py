"""The diagnosis as data, as ``diagnosis.json``, and as a patched rig or calibration."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import json
from pathlib import Path
import re
from typing import Any

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import DataError
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.judge.named_effects import (
    Checks,
    instants,
    NamedEffect,
    Parameter,
    parameters_of,
)
from forcecal_ros.diagnose.localise import Location
from forcecal_ros.diagnose.model.evidence import Earlier, FIRST_RECORDING
from forcecal_ros.diagnose.model.gates import BIAS, kind_of
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.posterior import Posterior
from forcecal_ros.effects import named_effects, physical_rig, with_effects
from forcecal_ros.effects.nuisances import apply_all
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rigid_tool import RigidTool
import numpy as np

FORMAT = 'forcecal-diagnosis/1'


LISTS = ('not_excited', 'notes', 'at_tolerance', 'remarks', 'joints')
"""Attributes of a diagnosis that ``diagnosis.json`` holds by the same key."""


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
    used : dict of str to float
        Part of each stream's samples that counts.
    not_compared : tuple of str
        What of the recordings was left out.
    at_tolerance : tuple of str
        Numbers of the model that would be further off if their tolerances let them.
    remarks : tuple of str
        What a simulator reports of its own run, as a drive at its limit.
    joints : tuple of str
        Names of the channels joint.0, joint.1, ... in model and recording.
    earlier : Earlier
        What a further recording continues from.
    """

    verdict: str
    reason: str
    effects: tuple[NamedEffect, ...] = ()
    candidates: tuple[tuple[str, float], ...] = ()
    localisation: tuple[Location, ...] = ()
    gap: Gap | None = None
    not_excited: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    used: dict[str, float] | None = None
    not_compared: tuple[str, ...] = ()
    at_tolerance: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    earlier: Earlier = FIRST_RECORDING

    def label(self, text: str) -> str:
        """Return a text with the joints called as model and recording call them."""
        return re.sub(r'\bjoint\.(\d+)', lambda found: self.joints[int(found[1])], text
                      ) if self.joints else text


NO_MOTION = Diagnosis('not_excited',
                      'the robot does not move; record a motion that rotates the tool '
                      'and accelerates it')
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
            **_active_interval(e)} for e in d.effects],
        'candidates': [{'name': n, 'probability': round(p, 4)} for n, p in d.candidates],
        'where': [{**w._asdict(), 'band_hz': list(w.band_hz)} for w in d.localisation],
        **{key: list(getattr(d, key)) for key in LISTS},
        'used': d.used or {},
        'posterior': {
            'explanations': [{'effects': sorted(names), 'log_evidence': round(e, 3)}
                             for names, e in d.earlier.evidence.items()],
            'missing': round(d.earlier.missing, 3)}}
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
    more = {'at_bound': p.at_bound, 'nominal': p.nominal}
    return {'value': p.value, 'std': p.std, 'unit': p.unit,
            **{key: value for key, value in more.items() if value not in (None, False)}}


def _active_interval(effect: NamedEffect) -> dict[str, Any]:
    """Say when an effect acted, if not all the time: from or to an instant, in one recording."""
    out: dict[str, Any] = {} if effect.recording is None else {'recording': effect.recording}
    for word, at, ci95 in instants(effect):
        out |= {word: at, f'{word}_ci95': list(ci95)}
    return out


def load_diagnosis(path: Path | str) -> tuple[Diagnosis, dict[str, Any]]:
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
        raise DataError(f'{path}: is not a diagnosis of this version ({FORMAT}); diagnose again')
    try:
        return _from_document(document), document
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(f'{path}: is damaged ({type(error).__name__} {error}); diagnose again'
                        ) from error


def _from_document(d: Mapping[str, Any]) -> Diagnosis:
    """Turn what :func:`to_document` returns into a diagnosis again."""
    posterior = d.get('posterior', {})
    lists: dict[str, Any] = {key: tuple(d[key]) for key in LISTS}
    explanations = posterior.get('explanations', ())
    earlier = FIRST_RECORDING if not explanations else Earlier(
        {frozenset(map(str, one['effects'])): float(one['log_evidence'])
         for one in explanations}, float(posterior.get('missing', 0.0)),
        {e['name']: {key: (float(p['value']), float(p['std']))
                     for key, p in e['parameters'].items()} for e in d['effects']})
    return Diagnosis(
        str(d['verdict']), str(d['reason']),
        effects=tuple(NamedEffect(
            str(e['name']), {key: Parameter(float(p['value']), float(p['std']), str(p['unit']),
                                            bool(p.get('at_bound')), p.get('nominal'))
                             for key, p in e['parameters'].items()}, float(e['probability']),
            e.get('from'), end=e.get('to'), recording=e.get('recording'))
            for e in d['effects']),
        candidates=tuple((str(c['name']), float(c['probability'])) for c in d['candidates']),
        localisation=tuple(Location(**{**w, 'band_hz': tuple(w['band_hz'])})
                           for w in d['where']),
        gap=_gap(d['gap']) if d.get('gap') else None,
        earlier=earlier, **lists)


def _gap(g: Mapping[str, Any]) -> Gap:
    low, high = g['closed_ci95']
    return Gap(
        float(g['nominal']), float(g['recalibrated']), float(g['explained']), float(g['closed']),
        (float(low), float(high)),
        {name: (float(v['nominal_rms']), float(v['recalibrated_rms']), float(v['explained_rms']),
                float(v['noise_rms'])) for name, v in g['per_channel'].items()})


IDENTIFIABLE = 0.5
"""Standard error, in its prior's, up to which the motion identifies a delay or an inertia."""


def patched_calibration(calibration: Calibration, rigid_tool: RigidTool,
                        std: Mapping[str, float]) -> Calibration:
    """
    Give a calibration what was found: biases, mass, centre of mass, inertia, delay.

    Parameters
    ----------
    rigid_tool : RigidTool
        With what was recalibrated, and the effects.
    std : mapping of str to float
        Standard errors of what was recalibrated; a delay or an inertia that the motion does not
        identify stays as calibrated.
    """
    c, a, found = calibration, calibration.accelerometer, physical_rig(rigid_tool)
    named, spreads = named_effects(rigid_tool.effects), rigid_tool.spreads
    if a is not None:
        behind = (rigid_tool.accel_behind + named.get('accel_delay', {}).get('delay', 0.0)
                  - named.get('wrench_delay', {}).get('delay', 0.0))
        of_delay, bias = std.get('accelerometer.delay', 0.0), named.get('accel_bias', {})
        off = np.array(rigid_tool.accelerometer.model().offset) + [bias.get(x, 0.0) for x in 'xyz']
        a = replace(
            a, offset=Estimate(a.offset.value + a.matrix @ off, a.offset.std, a.offset.unit),
            delay=Estimate(behind, of_delay, 's')
            if 0.0 < of_delay < IDENTIFIABLE * spreads.accel_behind else a.delay)
    about, inertia = np.array([std.get(f'tool.inertia.{axis}', 0.0) for axis in 'xyz']), c.inertia
    if about.min() > 0.0 and about.max() < IDENTIFIABLE * spreads.own_inertia:
        inertia = Estimate(found.tool.inertia, np.sqrt(np.outer(about, about)), 'kg m^2')
    return replace(
        c, inertia=inertia, mass=Estimate(found.tool.mass, c.mass.std, 'kg'),
        com=Estimate(found.tool.com, c.com.std, 'm'), accelerometer=a,
        wrench_bias=Estimate(rigid_tool.wrench_sensor.bias, c.wrench_bias.std, c.wrench_bias.unit))


def _lasts(model: LinearisedModel, name: str) -> bool:
    """Say whether a rig still has an effect when the recordings end, and can be given it."""
    gate = model.gates.get(name)
    return kind_of(name) != BIAS.name and (gate is None or gate.lasts(len(model.datasets)))


def patched_rig(model: LinearisedModel, selection: Posterior, checks: Checks) -> Rig:
    """
    Recalibrate the rig and give it the effects, those that share a nuisance by their own name.

    Parameters
    ----------
    model : LinearisedModel
        At the joint fit.
    """
    # a simulator's own number stays one of the rig, however far it moved
    own = {n.key for n in model.nuisances if n.prior_std is not None}
    values = {n.name: float(x) for n, x in zip(model.nuisances, model.centre * model.prior_std)
              if n.name not in model.released or n.key in own}
    effects = {a.name: {k: v.value for k, v in parameters_of(model, a).items()}
               for a in selection.accepted
               if model.library[a.name].nuisance not in own and _lasts(model, a.name)}
    effects.update({n: {k: v.value for k, v in found.items()}
                    for n, found in checks.effects.items()})
    return with_effects(apply_all(model.rig, model.nuisances, values), effects)
