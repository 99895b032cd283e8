"""Both recordings of a case as a file."""

import json
from pathlib import Path
from typing import Any

from blind.sensors import Recorded
import numpy as np


def save_case(path: Path, pair: tuple[Recorded, Recorded]) -> None:
    """Write both recordings of a case."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {}
    for number, recorded in enumerate(pair):
        arrays |= {f'{number}.{name}': value for name, value in recorded._asdict().items()}
        arrays[f'{number}.phases'] = np.array(json.dumps(recorded.phases))
    scratch = path.with_name(f'.{path.name}')
    with scratch.open('wb') as file:
        np.savez(file, **arrays)
    scratch.replace(path)


def load_case(path: Path) -> tuple[Recorded, Recorded]:
    """Read both recordings of a case."""
    def one(number: int, data: Any) -> Recorded:
        values = {name: data[f'{number}.{name}'] for name in Recorded._fields}
        values['phases'] = tuple((str(name), float(start), float(end)) for name, start, end
                                 in json.loads(str(values['phases'])))
        return Recorded(**values)

    with np.load(path) as data:
        return one(0, data), one(1, data)
