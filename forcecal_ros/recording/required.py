"""Streams that a command cannot do without, and what the recording has in their place."""

from collections.abc import Collection

from forcecal_ros.errors import DataError
from forcecal_ros.recording.streams import Recording
from forcecal_ros.recording.topics import ROLES

_ATTRIBUTES = {'phase': 'phases', 'imu': 'angular_velocity', 'accel': 'accelerometer'}
_LISTED = 6
"""Topics to choose from that still fit in one line of a terminal or two."""


def require(recording: Recording, roles: Collection[str]) -> None:
    """
    Refuse a recording that lacks something.

    Parameters
    ----------
    recording : Recording
    roles : collection of str
        ``wrench``, ``accelerometer``, ``pose``, ``target``, ``optidrive``, ``phase``, ...

    Raises
    ------
    DataError
        Names the topics that are missing, what reading had to say about them, and the topics
        that could be meant.
    """
    missing = [role for role in roles if not _there(recording, role)]
    if not missing:
        return
    said = [note for note in recording.notes
            if any(ROLES[role].topic in note for role in missing)]
    raise DataError(
        f'{recording.source or "the recording"}: no messages of '
        f'{", ".join(f"{ROLES[role].topic} ({role})" for role in missing)}; record '
        f'{"them" if len(missing) > 1 else "it"}, or name the topic with '
        + ' and '.join(_option(recording, role) for role in missing)
        + ''.join(f'; {note}' for note in said))


def _there(recording: Recording, role: str) -> bool:
    stream = getattr(recording, _ATTRIBUTES.get(role, role))
    return stream is not None and len(stream) > 0


def naming(recording: Recording, role: str) -> str:
    """
    Say how to name the topic of a role, and which of the recording it may be.

    Parameters
    ----------
    role : str
        Without a topic; the sentence goes on from "or".
    """
    return f'name its topic with {_option(recording, role)}'


def _option(recording: Recording, role: str) -> str:
    others = recording.candidates.get(role, ())
    if len(others) < 2:
        return f'--topic {role}={others[0] if others else "NAME"}'
    more = f' and {len(others) - _LISTED} more' if len(others) > _LISTED else ''
    return f'--topic {role}=NAME, one of {", ".join(others[:_LISTED])}{more}'
