"""The exception tree: whatever the user can mend is a :class:`ForcecalError`.

The command line and the nodes turn each of these into one line on stderr or in the log; anything
else that escapes is a defect of this package.
"""


class ForcecalError(Exception):
    """Base of all errors a user can act on; the message names cause, numbers and remedy."""


class DataError(ForcecalError):
    """A recording, a table or a message stream cannot answer the question asked of it."""


class ConfigError(ForcecalError):
    """A configuration value, file or argument is missing, malformed or contradictory."""


class UsageError(ConfigError):
    """The arguments of a command cannot be right, whatever the data: exit status 2."""


class UnobservableError(ForcecalError):
    """The data or the sensors at hand do not determine a quantity that was asked for."""


class MotionError(ForcecalError):
    """A motion was refused before it began, or stopped on its way."""


def below(value: float, limit: float, digits: int = 3) -> str:
    """
    Print a value that is below a limit so that it reads below it.

    Digits are added until the rounded value is on its side of the limit.
    """
    for more in range(digits, 17):
        if float(f'{value:.{more}g}') < limit:
            return f'{value:.{more}g}'
    return f'just under {limit:g}'
