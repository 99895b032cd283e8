"""The one way this package compiles numerical loops."""

from collections.abc import Callable
from hashlib import sha256
from inspect import isfunction
from pathlib import Path
from types import FunctionType
from typing import Any, cast, TypeVar

from numba import njit
from numba.extending import register_jitable

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
    except RuntimeError:  # no folder to keep it: compile anew in each process
        return cast(F, njit(nogil=True)(function))


def waits_for_compiler(*functions: Callable[..., Any]) -> bool:
    """
    Whether the first call of any compiles it, since no earlier process left its machine code.

    Parameters
    ----------
    functions : callable
        Results of :func:`compiled` or :func:`compiled_with_all_it_calls`.

    Returns
    -------
    bool
        False as well if numba does not show it.
    """
    files = (getattr(getattr(one, '_cache', None), '_cache_file', None) for one in functions)
    # numba has no public way to ask whether machine code is there
    return not all(file._load_index() for file in files  # noqa: SLF001
                   if file is not None)


def compiled_with_all_it_calls(function: F) -> F:
    """
    Compile a function together with the plain functions of this project that it calls.

    They stay what they are for the interpreter, so that the same source runs sample by sample
    and over whole recordings. The machine code on disk is good for the text of the files that
    hold them and of all files in the folder, and made anew when any of them changes.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable
    """
    called = _called_by(cast(FunctionType, function))
    for one in called:
        register_jitable(one)
    folder = Path(function.__code__.co_filename).parent
    files = {*folder.rglob('*.py'), *(Path(one.__code__.co_filename) for one in called)}
    text = b''.join(path.read_bytes() for path in sorted(files))
    function.__qualname__ += f'-{sha256(text).hexdigest()[:12]}'
    return compiled(function)


def _called_by(function: FunctionType) -> list[FunctionType]:
    """Return the plain functions of the same project it calls, and all that those call."""
    package = function.__module__.partition('.')[0] + '.'
    found: list[FunctionType] = []
    waiting = [function]
    while waiting:
        one = waiting.pop()
        for name in one.__code__.co_names:
            called = one.__globals__.get(name)
            if (isfunction(called) and called.__module__.startswith(package)
                    and called not in found):
                found.append(called)
                waiting.append(called)
    return found
