"""The package from Python: ``import forcecal_ros as fc``, then ``fc.read``, ``fc.calibrate``."""

from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from forcecal_ros.core.streams import Recording
    from matplotlib.figure import Figure
    import pandas as pd


class Result(NamedTuple):
    """
    A result that prints as a table, in a terminal and in a notebook.

    Attributes
    ----------
    value : object
        The Calibration, ContactEstimate, Outcome of a diagnosis, or document behind it.
    headline : str
    columns, rows : tuple
        The table; numbers in SI units unless a row names another one.
    document : mapping
        As the command of the same name prints it with ``--json``.
    figure : callable
        Draws it.
    """

    value: Any
    headline: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    document: Mapping[str, Any]
    figure: 'Callable[[], Figure]'

    def __repr__(self) -> str:
        from forcecal_ros.report.rows import aligned

        lines = aligned([self.columns, *map(_cells, self.rows)]) if self.rows else []
        return '\n'.join([self.headline, *lines])

    def _repr_html_(self) -> str:
        def line(cells: Any, tag: str) -> str:
            return '<tr>' + ''.join(f'<{tag}>{escape(one)}</{tag}>' for one in cells) + '</tr>'

        return (f'<p>{escape(self.headline)}</p><table>{line(self.columns, "th")}'
                + ''.join(line(_cells(row), 'td') for row in self.rows) + '</table>')

    def plot(self) -> 'Figure':
        """Return a figure of the result."""
        return self.figure()

    def to_dict(self) -> dict[str, Any]:
        """Return the document that the command prints with ``--json``."""
        return dict(self.document)

    def to_dataframe(self) -> 'pd.DataFrame':
        """Return the table as a pandas DataFrame; an estimate, sample by sample."""
        import pandas as pd

        if hasattr(self.value, 'contact'):
            frame = pd.DataFrame(self.value.contact, self.value.t, ['fx', 'fy', 'fz',
                                                                    'tx', 'ty', 'tz'])
            return frame.rename_axis('t')
        return pd.DataFrame(self.rows, columns=list(self.columns))


def _cells(row: tuple[Any, ...]) -> list[str]:
    return [f'{one:.6g}' if isinstance(one, float) else str(one) for one in row]


def read(bag: str | Path, *, topics: Mapping[str, str] | None = None, preset: str = '',
         wrench_sign: int = 1) -> 'Recording':
    """
    Read and check a recording.

    Parameters
    ----------
    bag : str or Path
        rosbag2 folder or file.
    topics : mapping of str to str, optional
        Role (``wrench``, ``pose``, ``target``, ...) to topic, if it is not the usual one.
    preset : str
        Names of topics of a driver: ``ur``, ``franka``, ``kuka_fri`` or ``broadcaster``.
    wrench_sign : int
        -1 for a driver that reports the wrench of the tool on its environment.

    Raises
    ------
    DataError
        It cannot be read, or a stream cannot be used; names the remedy.
    """
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.cli.common import preset_topics
    from forcecal_ros.io.bags import read_recording

    names = {**preset_topics(preset, str(bag)), **(topics or {})}
    return checked(read_recording(bag, topics=names, wrench_sign=wrench_sign,
                                  joints=True)).recording


def check(recording: 'Recording') -> Result:
    """Return what a recording holds and which functions it can be used for; never raises."""
    from forcecal_ros.cli.check import inspect

    document = inspect(recording)
    rows = tuple((use, 'no' if why else 'yes', why) for use, why in document['uses'].items())
    return Result(document, document['fault'] or 'no fault was found', ('use', 'possible', 'why'),
                  rows, document, lambda: _lines_over_time(recording.wrench, 'wrench'))


def calibrate(recording: 'Recording', **settings: Any) -> Result:
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

    return _of_calibration(with_kalman_gains(identify(
        recording, IdentificationSettings(**settings))), recording)


