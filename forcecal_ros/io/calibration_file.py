"""The file ``calibration.yaml``: written whole, checked when it is read."""

from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

from forcecal_ros.core.calibration import Calibration, FORMAT
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.files import write_text
from forcecal_ros.core.safe_yaml import LARGEST, load_yaml
from forcecal_ros.core.schema import Mismatch, plain, read
from forcecal_ros.io.exports import recognise
import numpy as np
import yaml

DAY = 86_400.0
"""[s]"""

NAME_ONE = 'pass a file written by `forcecal calibrate`'

_CHECKSUM, _ALGORITHM = 'checksum: ', 'sha256-'


def dump(calibration: Calibration) -> str:
    """Return the text of ``calibration.yaml`` for a calibration."""
    text = yaml.safe_dump(to_document(calibration), sort_keys=False, width=99,
                          default_flow_style=None, allow_unicode=True)
    return f'{text}{_CHECKSUM}{_digest(text)}\n'


def _digest(text: str) -> str:
    return f'{_ALGORITHM}{sha256(text.encode()).hexdigest()}'


def _check_sum(text: str, name: str) -> None:
    """Refuse a text that is not what was written; one without checksum passes."""
    head, newline, last = text.rstrip().rpartition('\n')
    meant = _CHECKSUM in last or _ALGORITHM in last  # one of them may be what is damaged
    if meant and last != _CHECKSUM + _digest(head + newline):
        raise ConfigError(f'{name}: the checksum does not match: the file is damaged or was '
                          'edited; calibrate again (if the edit was intended, delete `checksum`)')


def save(calibration: Calibration, path: Path | str) -> None:
    """
    Write ``calibration.yaml`` atomically; what was there is kept as ``calibration.yaml~``.

    Raises
    ------
    ConfigError
        The place cannot or must not be written to.
    """
    write_text(path, dump(calibration))


def load(path: Path | str) -> Calibration:
    """
    Read a calibration file, or one of force_torque_tools (KTH) or ft_tools_ros2.

    Raises
    ------
    ConfigError
        It is not there, too large, not YAML, of another format, or a key is missing, has the
        wrong shape or unit, or is not finite, or the checksum does not fit; the message names
        file and key.
    """
    path = Path(path)
    try:
        with path.open('rb') as file:
            text = file.read(LARGEST + 1).decode()
    except OSError as error:
        raise ConfigError(f'{path}: cannot be read ({error.strerror}); {NAME_ONE}') from error
    except UnicodeDecodeError as error:
        raise ConfigError(f'{path}: not a text file; {NAME_ONE}') from error
    return parse(text, str(path))


def refuse_old(calibration: Calibration, longest: float, now: float, name: str) -> None:
    """
    Refuse a calibration whose recording is too old.

    Parameters
    ----------
    longest, now : float
        Allowed age, and the time it is counted to [s since the epoch].
    name : str
        File, for the message.

    Raises
    ------
    ConfigError
        It is older, or does not say how old it is.
    """
    recorded = calibration.source.get('recorded')
    try:
        age = now - datetime.fromisoformat(str(recorded)).timestamp()
    except ValueError:
        raise ConfigError(f'{name}: has no recording date, but calibration.max_age is '
                          f'{longest / DAY:g} d; calibrate again') from None
    if age > longest:
        raise ConfigError(f'{name}: was recorded {age / DAY:.1f} d ago, calibration.max_age is '
                          f'{longest / DAY:g} d; calibrate again')


def parse(text: str, name: str = 'calibration') -> Calibration:
    """
    Read a calibration from its text, as it arrives on ``sequencer/calibration``.

    Parameters
    ----------
    name : str
        File or topic, for messages.

    Raises
    ------
    ConfigError
        As :func:`load`.
    """
    document = load_yaml(text, name)
    _check_sum(text, name)
    if not isinstance(document, dict):
        raise ConfigError(f'{name}: is not a calibration (expected keys such as mass, com and '
                          f'wrench_bias); {NAME_ONE}')
    if 'format' not in document and (third_party := recognise(document, name)) is not None:
        return third_party
    if document.get('format') != FORMAT:
        stated = str(document.get('format', 'not stated'))[:80]
        kind, _, version = FORMAT.partition('/')
        older = stated.startswith(f'{kind}/')
        raise ConfigError(
            f'{name}: is a calibration of format {stated}, this version reads {version}; '
            'calibrate again' if older else
            f'{name}: is not a calibration (format {stated}, expected {FORMAT}); {NAME_ONE}')
    return from_document(document, name)


def to_document(calibration: Calibration) -> dict[str, Any]:
    """Return what ``calibration.yaml`` holds and ``--json`` prints, in the order of the file."""
    return {'format': FORMAT, **plain(calibration)}


def from_document(document: dict[str, Any], name: str) -> Calibration:
    """
    Turn what :func:`to_document` returns into a calibration again.

    ``name`` is where it is from, for messages.

    Raises
    ------
    ConfigError
        A key is missing, has the wrong shape or unit, or is not finite.
    """
    try:
        calibration = read(Calibration, document, extra=True)
        _check(calibration)
    except ConfigError as error:
        raise ConfigError(f'{name}: {error}; correct the file') from None
    return calibration


def _check(c: Calibration) -> None:
    """Refuse parts that are right by themselves but do not go together."""
    if c.accelerometer:
        if np.linalg.matrix_rank(c.accelerometer.matrix) < 3:
            raise ConfigError('accelerometer.gain times accelerometer.map is singular, expected '
                              'three independent axes of non-zero gain')
        if c.accelerometer.coupling == 'ac' and c.accelerometer.cutoff is None:
            raise Mismatch('accelerometer.cutoff', None, 'the corner [Hz] of an ac sensor')
    if c.gravity_direction is not None and abs(np.linalg.norm(c.gravity_direction) - 1.0) > 1e-3:
        raise Mismatch('gravity_direction', list(c.gravity_direction), 'a unit vector')
    mounting = c.sensor_from_pose
    if mounting is not None and abs(np.linalg.norm(mounting[3:]) - 1.0) > 1e-3:
        raise Mismatch('sensor.from_pose', list(mounting), 'x y z and a unit quaternion')
    if c.matrix is not None:
        channels = c.matrix.value.shape[1]
        if c.matrix_offset is None or len(c.matrix_offset.value) != channels:
            found = None if c.matrix_offset is None else c.matrix_offset.value.tolist()
            raise Mismatch('matrix.offset', found, f'{channels} numbers, one for each column')
