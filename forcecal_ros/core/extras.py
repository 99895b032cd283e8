"""What this package needs for some of its work, and how it is installed where it is missing."""

from importlib.metadata import PackageNotFoundError, requires
import os
import re
import shlex
import sys

PACKAGE = 'forcecal_ros'

BESIDE_APT = {'backports', 'lz4', 'numba', 'pandas', 'rosbags', 'tqdm'}
"""Modules that the nodes on a robot do without, and that package.xml therefore does not name."""


def program() -> str:
    """Return how the program was started, as by ./run: how a printed command begins."""
    return os.environ.get('FORCECAL_COMMAND', 'forcecal')


def installing(extra: str, module: str = '') -> str:
    """
    Return the command that installs an extra, or of it only what brings a module.

    Parameters
    ----------
    extra : str
        As setup.py calls it.
    module : str
        Name in an import; the whole extra where no requirement is called so.
    """
    try:
        lines = requires(PACKAGE) or []
    except PackageNotFoundError:
        lines = []
    lines = [line.partition(';')[0].strip() for line in lines
              if re.search(rf"""extra == ['"]{extra}['"]""", line)]
    exact = [line for line in lines if re.split(r'[^\w-]', line)[0] == module]
    parts = exact or lines or [f'{PACKAGE}[{extra}]']
    return shlex.join([sys.executable, '-m', 'pip', 'install', *parts])


def missing(error: ModuleNotFoundError) -> str:
    """
    Say in one line how to install a module that is not there.

    Returns
    -------
    str
        Empty where it is none of :data:`BESIDE_APT`: a programming error, not a missing
        package.
    """
    module = (error.name or '').partition('.')[0]
    if module not in BESIDE_APT:
        return ''
    python = shlex.quote(sys.executable)
    if sys.prefix == sys.base_prefix:  # where Debian and Ubuntu let pip install nothing
        make = f'{python} -m venv --system-site-packages VENV'
        return (f'{module} is not installed; run {make}, then VENV/bin/pip install {module}, and '
                f'run this with VENV/bin/python -m {PACKAGE}.cli.main')
    return f'{module} is not installed; run {python} -m pip install {module}'
