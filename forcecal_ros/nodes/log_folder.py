"""Where ROS 2 writes its log files: it does not start where it cannot."""

import os
from pathlib import Path
import sys
import tempfile

HOME, VARIABLE = 'ROS_HOME', 'ROS_LOG_DIR'


def choose_log_folder(name: str) -> None:
    """
    Name another folder to ROS 2 where its usual one cannot be written to, and say so.

    Parameters
    ----------
    name : str
        Of who says it, before it has a logger.
    """
    usual = Path(os.environ.get(VARIABLE) or Path(os.environ.get(HOME) or '~/.ros') / 'log')
    try:
        usual = usual.expanduser()
        usual.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=usual):
            return
    except (OSError, RuntimeError):  # the latter where nobody knows the home
        os.environ[VARIABLE] = tempfile.mkdtemp(prefix='ros_log_')
        print(f'{name}: note: {usual} cannot be written to; logs go to {os.environ[VARIABLE]}',
              file=sys.stderr)
