"""Results as tables, in a terminal and in a notebook, with their figure and their document."""

from collections.abc import Callable, Mapping
from html import escape
from itertools import groupby
import json
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING, TypeVar

from forcecal_ros.core.axes import in_axes_of_pose, levelled
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError, error_ids
from forcecal_ros.core.files import write_text
from forcecal_ros.core.quantity import HALF, pair, quantity
from forcecal_ros.core.streams import CHANNELS, Recording, Stream
from forcecal_ros.io.calibration_file import to_document
from forcecal_ros.report.rows import aligned, handy, printed, table, WRENCH_AXES

if TYPE_CHECKING:
    from forcecal_ros.diagnose.result import Diagnosis
    from matplotlib.figure import Figure
    import pandas as pd


Kind = TypeVar('Kind')

Recorded = Recording | str | Path
"""A recording as :func:`forcecal_ros.read` returns it, or the path of one."""


class Result(NamedTuple):
    """
    A result that prints as a table, in a terminal and in a notebook.

    Attributes
    ----------
    value : object
        The Calibration, ContactEstimate, Diagnosis, or document behind it.
    headline : str
        Value ± 95 % interval, where it states a number.
    columns, rows : tuple
        The table; numbers in SI units unless a row names another one. It prints as the commands
        print it: in units of a handy size, ± half the 95 % interval.
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
        lines = aligned(printed(self.columns, self.rows)) if self.rows else []
        return '\n'.join([self.headline, *lines])

    def _repr_html_(self) -> str:
        def line(cells: Any, tag: str) -> str:
            return '<tr>' + ''.join(f'<{tag}>{escape(one)}</{tag}>' for one in cells) + '</tr>'

        head, *body = printed(self.columns, self.rows)
        return (f'<p>{escape(self.headline)}</p><table>{line(head, "th")}'
                + ''.join(line(row, 'td') for row in body) + '</table>')

    @error_ids()
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


@error_ids()
def load(path: str | Path) -> Any:
    """
    Read what a command, or :func:`save`, has written.

    Parameters
    ----------
    path : str or Path
        ``calibration.yaml``, ``diagnosis.json`` or its folder, a rig (.yaml), a model (.xml).

    Returns
    -------
    Result, Rig, simulator or Recording
        A Result of a calibration or a diagnosis.

    Raises
    ------
    ConfigError, DataError
        It cannot be read, or is none of these.
    """
    if Path(path).suffix == '.json' or Path(path).is_dir():
        from forcecal_ros.diagnose.result import load_diagnosis

        return of_diagnosis(*load_diagnosis(path))
    found = value_of(path)
    return of_calibration(found) if isinstance(found, Calibration) else found


@error_ids()
def save(result: Result, path: str | Path) -> None:
    """
    Write a result; a file that is there is kept as NAME~.

    Parameters
    ----------
    result : Result
        Of any function of this package.
    path : str or Path
        A calibration is written as ``calibration.yaml``, any other result as JSON.

    Raises
    ------
    ConfigError
        The place cannot be written to.
    """
    from forcecal_ros.io.calibration_file import save as save_calibration

    if isinstance(result.value, Calibration):
        save_calibration(result.value, path)
    else:
        write_text(path, json.dumps(result.document, indent=2, allow_nan=False) + '\n')


def value_of(model: Any, bag: bool = False) -> Any:
    """Return what a path names, which may have to be a bag, or what is behind a result."""
    from forcecal_ros.diagnose.sources.choice import model_of

    if isinstance(model, str | Path):
        bag = bag or Path(model).is_dir() or not {'.mcap', '.db3'}.isdisjoint(Path(model).suffixes)
        return run_read(model, {}, '', None) if bag else model_of(model)
    return model.value if isinstance(model, Result) else model


def _of(kind: type[Kind], given: Any) -> Kind:
    """Return an object of a kind, read if its path is given."""
    found = value_of(given, kind is Recording)
    if not isinstance(found, kind):
        raise DataError(f'pass a {kind.__name__} or path, not {type(found)}', kind.__name__)
    return found


def of_calibration(calibration: Calibration, recording: Recording | None = None) -> Result:
    """Return the estimates of a calibration, drawn over the recording that it was made from."""
    def figure() -> 'Figure':
        from forcecal_ros.observe import replay
        from forcecal_ros.report.calibration import forces
        from forcecal_ros.report.figures import drawn, pose_means

        if recording is None:
            return _intervals(calibration)
        taken = in_axes_of_pose(levelled(recording, calibration.gravity_direction),
                                calibration.sensor_rotation)
        if (means := pose_means(taken, calibration)) is not None:
            return means
        found = replay(recording, calibration)
        shown = forces(taken, calibration, Stream(found.t, found.contact))
        return drawn(shown._replace(panels=(*shown.panels, *(
            one._replace(title=f'contact {one.title}', lines=one.lines[-1:])
            for one in shown.panels))))

    mass = quantity(float(calibration.mass), float(calibration.mass.std), 'kg')
    return Result(calibration, f'calibration: the tool weighs {mass} (± is the 95 % interval)',
                  ('estimate', 'value', 'standard error', 'unit'),
                  tuple((row.name, row.value, row.std, row.unit) for row in table(calibration)),
                  to_document(calibration), figure)


@error_ids()
def run_calibration(recording: Recorded, settings: Mapping[str, Any]) -> Result:
    """Calibrate; see :func:`forcecal_ros.api.calibrate`, as for the others below."""
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.observe.design import with_kalman_gains

    recording = _of(Recording, recording)
    return of_calibration(with_kalman_gains(identify(
        recording, IdentificationSettings(**settings))), recording)


@error_ids()
def run_read(bag: str | Path, topics: Mapping[str, str], preset: str, wrench_sign: int | None
             ) -> Recording:
    """Read."""
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.cli.common import preset_topics
    from forcecal_ros.io.bags import read_recording

    names = {**preset_topics(preset, str(bag)), **topics}
    return checked(read_recording(bag, names, wrench_sign, joints=True))


@error_ids()
def check(recording: Recorded) -> Result:
    """
    Return what a recording can be used for, and why not.

    Parameters
    ----------
    recording : Recording or path
        As :func:`forcecal_ros.read` returns it.

    Returns
    -------
    Result
        Streams, motion, wrench sign and fault are in ``to_dict()``.
    """
    from forcecal_ros.cli.check import inspect, YES

    document = inspect(recording := _of(Recording, recording))
    return Result(document, document['fault'] or 'no fault was found', ('use', 'possible', 'why'),
                  tuple((use, 'no' if why else YES.get(use, 'yes'), why)
                        for use, why in document['uses'].items()),
                  document, lambda: _signals(recording))


@error_ids()
def run_estimate(recording: Recorded, calibration: Any, settings: Mapping[str, Any]) -> Result:
    """Estimate."""
    from forcecal_ros.cli.estimate import as_taken, statistics, status_notes
    from forcecal_ros.observe import ObserverSettings, replay

    chosen = ObserverSettings(**settings)
    recording, model, notes = as_taken(
        _of(Recording, recording), _of(Calibration, calibration), chosen, 'the calibration')
    found = replay(recording, model, chosen)
    document = {**statistics(found), 'notes': [*notes, *status_notes(found)]}
    contact = Recording(wrench=Stream(found.t, found.contact), phases=recording.phases)
    return Result(
        found, f'{document["valid"]} of {document["samples"]} contact wrenches are valid',
        ('contact', 'mean', 'standard deviation', 'unit'),
        tuple(zip(WRENCH_AXES, document['mean'], document['std'], ['N'] * 3 + ['N m'] * 3)),
        document, lambda: _signals(contact, 'contact '))


@error_ids()
def run_diagnosis(recording: Recorded, against: Any, heldout: Recorded | None) -> Result:
    """Diagnose."""
    from forcecal_ros.diagnose.sources.choice import FROM_PYTHON, own_rig, source_of

    given = [_of(Recording, one) for one in (recording, heldout) if one is not None]
    model = own_rig(given, FROM_PYTHON) if against is None else value_of(against)
    source, taken = source_of([model] if isinstance(model, Recording) else model, given)
    found = source.diagnose(*taken)
    return of_diagnosis(found.diagnosis, found.document(), found, taken[0])


@error_ids()
def run_simulation(recording: Recorded, rig: Any, seed: int) -> Recording:
    """Simulate."""
    from forcecal_ros.core.topics import require
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate

    recording = _of(Recording, recording)
    require(recording, ['target'])
    rig = load_rig(rig) if rig is None or isinstance(rig, str | Path) else rig
    return simulate(rig, recording.target, seed=seed)  # type: ignore[arg-type]


def of_diagnosis(d: 'Diagnosis', document: Mapping[str, Any], found: Any = None,
                 recording: Recording | None = None) -> Result:
    """Return the effects that a diagnosis names; ``found`` of a source draws them."""
    from forcecal_ros.diagnose.dataset import units
    from forcecal_ros.report.diagnosis import closest, headline, signals, view_of
    from forcecal_ros.report.figures import drawn

    def figure() -> 'Figure':
        if found is not None and found.outcome.datasets:
            view = view_of(found.outcome, '', units(found.unit))
            return drawn(closest(view) or signals(view))
        if d.gap:
            return _arms(d.gap.channels)
        if recording is None:
            raise DataError(f'there is no comparison to draw: {d.reason}')
        return _signals(recording)

    return Result(d, f'{d.verdict}: {headline(d)}',
                  ('effect', 'parameter', 'value', 'standard error', 'unit', 'probability'),
                  tuple((effect.name, name, p.value, p.std, p.unit, effect.probability)
                        for effect in d.effects for name, p in effect.parameters.items()),
                  document, figure)


def _intervals(calibration: Calibration) -> 'Figure':
    """Draw estimates with their 95 % intervals, those of one kind and unit on one axis."""
    from matplotlib.figure import Figure

    groups = [[*rows] for _, rows in groupby(table(calibration), key=lambda row: (
        row.key.rpartition('.')[0] or row.key, row.unit))]
    sizes = [1 + len(rows) for rows in groups]
    figure = Figure(figsize=(8.0, 0.24 * sum(sizes)), layout='constrained')
    axes = figure.subplots(len(groups), 1, height_ratios=sizes, squeeze=False)
    for one, group in zip(axes.flat, groups):
        rows = [handy(row, max(abs(other.value) for other in group)) for row in group]
        one.errorbar([row.value for row in rows], [
            f'{row.name}  {pair(row.value, row.std)} {row.unit.removeprefix("1")}'
            for row in rows], xerr=[HALF * row.std for row in rows], fmt='o', capsize=3)
        one.set_ylim(len(rows) - 0.5, -0.5)
        one.locator_params(axis='x', nbins=4)
        one.ticklabel_format(axis='x', useOffset=False)
        one.spines[['top', 'right']].set_visible(False)
    return figure


def _arms(channels: Mapping[str, tuple[float, float, float, float]]) -> 'Figure':
    """Draw the residual of each channel over its noise: before, recalibrated, with effects."""
    from forcecal_ros.report.figures import axes_grid

    figure, (axes,) = axes_grid(1, 1, height=1.5 + 0.3 * len(channels))
    for i, arm in enumerate(('before', 'recalibrated', 'with the effects')):
        axes.plot([rms[i] / (rms[3] or 1.0) for rms in channels.values()], [*channels], 'os^'[i],
                  fillstyle='none', label=arm)
    axes.invert_yaxis()
    axes.set(xscale='log', xlabel='residual over noise (RMS)')
    axes.legend(frameon=False)
    return figure


def _signals(recording: Recording, name: str = '') -> 'Figure':
    """Draw the wrench over time, or what else was measured without a frame."""
    from forcecal_ros.diagnose.dataset import units
    from forcecal_ros.report.figures import drawn, Line, Panel, Shown

    for role in ('wrench', 'accelerometer', 'angular_velocity', 'optidrive'):
        if stream := getattr(recording, role):
            unit = units(recording.accelerometer_unit)
            columns = stream.values.T  # noqa: PD011 - an array
            return drawn(Shown(tuple(
                Panel(f'{name}{channel}', unit.get(channel, 'rad/s'),
                      (Line('', 'explained', stream.t, column),))
                for channel, column in zip(CHANNELS[role], columns)),
                recording.phases, float(stream.t[0]), float(stream.t[-1])))
    raise DataError('there is no signal to draw; record wrench')
