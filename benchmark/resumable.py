"""Cases that are run one after the other and kept, so that an interrupted run goes on."""

from collections.abc import Callable, Sequence
import json
from pathlib import Path
import sys
from typing import Any

from forcecal_ros.cli.many import each
from tqdm import tqdm

Case = dict[str, Any]


def resumed(run: Callable[[Case], Case], wanted: Sequence[Case], out: Path, jobs: int,
            same: Callable[[Case, Case], bool]) -> list[Case]:
    """
    Run the cases that a file does not hold yet, and add each to it.

    Parameters
    ----------
    run : callable
        Case -> result.
    wanted : sequence of dict
    out : Path
        One JSON object a line.
    jobs : int
        Processes.
    same : callable
        (case, result) -> whether the result is that case's.

    Returns
    -------
    list of dict
        All results of the file; those that failed are said on standard error.
    """
    done = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    left = [c for c in wanted if not any(same(c, d) for d in done)]
    for outcome in tqdm(each(run, left, jobs=jobs), total=len(left), disable=None):
        if outcome.value is None:
            print(left[outcome.index], outcome.error, file=sys.stderr)
            continue
        line = json.dumps(outcome.value)
        with out.open('a') as file:
            file.write(line + '\n')
        done.append(json.loads(line))
    return done
