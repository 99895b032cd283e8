"""What identification cannot do without."""

from forcecal_ros.errors import DataError
from forcecal_ros.recording.streams import Recording, Stream


def require_wrench(recording: Recording) -> Stream:
    """
    Return the wrench.

    Raises
    ------
    DataError
        There is none.
    """
    if recording.wrench is None or not len(recording.wrench):
        raise DataError(f'{recording.source or "the recording"} has no wrench; record it, or name '
                        'its topic with --topic wrench=NAME')
    return recording.wrench
