"""The adapter between a simulation and the engine, and what a diagnosis of it consists of."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from forcecal_ros.core.errors import DataError, with_id
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.dataset import Dataset, split_datasets, units
from forcecal_ros.diagnose.engine import diagnose_datasets, Outcome
from forcecal_ros.diagnose.judge.named_effects import estimated, readable
from forcecal_ros.diagnose.model.evidence import FIRST_RECORDING
from forcecal_ros.diagnose.recordings import Corrected, require_same_sensors
from forcecal_ros.diagnose.result import Diagnosis, NO_MOTION, to_document
from forcecal_ros.effects.rig import Rig

RECALIBRATION_SIGMA = 3.0
"""Standard errors of a recalibration from which it is reported: once in 400 by chance."""

_UNITS = {'accelerometer.delay': 's', 'tool.com': 'm', 'tool.inertia': 'kg m^2',
          'pose.shake_delay': 's', 'pose.compliance': 's^2'}
"""Units of nuisances by their names without axis; those that are not listed are relative."""


@dataclass(frozen=True)
class Ready:
    """
    A recording made ready for the engine.

    Attributes
    ----------
    stamps : Corrected
        What its stamps and values show.
    given : Recording
        As recorded, with the streams that are compared.
    notes : tuple of str
        What was left out.
    """

    dataset: Dataset
    stamps: Corrected
    given: Recording
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Diagnosed:
    """
    A diagnosis and what belongs to its source.

    Attributes
    ----------
    unit : str
        Of the accelerometer.
    details : dict
        Further keys of ``diagnosis.json``.
    files : dict of str to str
        Name and text of what is written next to it.
    """

    outcome: Outcome
    ready: tuple[Ready, ...] = ()
    unit: str = 'V'
    details: dict[str, Any] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)

    @property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis alone."""
        return self.outcome.diagnosis

    def document(self) -> dict[str, Any]:
        """Return ``diagnosis.json`` as a dictionary."""
        written = {name.partition('_')[0]: name for name in self.files}
        rig = written.pop('rig', None)
        return {**to_document(self.diagnosis, units(self.unit), rig), **self.details, **written}


class Source:
    """
    What recordings are compared with.

    A child makes recordings ready: each gets a simulation, whose signals, nuisances with priors
    and library of effects the engine uses, and the blocks of its residual.

    Parameters
    ----------
    rig : Rig
        Nominal model; of a third-party simulator its tolerances.

    Attributes
    ----------
    task : str
        What it does, for a progress bar.
    explained_by : str
        What the recording is compared with, in ``diagnosis.json``; empty for a rig.
    requires_motion : bool
        Whether a robot at rest shows it nothing.
    by_phase : bool
        Whether parts of every phase of a single recording are judged on, else every other second.
    tolerance : float or None
        RMS of what is unexplained, in that of a channel's noise, that does not matter; None: the
        default, TOLERANCE, or as exact as a simulation is where that is coarser.
    earlier : Earlier
        What earlier recordings of the same robot found; set both before diagnosing.
    ready : tuple of Ready
        The recordings, as ``diagnose`` made them ready.
    """

    task = 'comparing'
    explained_by = ''
    requires_motion = True
    by_phase = False
    ready: tuple[Any, ...] = ()

    def __init__(self, rig: Rig, unit: str = 'V') -> None:
        self.rig, self.unit, self.earlier = rig, unit, FIRST_RECORDING
        self.tolerance: float | None = None

    def diagnose(self, recording: Recording, heldout: Recording | None = None) -> Diagnosed:
        """
        Find where, why and how far a recording departs from the simulation.

        Parameters
        ----------
        recording : Recording
            To fit on.
        heldout : Recording or None
            To judge on; parts of ``recording`` if None.

        Returns
        -------
        Diagnosed
            ``invalid_data`` with its reason if the data cannot answer.
        """
        given = [one for one in (recording, heldout) if one is not None]
        self.ready = ()
        try:
            require_same_sensors(given)
            self.ready = tuple(self.prepare(given))
        except DataError as error:
            return self._diagnosed(Outcome(Diagnosis('invalid_data', with_id(error)), self.rig))
        if self.requires_motion and not all(
                (one.dataset.groups == 1).any() for one in self.ready):
            self.ready = ()
            return self._diagnosed(Outcome(NO_MOTION, self.rig))
        outcome = self.search()
        if outcome.diagnosis.verdict != 'invalid_data':
            found = express_in_unit(self.unit, outcome.diagnosis)
            outcome = replace(outcome, diagnosis=self.explain(found, outcome))
        return self._diagnosed(outcome)

    def _diagnosed(self, outcome: Outcome) -> Diagnosed:
        explained = {'explained_by': self.explained_by} if self.explained_by else {}
        return Diagnosed(outcome, self.ready, self.unit, {**explained, **self.details(outcome)},
                         self.files(outcome))

    def prepare(self, recordings: Sequence[Recording]) -> Sequence[Ready]:
        """Make recordings ready; a DataError becomes ``invalid_data``."""
        raise NotImplementedError

    def search(self) -> Outcome:
        """Search for effects and judge them."""
        datasets = [one.dataset for one in self.ready]
        return diagnose_datasets(datasets[0].rig, split_datasets(datasets, self.by_phase),
                                 [one.stamps for one in self.ready],
                                 [one.given for one in self.ready], self.tolerance, self.earlier)

    def explain(self, diagnosis: Diagnosis, outcome: Outcome) -> Diagnosis:
        """Add to a diagnosis what the user should know of the comparison."""
        notes = dict.fromkeys(note for one in self.ready for note in one.notes)
        return replace(diagnosis, notes=(*diagnosis.notes, *notes))

    def details(self, outcome: Outcome) -> dict[str, Any]:
        """Return further keys of ``diagnosis.json``."""
        return {}

    def files(self, outcome: Outcome) -> dict[str, str]:
        """Return files with the numbers found, text by name."""
        return {}


def express_in_unit(unit: str, diagnosis: Diagnosis) -> Diagnosis:
    """Give accelerations in sentence, notes and parameters the unit that was compared."""
    def words(text: str) -> str:
        return text.replace(' V RMS in accel', f' {unit} RMS in accel')

    return replace(
        diagnosis, reason=words(diagnosis.reason), notes=tuple(map(words, diagnosis.notes)),
        effects=tuple(replace(e, parameters={
            k: replace(p, unit=unit) if p.unit == 'V' else p for k, p in e.parameters.items()})
            for e in diagnosis.effects))


def recalibration_notes(outcome: Outcome, unit: str) -> Iterator[str]:
    """List what was recalibrated significantly; accelerometers in ``unit``."""
    for name, (value, std) in outcome.recalibrations.items():
        if abs(value) > RECALIBRATION_SIGMA * std and not name.startswith('wrench.step'):
            by = estimated(value, std, _unit_of(name, unit), signed=True)
            yield f'recalibrated: {readable(name)} by {by}'


def _unit_of(name: str, accelerometer: str) -> str:
    stem, _, axis = name.rpartition('.')
    if stem == 'wrench.bias':
        return 'N' if int(axis) < 3 else 'N m'
    if stem == 'accelerometer.offset':
        return accelerometer
    return _UNITS.get(name) or _UNITS.get(stem, '1')
