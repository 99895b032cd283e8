"""Times of several parts, measured in turn so that a busy machine slows all of them alike."""

from collections.abc import Callable, Mapping
import time


def best(parts: Mapping[str, Callable[[], object]], rounds: int = 5) -> dict[str, float]:
    """Return the least processor time of each part over some rounds, all parts in each [s]."""
    least = dict.fromkeys(parts, float('inf'))
    for _ in range(rounds):
        for name, part in parts.items():
            start = time.process_time()
            part()
            least[name] = min(least[name], time.process_time() - start)
    return least


def row(*cells: object) -> None:
    """Print one row of a table, at once."""
    print('| ' + ' | '.join(str(cell) for cell in cells) + ' |', flush=True)


def head(*cells: object) -> None:
    """Print the head of a table."""
    row(*cells)
    row(*['---'] * len(cells))
