"""``forcecal insitu``: offset and matrix of six-axis sensors from an accelerometer."""

import argparse
from collections.abc import Iterator
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from forcecal_ros.commands.common import add_json, new_parser, print_json, say, warn

if TYPE_CHECKING:
    from forcecal_ros.insitu.prepare import Chunk, Source
    from forcecal_ros.insitu.result import SensorResult
    from forcecal_ros.insitu.spec import Spec

TABLES = ('.csv', '.txt', '.tsv', '.npy')


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'insitu',
        summary='calibrate six-axis sensors in situ with an accelerometer',
        example='forcecal insitu leg.yaml -o leg_calibration')
    parser.add_argument('specification', metavar='SPEC.yaml',
                        help='data sets, sensors and accelerometer; see config/examples')
    parser.add_argument('-o', '--output', metavar='DIR', required=True,
                        help='folder for insitu.json, calibration.yaml, pictures and report.html')
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    # small matrices are slower on several threads than on one
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    from dataclasses import replace
    import json

    from forcecal_ros.atomic_files import write_bytes, write_text
    from forcecal_ros.calibration.file import save
    from forcecal_ros.insitu import calibrate, DataSet, load_spec, to_calibration, to_document
    from forcecal_ros.report.insitu import pictures, render, text

    spec = load_spec(args.specification)
    results: list['SensorResult'] = []
    for name, sensor in spec.sensors.items():
        data_sets = [DataSet(d.name, _source(spec, name, Path(d.file)), d.load(name, sensor),
                             d.train, d.window) for d in spec.data_sets]
        results.append(calibrate(
            name, data_sets, sensor.mounting, replace(spec.options, raw_unit=sensor.unit),
            sensor.manufacturer_matrix))
    folder = Path(args.output)
    document = to_document(tuple(results))
    write_text(folder / 'insitu.json', json.dumps(document, indent=2, allow_nan=False))
    drawn = {result.name: pictures(result) for result in results}
    for name, files in drawn.items():
        for title, png in files.items():
            write_bytes(folder / f'{name}_{title}.png', png)
    write_text(folder / 'report.html', render(tuple(results), drawn, str(spec.path)))
    for (name, sensor), result in zip(spec.sensors.items(), results):
        if result.matrix is not None:
            place = folder if len(results) == 1 else folder / name
            save(to_calibration(result, sensor.frame, str(spec.path)), place / 'calibration.yaml')
    if args.json:
        print_json(document)
        return 0
    for result in results:
        for warning in result.warnings:
            warn(f'{result.name}: {warning}')
        say(text(result))
    say(f'{folder}: report.html, insitu.json'
        + (', calibration.yaml' if spec.options.matrix else ''))
    return 0


def _source(spec: 'Spec', name: str, path: Path) -> 'Source':
    """Return what reads one data set for one sensor: a table, or else a recording."""
    from forcecal_ros.insitu.streams import join, topics_of
    from forcecal_ros.insitu.tables import TableSource
    from forcecal_ros.recording.bags import read_pieces
    from tqdm import tqdm

    sensor = spec.sensors[name]
    table = TableSource(spec, path, sensor.columns) if path.suffix in TABLES else None

    told: list[str] = []

    def read() -> Iterator['Chunk']:
        chunks = table() if table else join(
            read_pieces(path, topics_of(spec, name)), spec, name)
        with tqdm(desc=f'{name}: {path.name}', unit=' samples', leave=False,
                  disable=None) as bar:
            for chunk in chunks:
                bar.update(len(chunk.t))
                yield chunk
        if table and table.left_out and not told:
            told.append(f'{path.name}: {table.left_out} rows without numbers or not in order of '
                        'time were left out')
            warn(told[-1])

    return read
