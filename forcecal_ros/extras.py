"""What this package needs for some of its work only, and the command that installs it."""

from importlib.metadata import PackageNotFoundError, requires
import re
import shlex
import sys

PACKAGE = 'forcecal_ros'


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
    wanted = [line.partition(';')[0].strip() for line in lines
              if re.search(rf"""extra == ['"]{extra}['"]""", line)]
    exact = [line for line in wanted if re.split(r'[^\w-]', line)[0] == module]
    parts = exact or wanted or [f'{PACKAGE}[{extra}]']
    return shlex.join([sys.executable, '-m', 'pip', 'install', *parts])
