"""The one way this package compiles numerical loops."""

from collections.abc import Callable
from typing import Any, cast, TypeVar

from numba import njit

F = TypeVar('F', bound=Callable[..., Any])

Record = Any
"""One element of a structured array, whose fields compiled code reads as attributes."""


def compiled(function: F) -> F:
    """
    Compile with numba at the first call and keep the machine code on disk for the next process.

    numba keeps it beside the source, or in the user's cache directory where that cannot be
    written, and recompiles when the date of the function's own file changes: it looks neither at
    the functions nor at the constants of other files. So a compiled function uses those of its
    own file only, and takes everything else as argument.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable
    """
    try:
        return cast(F, njit(cache=True, nogil=True)(function))
    except RuntimeError:  # nowhere to keep it: compile anew in each process
        return cast(F, njit(nogil=True)(function))
