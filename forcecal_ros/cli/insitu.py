"""``forcecal insitu``: offset and matrix of six-axis sensors from an accelerometer."""

import argparse
from pathlib import Path
import re
import sys
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.core.files import write_results

if TYPE_CHECKING:
    from forcecal_ros.insitu.blocks import Chunk, Source
    from forcecal_ros.insitu.result import SensorResult
    from forcecal_ros.insitu.spec import Spec

TABLES = ('.csv', '.txt', '.tsv', '.npy')


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'insitu',
        example='forcecal insitu leg.yaml -o leg_calibration')
    parser.add_argument('specification', metavar='SPEC.yaml',
                        help='data sets, sensors and accelerometer; forcecal sample insitu '
                             'writes an example')
    common.add_output(parser, '-o', '--output', kind='results', metavar='DIR', required=True,
                      help='folder for insitu.json, calibration.yaml, pictures and report.html')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from dataclasses import replace
    import json

    from forcecal_ros.insitu import calibrate, DataSet, load_spec, to_calibration, to_document
    from forcecal_ros.io.calibration_file import dump
    from forcecal_ros.report.insitu import pictures, render, text

    spec = load_spec(args.specification)
    results: list[SensorResult] = []
    for name, sensor in spec.sensors.items():
        data_sets = [DataSet(d.name, _source(args, spec, name, Path(d.file)), d.load(name, sensor),
                             d.train, d.window) for d in spec.data_sets]
        results.append(calibrate(
            name, data_sets, sensor.mounting, replace(spec.options, raw_unit=sensor.unit),
            sensor.manufacturer_matrix))
    folder = Path(args.output)
    document = to_document(tuple(results))
    drawn = {result.name: pictures(result) for result in results}
    named = {r.name: f'{"" if len(results) == 1 else f"{r.name}/"}calibration.yaml'
             for r in results}
    files: dict[str, str | bytes] = {
        'insitu.json': json.dumps(document, indent=2, allow_nan=False),
        'report.html': render(tuple(results), drawn, str(spec.path),
                              {name: str(folder / file) for name, file in named.items()}),
        **{f'{name}_{title}.png': png for name, images in drawn.items()
           for title, png in images.items()}}
    for (name, sensor), result in zip(spec.sensors.items(), results):
        if result.matrix is not None:
            files[named[name]] = dump(to_calibration(result, sensor.frame, str(spec.path)))
    write_results(folder, files, earlier(folder))
    files_named = ', calibration.yaml' if spec.options.matrix else ''
    return common.show(
        args, document, '\n'.join([*map(text, results),
                                   f'{folder}: report.html, insitu.json{files_named}']),
        () if args.json else [f'{result.name}: {warning}' for result in results
                              for warning in result.warnings])


def earlier(folder: Path) -> list[str]:
    """Return what the run before, whose sensors its insitu.json names, may have written."""
    import json

    try:
        named = json.loads((folder / 'insitu.json').read_bytes())['sensors']
        sensors = [name for name in named if re.fullmatch(r'[\w-]+', name)]
    except (OSError, ValueError, KeyError, TypeError):
        sensors = []
    return ['calibration.yaml', *(f'{sensor}{rest}' for sensor in sensors for rest in (
        '_forces.png', '_subspace.png', '_singular_values.png', '/calibration.yaml'))]


def _source(args: argparse.Namespace, spec: 'Spec', name: str, path: Path) -> 'Source':
    """Return what reads one data set for one sensor: a table, or else a recording."""
    from forcecal_ros.insitu.sources import join, read_table, topics_of
    from forcecal_ros.io.bags import read_chunks

    shown: list[str] = []

    def read() -> 'Chunk':
        if not shown and not args.quiet and not sys.stderr.isatty():
            common.warn(f'{name}: reading {path.name}')
        with common.bar(args, desc=f'{name}: {path.name}', unit=' samples') as done:
            if path.suffix in TABLES:
                chunk, notes = read_table(spec, path, spec.sensors[name].columns, done.update)
            else:
                chunk, notes = join(read_chunks(path, topics_of(spec, name)), spec, name), []
                done.update(len(chunk.t))
        if not shown:
            shown.extend(['read', *notes])
            for note in notes:
                common.warn(note)
        return chunk

    return read
