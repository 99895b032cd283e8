"""What all recordings of others go through: a command, a table, plain least squares."""

from contextlib import redirect_stderr, redirect_stdout
import io
import json
from pathlib import Path
import sys
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]

from forcecal_ros.cli.main import main as forcecal
import numpy as np

G = 9.81


def said(*arguments: Any) -> Any:
    """Run a command; return its JSON, or the line of its refusal."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = forcecal([str(argument) for argument in arguments])
    if status == 0:
        return json.loads(out.getvalue()) if '--json' in arguments else None
    return err.getvalue().strip().splitlines()[-1].removeprefix('forcecal: ')


def write_table(path, names, columns):
    np.savetxt(path, columns, '%.9g', ',', header=','.join(names), comments='')


def by_least_squares(force, R):
    """Mass of plain least squares, force = m g + bias in the sensor's frame."""
    rows = np.concatenate([(R.transpose(0, 2, 1) @ [0, 0, -G])[:, :, None],
                           np.broadcast_to(np.eye(3), R.shape)], axis=2)
    return float(np.linalg.lstsq(rows.reshape(-1, 4), force.ravel(), rcond=None)[0][0])


def tool(found):
    """Say mass and centre of mass, or the refusal."""
    if isinstance(found, str):
        return f'refused: {found}'
    mass, com = found['mass'], found['com']
    return (f'{mass["value"]:.4f} +- {mass["std"]:.4f} kg, centre of mass '
            f'{" ".join(f"{x:.4f}" for x in com["value"])} m')


def taken(folder, tables, *options):
    """Import tables as they are, and calibrate; what came of it, paths left out."""
    spec, bag = folder / 'import.yaml', folder / f'bag{len(list(folder.glob("bag*")))}'
    spec.write_text(json.dumps({'format': 'forcecal-import/1', 'tables': tables}))
    found = said('import', spec, '-o', bag) or said(
        'calibrate', bag, '--gravity', G, '--json', '-o', folder / 'c.yaml', *options)
    return tool(found).replace(f'{folder}/', '').replace(f'{bag.name}: ', '')


def wrench(frame, force, torque):
    """Say which columns are force and torque, in N and N m."""
    return {'frame': frame, 'force': {'columns': list(force), 'unit': 'N'},
            'torque': {'columns': list(torque), 'unit': 'N m'}}
