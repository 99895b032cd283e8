"""The package from Python: ``import forcecal_ros as fc``, then ``fc.read``, ``fc.calibrate``."""

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.files import write_text
from forcecal_ros.core.streams import Recording
from forcecal_ros.core.topics import require
from forcecal_ros.report.answer import of_calibration, of_check, of_diagnosis, of_estimate, Result


def read(bag: str | Path, *, topics: Mapping[str, str] | None = None, preset: str = '',
         wrench_sign: int | None = None) -> Recording:
    """
    Read and check a recording.

    Parameters
    ----------
    bag : str or Path
        rosbag2 folder or file.
    topics, preset : mapping of str to str, str
        Role (``wrench``, ``pose``, ``target``, ...) to topic, if it is not the usual one or that
        of a driver: ``ur``, ``franka``, ``kuka_fri`` or ``broadcaster``.
    wrench_sign : int, optional
        -1 for a driver that reports the wrench of the tool on its environment; by default the
        calibration's that the recording is used with, or 1.

    Raises
    ------
    DataError
        It cannot be read, or a stream cannot be used; names the remedy.
    """
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.cli.common import preset_topics
    from forcecal_ros.io.bags import read_recording

    names = {**preset_topics(preset, str(bag)), **(topics or {})}
    return checked(read_recording(bag, names, wrench_sign, joints=True)).recording


def check(recording: Recording) -> Result:
    """Return what a recording holds and which functions it can be used for; never raises."""
    from forcecal_ros.cli.check import inspect

    return of_check(inspect(recording), recording)


def calibrate(recording: Recording, **settings: Any) -> Result:
    """
    Estimate tool, sensors, noise and observer from a recording of static poses and motion.

    Parameters
    ----------
    settings : dict
        Fields of :class:`forcecal_ros.calibrate.settings.IdentificationSettings`, as ``gravity``
        [m/s^2], ``sensor_rotation`` [rad] or ``coupling``.

    Raises
    ------
    DataError, UnobservableError
        The recording does not determine the tool; names the cause and the remedy.
    """
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.observe.design import with_kalman_gains

    return of_calibration(with_kalman_gains(identify(
        recording, IdentificationSettings(**settings))), recording)


def estimate(recording: Recording, calibration: Any, *, filter: str | None = None,  # noqa: A002
             **settings: Any) -> Result:
    """
    Estimate the contact wrench at every sample: environment on tool, in ft_sensor [N, N m].

    Parameters
    ----------
    calibration : Result, Calibration or path
    filter : str, optional
        ``kalman``, ``newton``, ``ukf``, ``ekf`` or ``static``; by default the calibration's.
    settings : dict
        Further fields of :class:`forcecal_ros.observe.ObserverSettings`.
    """
    from forcecal_ros.cli.estimate import as_taken, statistics, status_notes
    from forcecal_ros.observe import ObserverSettings, replay

    chosen = ObserverSettings(filter=filter, **settings)
    recording, known, notes = as_taken(recording, _known(calibration), chosen, 'the calibration')
    found = replay(recording, known, chosen)
    return of_estimate(found, {**statistics(found), 'notes': [*notes, *status_notes(found)]})


def diagnose(recording: Recording, against: Any = None, *, heldout: Recording | None = None
             ) -> Result:
    """
    Find where and why a recording departs from a model.

    Parameters
    ----------
    against : optional
        A Recording by a simulator of the same commands; a calibration (Result, Calibration or
        path), along the measured motion; an MJCF file (``.xml``) or a simulator, run with the
        recorded commands; a rig or its file. None: the nominal rig of this package, for a
        recording that the simulated rig made.
    heldout : Recording, optional
        To judge on; by default parts of every phase of the first.

    Raises
    ------
    UsageError
        Neither ``against`` nor the recording states what it is compared with.
    """
    from forcecal_ros.diagnose.sources.choice import source_of

    model = _known(against)
    source, taken = source_of([model] if isinstance(model, Recording) else model,
                              [one for one in (recording, heldout) if one is not None])
    return of_diagnosis(source.diagnose(*taken))


def simulate(recording: Recording, rig: Any = None, *, seed: int = 0) -> Recording:
    """Return what a rig (of :func:`load`, or nominal) measures under the recorded commands."""
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate as run

    require(recording, ['target'])
    rig = load_rig(rig) if rig is None or isinstance(rig, str | Path) else rig
    return run(rig, recording.target, seed=seed)  # type: ignore[arg-type]


def load(path: str | Path) -> Any:
    """Read a calibration (.yaml), a rig (.yaml) or the document of a diagnosis (.json)."""
    found = json.loads(Path(path).read_text()) if Path(path).suffix == '.json' else _known(path)
    return of_calibration(found) if isinstance(found, Calibration) else found


def save(result: Result, path: str | Path) -> None:
    """Write a calibration as ``calibration.yaml``, any other result as JSON; keeps NAME~."""
    from forcecal_ros.io.calibration_file import save as save_calibration

    if isinstance(result.value, Calibration):
        save_calibration(result.value, path)
    else:
        write_text(path, json.dumps(result.document, indent=2, allow_nan=False) + '\n')


def _known(model: Any) -> Any:
    """Return what a file describes, or what is behind a result."""
    from forcecal_ros.diagnose.sources.choice import model_of

    found = model_of(model) if isinstance(model, str | Path) else model
    return found.value if isinstance(found, Result) else found
