"""Faults tried in phases, cell by cell, kept in a file, and the table of what they came to."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import json
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from fault_motion_runs import Bench, Outcome


def cell(outcome: Outcome) -> str:
    """Return what the table says."""
    if outcome.end == 'stopped':
        return f'{1e3 * outcome.moving:.0f} ms'
    return outcome.end


def table(outcomes: list[Outcome], faults: Sequence[str], phases: Sequence[str]) -> str:
    """Return the table as Markdown."""
    rows = ['| fault | ' + ' | '.join(phases) + ' | the node says |',
            '|---|' + '---|' * (len(phases) + 1)]
    for fault in faults:
        found = {outcome.phase: outcome for outcome in outcomes if outcome.fault == fault}
        if found:
            reasons = [o.reason for o in found.values() if o.reason]
            rows.append(f'| {fault} | ' + ' | '.join(
                cell(found[phase]) if phase in found else '' for phase in phases)
                + f' | {max(reasons, key=reasons.count) if reasons else ""} |')
    return '\n'.join(rows)


def arguments(what: str) -> argparse.Namespace:
    """Return which cells are asked for."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument('--fault', default='', help='only faults with this in their name')
    parser.add_argument('--phase', default='', help='only phases with this in their name')
    parser.add_argument('--json', metavar='FILE', type=Path,
                        help='keep each outcome there; what it holds already is not tried again')
    return parser.parse_args()


def known(args: argparse.Namespace) -> list[Outcome]:
    """Return the outcomes of an earlier session."""
    if args.json and args.json.exists():
        return [Outcome(**outcome) for outcome in json.loads(args.json.read_text())]
    return []


def go(bench: Bench, faults: Sequence[str], phases: Sequence[str], args: argparse.Namespace,
       outcomes: list[Outcome]) -> None:
    """Try the cells that are asked for and have no outcome."""
    done = {(outcome.fault, outcome.phase) for outcome in outcomes}
    for fault in faults:
        for phase in phases:
            if args.fault in fault and args.phase in phase and (fault, phase) not in done:
                outcomes.append(bench.tried(fault, phase))
                print(outcomes[-1], file=sys.stderr, flush=True)
                if args.json:
                    args.json.write_text(json.dumps([asdict(o) for o in outcomes], indent=1))


def count(outcomes: list[Outcome]) -> int:
    """Print how many survived; return the exit status."""
    survived = sum(outcome.survived for outcome in outcomes)
    print(f'\n{len(outcomes)} tried, {survived} survived')
    return int(survived < len(outcomes))
