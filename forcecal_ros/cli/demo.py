"""``forcecal demo``: the main job against the simulated rig, live over ROS 2."""

import argparse
from pathlib import Path
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.core.files import make_folder, write_results

if TYPE_CHECKING:
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording, Stream


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'demo',
        example='forcecal demo --accelerometer acc2 --output my_demo')
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'), default='acc1',
                        help='acc1: DC response, acc2: AC-coupled')
    common.add_output(parser, '-o', '--output', kind='results', metavar='DIR',
                      default='forcecal_demo',
                      help='folder for calibration.yaml, the recording and report.html')
    parser.add_argument('--seed', type=common.whole, default=1, help='seed of the sensor noise')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    with common.needs_ros():
        from forcecal_ros.nodes.demo import run_demo
    from forcecal_ros.core.quantity import size
    from forcecal_ros.core.streams import Stream
    from forcecal_ros.io.bags import read_recording
    from forcecal_ros.io.calibration_file import dump, parse, to_document
    from forcecal_ros.observe import replay
    from forcecal_ros.report.calibration import render
    from forcecal_ros.report.page import estimated_by
    from forcecal_ros.report.rows import as_text, table
    from forcecal_ros.sim.rig.file import load_rig, true_calibration

    out = Path(args.output)
    common.warn_if_compiling('simulator', 'observer')
    make_folder(out)
    with common.stages(args, after=0.0) as show_phase:
        published_text, duration = run_demo(args.accelerometer, out, args.seed, show_phase)
    calibration = parse(published_text, 'sequencer/calibration')
    truth = true_calibration(load_rig(), args.accelerometer)
    recording = read_recording(out / 'bag')
    published = read_contact(out / 'bag', recording.start_ns)
    replayed = replay(recording, calibration)
    again = Stream(replayed.t, replayed.contact, calibration.sensor_frame)
    write_results(out, {'calibration.yaml': dump(calibration),
                        'report.html': render(
                            recording, calibration, again, truth,
                            estimated_by(f'{out}/bag', f'{out}/calibration.yaml'))})
    step, touch = figures(recording, calibration, again, published)
    sensor, observer, true, published_force = (size(float(x), 'N', 4) for x in (
        step['sensor'], step['observer'], touch['truth'], touch['observer']))
    return common.show(args, {**to_document(calibration), 'demo': {
        'motion_to_gains': {'value': duration, 'std': None, 'unit': 's'},
        'step': step, 'contact': touch}}, '\n'.join((
            as_text(table(calibration, truth)), '',
            f'calibrated {duration:.1f} s after the first command',
            (f'step, no contact: sensor {sensor} RMS along x without bias, observer {observer} '
             f'({step["reduction"]:.1f} dB lower)'),
            f'contact: true force {true} along x, published {published_force}',
            f'written to {out}: calibration.yaml, bag, report.html')),
        calibration.quality.get('warnings', ()))


def read_contact(bag: Path, start_ns: int) -> 'Stream':
    """Read what the observer published, on the clock of the recording."""
    from dataclasses import replace

    from forcecal_ros.io.bags import read_recording

    recording = read_recording(bag, {'wrench': '/observer/contact_wrench'})
    assert recording.wrench is not None
    shift = (recording.start_ns - start_ns) * 1e-9
    return replace(recording.wrench, t=recording.wrench.t + shift)


def figures(recording: 'Recording', calibration: 'Calibration', replayed: 'Stream',
            published: 'Stream') -> tuple[dict[str, float | str], dict[str, float | str]]:
    """
    Compare forces along x: in the ringing after the step, and while the tool touches.

    Returns
    -------
    dict
        ``sensor`` without bias and ``observer`` over the recording, RMS [N]; ``reduction`` [dB].
    dict
        ``truth`` and ``observer``, means over phase ``contact`` at the stamps published [N].
    """
    import numpy as np

    step, hold = (next(phase for phase in recording.phases if phase.name == name)
                  for name in ('step', 'contact'))
    during, held = replayed.between(step.start, step.end), published.between(hold.start, hold.end)
    assert recording.wrench is not None
    assert recording.contact_truth is not None
    sensor = recording.wrench.at(during.t)[:, 0] - calibration.wrench_bias.value[0]
    before, after = (float(np.sqrt(np.mean(x ** 2))) for x in (sensor, during.values[:, 0]))
    # a busy computer publishes or records less than all of the contact
    truth, observer = (float(values[:, 0].mean())
                       for values in (recording.contact_truth.at(held.t), held.values))
    return {'sensor': before, 'observer': after, 'unit': 'N',
            'reduction': float(20 * np.log10(before / after))}, {
                'truth': truth, 'observer': observer, 'unit': 'N'}
