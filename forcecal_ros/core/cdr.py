"""Serialised messages (CDR) of one form, read by how the one before was laid out."""

from collections.abc import Callable
from operator import itemgetter
from struct import calcsize, Struct, unpack_from
from struct import error as StructError
from typing import Any, NamedTuple


class Layout(NamedTuple):
    """
    Where everything is in messages of one length with the same texts and counts.

    Attributes
    ----------
    unpack : callable
        From a message to its values in order; a text is its length and its bytes.
    same : callable
        From values to texts and counts, which are ``known``.
    texts : tuple of str
    counts : tuple of int
        Of each sequence.
    """

    unpack: Callable[[bytes], tuple[Any, ...]]
    same: Callable[[tuple[Any, ...]], Any]
    known: Any
    texts: tuple[str, ...]
    counts: tuple[int, ...]


class FormReader:
    """
    Reads serialised messages of one form.

    Parameters
    ----------
    form : tuple
        ``i``, ``I`` and ``d`` of :mod:`struct`, also several as ``7d``, ``s`` for a text, and a
        tuple for a sequence of such parts. What follows the form in a message is left out.
    """

    def __init__(self, form: tuple[Any, ...]) -> None:
        self._form = form
        self._layouts: dict[tuple[int, int], Layout] = {}

    def __call__(self, raw: bytes) -> tuple[Layout, tuple[Any, ...]]:
        """
        Read one message; its layout is the same object for the same texts and counts.

        Raises
        ------
        struct.error
            It is shorter than it states.
        """
        key = raw[1], len(raw)
        layout = self._layouts.get(key)
        values = layout.unpack(raw) if layout else ()
        if layout is None or layout.same(values) != layout.known:
            if len(self._layouts) > 100:  # damaged messages have any length
                self._layouts.clear()
            layout = self._layouts[key] = _layout(raw, self._form)
            values = layout.unpack(raw)
        return layout, values


def _layout(raw: bytes, form: tuple[Any, ...]) -> Layout:
    """Walk through a message; alignment counts from behind the first 4 bytes."""
    order, at, index = '<' if raw[1] == 1 else '>', 4, 0
    parts, fixed = [order, '4x'], list[int]()
    texts, counts = list[str](), list[int]()

    def step(part: str, size: int) -> int:
        nonlocal at, index
        padding = (4 - at) % size
        begin = at + padding
        at = begin + calcsize('<' + part)
        if at > len(raw):
            raise StructError('a message is shorter than it states')
        parts.append(f'{padding}x{part}')
        index += 1 if part[-1] == 's' else int(part[:-1] or 1)
        return begin

    def count() -> int:
        return int(unpack_from(order + 'I', raw, step('I', 4))[0])

    def follow(form: tuple[Any, ...]) -> None:
        for part in form:
            if isinstance(part, tuple):
                fixed.append(index)
                counts.append(count())
                for _ in range(counts[-1]):
                    follow(part)
            elif part == 's':
                length = count()
                fixed.append(index)
                begin = step(f'{length}s', 1)
                texts.append(raw[begin:at].rstrip(b'\0').decode(errors='replace'))
            else:
                step(part, calcsize('<' + part[-1]))

    follow(form)
    unpack, same = Struct(''.join(parts)).unpack_from, itemgetter(*fixed)
    return Layout(unpack, same, same(unpack(raw)), tuple(texts), tuple(counts))
