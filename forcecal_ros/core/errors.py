"""The exception tree: any error that the user can fix is a :class:`ForcecalError`.

The command line and the nodes turn each of these into one line on stderr or in the log; anything
else that escapes is a defect of this package.
"""


class ForcecalError(Exception):
    """Base of all errors a user can act on; the message names cause, numbers and remedy."""


class DataError(ForcecalError):
    """A recording, a table or a message stream cannot answer the question."""


class ConfigError(ForcecalError):
    """A configuration value, file or argument is missing, malformed or contradictory."""


class UsageError(ConfigError):
    """The arguments of a command cannot be right for any data: exit status 2."""


class UnobservableError(ForcecalError):
    """The data or the sensors at hand do not determine a quantity that was requested."""


class MotionError(ForcecalError):
    """A motion was refused before it began, or stopped on its way."""


def above(value: float, limit: float, digits: int = 3) -> str:
    """
    Print a value that is above a limit so that it reads above it.

    Digits are added until the rounded value is on its side of the limit.
    """
    texts = (f'{value:.{more}g}' for more in range(digits, 18))
    return next(text for text in texts if not value > limit or float(text) > limit)


def below(value: float, limit: float, digits: int = 3) -> str:
    """Print a value that is below a limit so that it reads below it; see :func:`above`."""
    texts = (f'{value:.{more}g}' for more in range(digits, 18))
    return next(text for text in texts if not value < limit or float(text) < limit)
