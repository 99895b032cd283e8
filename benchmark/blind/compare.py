"""How the baselines fare on the same cases."""

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any

from blind.answered import same_class, VISIBLE
from blind.baselines import judge
from blind.casefile import load_case
from blind.score import wilson
from blind.seal import write_json


def judge_case(job: tuple[str, str]) -> None:
    """Let the baselines judge a case of a run; ``job``: (folder, id). What is there stays."""
    folder, identity = Path(job[0]), job[1]
    path = folder / 'baselines' / f'{identity}.json'
    if not path.exists():
        write_json(path, judge(load_case(folder / 'cases' / f'{identity}.npz')[0]))


def table(labels: Mapping[str, Mapping[str, Any]], folder: Path) -> str:
    """Return false alarms, right names and right channels of each baseline, as Markdown."""
    judged = {one: json.loads((folder / 'baselines' / f'{one}.json').read_text())
              for one in labels}
    none = [one for one, label in labels.items() if label['kind'] == 'none']
    single = [one for one, label in labels.items() if label['kind'] == 'single'
              and label['energy'] >= VISIBLE and not label['parts'][0]['random']]

    def named(one: str, method: str) -> bool:
        names = judged[one][method]['names']
        return bool(names) and same_class(names[0], labels[one]['parts'][0]['name'])

    def located(one: str) -> bool:
        best = {name: max(row.values()) for name, row in labels[one]['cells'].items()}
        return bool(
            best.get(judged[one]['rmse']['channel'], 0.0) >= 0.5 * max(best.values()))

    lines = ['', '### Baselines on the same cases', '',
             '| method | false alarms | right effect or an alias first | right channel |',
             '|---|---|---|---|',
             (f'| ranking by RMSE | {_share([judged[one]["rmse"]["gap"] for one in none])} | '
              f'names none | {_share([located(one) for one in single])} |')]
    for method, name in (('bic', 'white-noise BIC'), ('everything', 'a fit of everything')):
        lines.append(
            f'| {name} | {_share([bool(judged[one][method]["names"]) for one in none])} | '
            f'{_share([named(one, method) for one in single])} | |')
    return '\n'.join(lines) + '\n'


def _share(told: list[bool]) -> str:
    low, high = wilson(sum(told), len(told))
    return f'{sum(told)} of {len(told)} ({100 * low:.0f} to {100 * high:.0f} %)'
