"""``forcecal calibrate``: identify tool, sensor and noise from a recording."""

import argparse
import sys
from typing import Any

from forcecal_ros.commands.common import (
    add_bag, add_json, new_parser, print_json, topic_names,
)
from forcecal_ros.geometry import STANDARD_GRAVITY


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'calibrate',
        summary='identify tool, accelerometer and noise from a recording',
        example='forcecal calibrate my_bag --topic wrench=/ft/data -o calibration.yaml')
    add_bag(parser)
    add_identification(parser)
    parser.add_argument('-o', '--output', metavar='FILE', default='calibration.yaml',
                        help='where the calibration goes')
    parser.add_argument('--report', metavar='FILE', help='write an HTML report too')
    add_json(parser)
    parser.set_defaults(run=run)
