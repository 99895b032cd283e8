"""``forcecal check``: what is in a recording, what can be done with it, and the next command."""

import argparse
import re
import shlex
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.core.errors import ForcecalError, with_id

if TYPE_CHECKING:
    from forcecal_ros.core.streams import Recording

SIGNALS = {'wrench': 'wrench', 'accelerometer': 'accelerometer', 'imu': 'angular_velocity',
           'pose': 'pose', 'joint_states': 'joints', 'optidrive': 'optidrive', 'target': 'target',
           'joint_commands': 'joint_commands'}
"""Role -> stream of a recording, in the order of the table."""

SIGNS = {1: '1, environment on tool (identified from gravity)',
         -1: '-1, tool on environment (identified from gravity)', None: 'not identifiable'}
"""Of the wrench in the driver's messages."""

YES = {'diagnose': 'yes, against a model'}
"""How a possible use is reported; ``yes`` if it is not named here."""

OPTION = re.compile(r'--[a-z-]+(?: -?[\d.]+(?:e-?\d+)?)+')
"""An option with numbers, as a message of the checks states it for a remedy."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(subparsers, 'check', inputs=('bag',),
                               example='forcecal check my_bag --preset ur')
    common.add_bag(parser)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.io.bags import read_calibrations

    recording = common.read(args, args.bag, joints=True)
    document = inspect(recording)
    document['calibration_recorded'] = bool(read_calibrations(
        args.bag, common.topic_names(args, args.bag)))
    document['next'] = _next(args, recording, document)
    return common.show(args, document, as_text(document), status=1 if document['fault'] else 0)


def inspect(recording: 'Recording') -> dict[str, Any]:
    """
    Return what a recording holds, its faults, and what can be done with it.

    Returns
    -------
    dict
        ``streams`` (by role: topic and type if read from a bag, samples, rate [Hz], longest gap
        [s], start and end [s], frame), ``missing`` (role -> topics that may be meant),
        ``motion``, ``fault`` (what the checks refuse; empty), ``notes``, ``wrench_sign`` (by
        gravity; None: not identifiable), ``uses`` (command -> empty, or why not), ``estimates``
        (of a calibration, if there is one).
    """
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.checks.hypotheses import TABLE_BY_NAME
    from forcecal_ros.checks.messages import SIGN
    from forcecal_ros.core.topics import MAIN_ROLES, require

    document: dict[str, Any] = {
        'recording': recording.source,
        'streams': {role: {**dict(zip(('topic', 'type'), recording.topics.get(role, ()))),
                           **_stream(stream)} for role, name in SIGNALS.items()
                    if (stream := getattr(recording, name))},
        'missing': {role: list(names) for role, names in recording.candidates.items()
                    if role in MAIN_ROLES},
        'motion': _motion(recording)}
    found, why, about, sign = None, '', '', recording.wrench_sign or 1
    try:
        recording = checked(recording)
        require(recording, ['wrench', 'pose'])
        found = identify(recording)  # which refuses wrong signs, frames and units
    except ForcecalError as error:
        why, about = with_id(error), error.about
    # what is about the recording spoils every use, what a calibration alone lacks does not
    fault = why if about or recording.removed is None else ''
    row = TABLE_BY_NAME.get(about)
    spoilt = '' if row and row.is_note else fault  # which is a note where the tool is known
    quality = {} if found is None else found.quality
    return {**document, 'fault': fault, 'notes': [
        *recording.notes, *quality.get('warnings', ()), *quality.get('questions', ())],
        'wrench_sign': sign if found else -sign if about == SIGN else None,
        'uses': _uses(recording, spoilt, why), 'estimates': None if found is None else {
            'mass': float(found.mass), 'mass_std': float(found.mass.std),
            'poses': len(quality.get('poses', ()))}}


def _stream(stream: Any) -> dict[str, Any]:
    from forcecal_ros.core.stamps import jitter_of
    import numpy as np

    gaps = np.diff(stream.t)
    period = jitter_of(stream.t).period  # of messages that come in bursts, too
    return {'samples': len(stream), 'rate': 1.0 / period if period > 0.0 else None,
            'longest_gap': float(gaps.max()) if len(gaps) else None,
            'start': float(stream.t[0]), 'end': float(stream.t[-1]),
            'frame': getattr(stream, 'frame', '') or None}


def _motion(recording: 'Recording') -> dict[str, Any] | None:
    """Return how far the pose moves and rotates, and which phases were recorded."""
    import numpy as np

    pose = recording.pose
    if pose is None or len(pose) < 2:
        return None
    cosine = 0.5 * (np.trace(pose.R_base_sensor[0].T @ pose.R_base_sensor, axis1=1, axis2=2) - 1.0)
    return {'rotation_deg': float(np.degrees(np.arccos(np.clip(cosine.min(), -1.0, 1.0)))),
            'range_m': np.ptp(pose.position, axis=0).tolist() if pose.has_position else None,
            'phases': list(dict.fromkeys(phase.name for phase in recording.phases))}


def _uses(recording: 'Recording', fault: str, why: str) -> dict[str, str]:
    """Return for each command nothing, or why the recording does not do for it."""
    if fault:
        return dict.fromkeys(('calibrate', 'estimate', 'diagnose'), 'see the fault above')
    from forcecal_ros.core.topics import naming
    from forcecal_ros.diagnose.dataset import too_few

    no_pose = '' if recording.pose is not None else f'; {naming(recording, "pose")}'
    no_wrench = '' if recording.wrench is not None else (
        f'no wrench was recorded, and every use requires it{no_pose}')
    gravity = recording.pose is not None or recording.angular_velocity is not None
    commands = recording.target is not None or recording.joint_commands is not None
    lacking = ' and '.join(f'no {name}' for name, stream in (
        ('target_frame', recording.target), ('pose', recording.pose)) if stream is None)
    return {
        'calibrate': why,
        'estimate': no_wrench or (
            '' if gravity else f'neither a pose nor an IMU was recorded{no_pose}'),
        'diagnose': no_wrench or too_few(recording) or (
            '' if recording.pose is not None or commands else
            'neither a pose nor commands were recorded'),
        'diagnose with a simulator': no_wrench or too_few(recording) or (
            '' if commands else 'no commands (target_frame, joint_commands) were recorded'),
        'fit-rig': no_wrench or (lacking and f'{lacking} was recorded{no_pose}')}


def _next(args: argparse.Namespace, recording: 'Recording', document: dict[str, Any]) -> list[str]:
    """Return the commands that may follow, the likeliest first; or what else to do."""
    from forcecal_ros.core.topics import naming_words

    def command(name: str, *words: str, but: str = '') -> str:
        sign = () if args.wrench_sign is None or '--wrench-sign' in but else (
            '--wrench-sign', str(args.wrench_sign))
        return shlex.join(('forcecal', name, args.bag, *common.read_likewise(
            args, poses='--sensor-from-pose' not in but), *sign, *words))

    uses, why = document['uses'], document['fault'] or document['uses']['calibrate']
    unnamed = {role: names for role, names in document['missing'].items()
               if role in ('wrench', 'pose') and getattr(recording, role) is None}
    if unnamed and not document['fault']:
        return [command('check', *naming_words(unnamed))]
    known, report = ('--calibration', 'calibration.yaml'), ('--report', 'report.html')
    found = [command('calibrate', *' '.join(options).split(), *report, but=words)
             for words in why.split(' unless ') if (options := OPTION.findall(words))]
    if not why:
        found = [command('calibrate', *report)]
    elif not uses['estimate']:
        found += [command('estimate', *(() if document['calibration_recorded'] else known),
                          '-o', 'contact')]
    if not uses['diagnose']:
        model = (() if recording.contact_truth else ('--mujoco', 'MODEL.xml')
                 if recording.joint_commands else ('--simulated', 'SIM_BAG')
                 if recording.target else known)
        found += [command('diagnose', *model, '-o', 'diagnosis')]
    return found or [why.rpartition('; ')[2].partition(' [')[0]]


def as_text(document: dict[str, Any]) -> str:
    """Return the document as lines for a terminal."""
    from forcecal_ros.core.quantity import size, sizes
    from forcecal_ros.core.topics import listed
    from forcecal_ros.report.rows import aligned

    rows = [['role', 'topic', 'type', 'rate', 'longest gap', 'from', 'to', 'frame']]
    for role, one in document['streams'].items():
        rate, gap = one['rate'], one['longest_gap']
        rows.append([role, one['topic'], one['type'].rpartition('/')[2],
                     '-' if rate is None else f'{rate:.4g} Hz',
                     '-' if gap is None else size(gap, 's'), f'{one["start"]:.2f} s',
                     f'{one["end"]:.2f} s', one['frame'] or '-'])
    lines = [document['recording'], '', *aligned(rows, left=(0, 1, 2, 7))]
    for role, names in document['missing'].items():
        lines.append(f'{role}: not found; candidates: {listed(names)} (--topic {role}=NAME)')
    if motion := document['motion']:
        moved = '' if motion['range_m'] is None else (
            f', moves by {sizes(motion["range_m"], "m").replace(", ", " x ")}')
        phases = f'; phases {", ".join(motion["phases"])}' if motion['phases'] else ''
        lines.append(f'motion: rotates by up to {motion["rotation_deg"]:.0f} deg{moved}{phases}')
    if found := document['estimates']:
        n = found['poses']
        by = f'{n} static poses' if n else 'the motion (no static poses)'
        lines.append(f'tool: {found["mass"]:.4g} kg from {by}; frame and units of the wrench '
                     'agree with gravity')
    lines.append(f'wrench sign: {SIGNS[document["wrench_sign"]]}')
    lines += [f'note: {note}' for note in document['notes']]
    if document['fault']:
        lines.append(f'fault: {document["fault"]}')
    lines += ['', *(f'{use}: ' + (f'no: {why}' if why else YES.get(use, 'yes'))
                    for use, why in document['uses'].items())]
    return '\n'.join([*lines, *(f'{"next" if not i else "  or"}: {one}'
                                for i, one in enumerate(document['next']))])