def estimate(recording: 'Recording', calibration: Any, *, filter: str | None = None,  # noqa: A002
             **settings: Any) -> Result:
    """
    Estimate the contact wrench at every sample: environment on tool, in ft_sensor [N, N m].

    Parameters
    ----------
    calibration : Result, Calibration or path
    filter : str, optional
        ``kalman``, ``newton``, ``ukf``, ``ekf`` or ``static``; by default as the calibration has
        it.
    settings : dict
        Further fields of :class:`forcecal_ros.observe.ObserverSettings`.
    """
    from forcecal_ros.cli.estimate import prepared, refuse_disagreeing, statistics, status_notes
    from forcecal_ros.core.streams import Stream
    from forcecal_ros.observe import ObserverSettings, replay
    from forcecal_ros.observe.frames import taken_as_calibrated
    from forcecal_ros.report.rows import WRENCH_AXES

    chosen = ObserverSettings(filter=filter, **settings)
    known = _calibration_of(calibration)
    recording = taken_as_calibrated(recording, known, 'the calibration')
    notes = refuse_disagreeing(recording, known)
    known, assumed = prepared(known, recording, chosen)
    found = replay(recording, known, chosen)
    figures = statistics(found)
    rows = tuple((name, mean, std, 'N' if i < 3 else 'N m') for i, (name, mean, std) in enumerate(
        zip(WRENCH_AXES, figures['mean'], figures['std'])))
    return Result(
        found, f'{figures["valid"]} of {figures["samples"]} contact wrenches are valid',
        ('contact', 'mean', 'std', 'unit'), rows,
        {**figures, 'notes': [*notes, *assumed, *status_notes(found)]},
        lambda: _lines_over_time(Stream(found.t, found.contact), 'contact'))


def diagnose(recording: 'Recording', against: Any = None, *,
             heldout: 'Recording | None' = None) -> Result:
    """
    Find where and why a recording departs from a model.

    Parameters
    ----------
    against : optional
        What it is compared with: a Recording by a simulator of the same commands; a calibration
        (Result, Calibration or path), along the measured motion; an MJCF file (``.xml``) or a
        simulator, run with the recorded commands; a rig or its file. None: the nominal rig of
        this package.
    heldout : Recording, optional
        To judge on; by default parts of every phase of the first.
    """
    from forcecal_ros.core.errors import DataError
    from forcecal_ros.diagnose.dataset import units
    from forcecal_ros.report.diagnosis import closest, headline, signals, view_of
    from forcecal_ros.report.figures import drawn

    if isinstance(against, str | Path):
        against = _model(against)
    against = against.value if isinstance(against, Result) else against
    source, recordings = _source(against, [one for one in (recording, heldout) if one is not None])
    found = source.diagnose(*recordings)
    outcome, d = found.outcome, found.outcome.diagnosis

    def figure() -> 'Figure':
        if not outcome.datasets:
            raise DataError(f'nothing was compared: {d.reason}')
        view = view_of(outcome, '', units(found.unit))
        return drawn(closest(view) or signals(view))

    return Result(outcome, f'{d.verdict}: {headline(d)}',
                  ('effect', 'parameter', 'value', 'std', 'unit', 'probability'),
                  tuple((effect.name, name, p.value, p.std, p.unit, effect.probability)
                        for effect in d.effects for name, p in effect.parameters.items()),
                  found.document(), figure)


def _source(against: Any, recordings: 'list[Recording]') -> tuple[Any, 'list[Recording]']:
    """Return what compares recordings with a model, and them as it takes them."""
    from forcecal_ros.cli.diagnose import as_calibrated, RIGID
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording
    from forcecal_ros.diagnose.sources.pair import PairSource
    from forcecal_ros.diagnose.sources.rig import rig_source
    from forcecal_ros.diagnose.sources.simulator import SimulatorSource
    from forcecal_ros.diagnose.sources.tool import ToolSource
    from forcecal_ros.effects.rig import Rig
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration, rigid_tool_of_rig

    if isinstance(against, Recording):
        return PairSource(load_rig(RIGID), against), recordings
    if isinstance(against, Calibration):
        taken = [as_calibrated(one, against, 'the calibration', None) for one in recordings]
        return ToolSource(rigid_tool_of_calibration(against, load_rig(RIGID)), against), taken
    if against is None or isinstance(against, Rig):
        rig = against or load_rig()
        return (rig_source(rig) if recordings[0].target else
                ToolSource(rigid_tool_of_rig(rig))), recordings
    return SimulatorSource(against, load_rig(RIGID)), recordings


