"""The source of the package, parsed once for all tests of a worker that look at it."""

import ast
from functools import cache


@cache
def parsed(path):
    """Return a file's syntax."""
    return ast.parse(path.read_text())
