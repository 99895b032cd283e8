"""Results as tables, in a terminal and in a notebook, with their figure and their document."""

from collections.abc import Callable, Mapping
from html import escape
from typing import Any, NamedTuple, TYPE_CHECKING

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.quantity import quantity
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.io.calibration_file import to_document
from forcecal_ros.observe import ContactEstimate
from forcecal_ros.report.rows import aligned, table, WRENCH_AXES

if TYPE_CHECKING:
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


def of_calibration(calibration: Calibration, recording: Recording | None = None) -> Result:
    """Return the estimates of a calibration, drawn over the recording that it was made from."""
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


def of_check(document: Mapping[str, Any], recording: Recording) -> Result:
    """Return what a recording can be used for, by the document of ``forcecal check``."""
    rows = tuple((use, 'no' if why else 'yes', why) for use, why in document['uses'].items())
    return Result(document, document['fault'] or 'no fault was found', ('use', 'possible', 'why'),
                  rows, document, lambda: _over_time(recording.wrench, 'wrench'))


def of_estimate(found: ContactEstimate, document: Mapping[str, Any]) -> Result:
    """Return the contact wrench, by the document of ``forcecal estimate``."""
    return Result(
        found, f'{document["valid"]} of {document["samples"]} contact wrenches are valid',
        ('contact', 'mean', 'std', 'unit'),
        tuple(zip(WRENCH_AXES, document['mean'], document['std'], ['N'] * 3 + ['N m'] * 3)),
        document, lambda: _over_time(Stream(found.t, found.contact), 'contact'))


def of_diagnosis(found: Any) -> Result:
    """Return the effects that a diagnosis (of ``diagnose.sources``) has named."""
    from forcecal_ros.diagnose.dataset import units
    from forcecal_ros.report.diagnosis import closest, headline, signals, view_of
    from forcecal_ros.report.figures import drawn

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


def _over_time(stream: Stream | None, name: str) -> 'Figure':
    """Draw force and torque of a stream of shape (n, 6)."""
    from forcecal_ros.report.figures import axes_grid

    if stream is None:
        raise DataError(f'no {name} was recorded that could be drawn; record wrench')
    values = stream.values  # noqa: PD011 - an array
    figure, axes = axes_grid(2, 1, height=5.0, sharex=True)
    for i, (one, unit) in enumerate(zip(axes, ('force [N]', 'torque [N m]'))):
        one.plot(stream.t, values[:, 3 * i:3 * i + 3], linewidth=0.8, label=list('xyz'))
        one.set(ylabel=f'{name} {unit}')
    axes[0].legend(ncols=3, frameon=False)
    axes[1].set(xlabel='time [s]')
    return figure