def simulate(recording: 'Recording', rig: Any = None, *, seed: int = 0) -> 'Recording':
    """Return what a rig (of :func:`load`, or nominal) measures under the recorded commands."""
    from forcecal_ros.core.topics import require
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate as run

    require(recording, ['target'])
    assert recording.target is not None
    return run(load_rig(rig) if rig is None or isinstance(rig, str | Path) else rig,
               recording.target, seed=seed)


def load(path: str | Path) -> Any:
    """Read a calibration (.yaml), a rig (.yaml) or the document of a diagnosis (.json)."""
    import json

    if str(path).endswith('.json'):
        return json.loads(Path(path).read_text())
    found = _model(path)
    return _of_calibration(found) if hasattr(found, 'wrench_bias') else found


def save(result: Result, path: str | Path) -> None:
    """Write a calibration as ``calibration.yaml``, any other result as JSON; keeps NAME~."""
    import json

    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.files import write_text
    from forcecal_ros.io.calibration_file import save as save_calibration

    if isinstance(result.value, Calibration):
        save_calibration(result.value, path)
    else:
        write_text(path, json.dumps(result.document, indent=2, allow_nan=False) + '\n')


def _model(path: str | Path) -> Any:
    """Return what a file describes: a Calibration, a rig, or a model in MuJoCo."""
    from forcecal_ros.io.calibration_file import load as load_calibration
    from forcecal_ros.sim.rig.file import load_rig

    if str(path).endswith('.xml'):
        from forcecal_ros.sim.mujoco import load_mujoco
        from forcecal_ros.sim.third_party import third_party

        return third_party(str(path), load_mujoco(str(path)))
    own = str(path) in ('rig.yaml', 'rigid_tool.yaml')  # of this package
    rig = own or (Path(path).is_file() and 'wrench_sensor:' in Path(path).read_text())
    return load_rig(path) if rig else load_calibration(path)


def _calibration_of(calibration: Any) -> Any:
    found = _model(calibration) if isinstance(calibration, str | Path) else calibration
    return found.value if isinstance(found, Result) else found


def _of_calibration(calibration: Any, recording: 'Recording | None' = None) -> Result:
    from forcecal_ros.core.errors import DataError
    from forcecal_ros.core.quantity import quantity
    from forcecal_ros.io.calibration_file import to_document
    from forcecal_ros.report.rows import table

    def figure() -> 'Figure':
        from forcecal_ros.report.figures import pose_means

        drawn = None if recording is None else pose_means(recording, calibration)
        if drawn is None:
            raise DataError('a calibration is drawn with the recording it was made from, and '
                            'phases `measure` in it')
        return drawn

    mass = quantity(float(calibration.mass), float(calibration.mass.std), 'kg')
    return Result(calibration, f'calibration: the tool weighs {mass}',
                  ('estimate', 'value', 'std', 'unit'),
                  tuple((row.name, row.value, row.std, row.unit) for row in table(calibration)),
                  to_document(calibration), figure)


def _lines_over_time(stream: Any, name: str) -> 'Figure':
    from forcecal_ros.report.figures import axes_grid

    figure, axes = axes_grid(2, 1, height=5.0, sharex=True)
    for i, (one, unit) in enumerate(zip(axes, ('force [N]', 'torque [N m]'))):
        one.plot(stream.t, stream.values[:, 3 * i:3 * i + 3],  # noqa: PD011 - an array
                 linewidth=0.8, label=list('xyz'))
        one.set(ylabel=f'{name} {unit}')
    axes[0].legend(ncols=3, frameon=False)
    axes[1].set(xlabel='time [s]')
    return figure
