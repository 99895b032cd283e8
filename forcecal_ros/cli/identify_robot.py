"""``forcecal identify-robot``: models of robot and tool from a recording."""

import argparse
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.common import new_parser, read_checked
from forcecal_ros.cli.each_recording import add_bags, Answer
from forcecal_ros.cli.each_recording import run as run_each
from forcecal_ros.cli.outputs import add_output, FILE

if TYPE_CHECKING:
    from forcecal_ros.impedance.plant_fit import PlantFit


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'identify-robot',
        example='forcecal identify-robot shaken_bag -o plant.yaml')
    add_bags(parser)
    add_output(parser, '-o', '--output', kind=FILE, suffix='.yaml', metavar='FILE',
               default='plant.yaml',
               help='models to write, - for standard output; an earlier one is kept as '
                    'FILE~; of several BAGs, a folder for them')
    parser.set_defaults(run=run, inputs=('bag',))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    return run_each(args, answer)


def answer(args: argparse.Namespace) -> Answer:
    """Identify from one recording."""
    from forcecal_ros.impedance.plant import save_plant, to_document
    from forcecal_ros.impedance.plant_fit import identify_plant

    recording = read_checked(args, args.bag, ['target', 'pose', 'wrench', 'optidrive'])
    fit = identify_plant(recording)
    save_plant(fit, args.output)
    return Answer(to_document(fit), f'{as_text(fit)}\n\nwritten to {args.output}',
                  f'robot of order {len(fit.robot.robot.feedback.value)}, fit '
                  f'{100.0 * fit.robot.fit:.2f} %, written to {args.output}', recording.notes)


def as_text(fit: 'PlantFit') -> str:
    """Return the models as one table, and what tells how good they are."""
    from math import nan

    from forcecal_ros.core.quantity import size
    from forcecal_ros.report.rows import as_text as table
    from forcecal_ros.report.rows import Row

    found, robot = fit.robot, fit.robot.robot
    rows = [('period', 's', robot.period, nan), ('delay', 'periods', robot.delay, nan)]
    for name, estimate in (('feedback', robot.feedback), ('feedforward', robot.feedforward)):
        rows += [(f'{name} {i + 1}', '1', value, std)
                 for i, (value, std) in enumerate(zip(estimate.value, estimate.std))]
    rows += [(f'tool {name}', one.unit, float(one), float(one.std))
             for name, one in vars(fit.slide.slide).items()]
    orders = ', '.join(f'{one.order}: {size(one.error, "m")}' for one in found.orders)
    lines = [table([Row(name, name, unit, value, std) for name, unit, value, std in rows]), '',
             f'held-out fit {100.0 * found.fit:.2f} %; held-out error by order: {orders}']
    lines += [f'pole {_number(pair.pole)} and zero {_number(pair.zero)} nearly cancel: together '
              f'at most {100.0 * pair.effect:.2g} % of the response' for pair in found.pairs]
    return '\n'.join(lines)


def _number(z: complex) -> str:
    return f'{z.real:.4f}' if abs(z.imag) < 1e-9 else f'{z:.4f}'
