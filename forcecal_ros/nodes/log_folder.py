"""The folder of ROS 2's log files, without which it does not start."""

import os
from pathlib import Path
import sys
import tempfile

HOME, VARIABLE = 'ROS_HOME', 'ROS_LOG_DIR'


def choose_log_folder(name: str) -> None:
    """
    Set another folder where the usual one cannot be written to, and print a note.

    Parameters
    ----------
    name : str
        Of the program, for the note.
    """
    usual = Path(os.environ.get(VARIABLE) or Path(os.environ.get(HOME) or '~/.ros') / 'log')
    try:
        usual = usual.expanduser()
        usual.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=usual):
            return
    except (OSError, RuntimeError):  # the latter where the home is unknown
        os.environ[VARIABLE] = tempfile.mkdtemp(prefix='ros_log_')
        print(f'{name}: note: {usual} cannot be written to; logs go to {os.environ[VARIABLE]}',
              file=sys.stderr)
