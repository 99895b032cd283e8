"""``forcecal sample``: recordings to try the other commands on."""

import argparse
from pathlib import Path
from typing import Any

from forcecal_ros.cli.common import new_parser, say, warn_if_compiling, whole
from forcecal_ros.cli.outputs import add_output, RESULTS
from forcecal_ros.core.files import make_folder, write_results, write_text

LATE = {'wrench_delay': {'delay': 0.004}}
"""In what the robot of the second recording differs from the rig file."""

SHAKEN = 30.0
"""Length of the recording that is shaken [s]: enough for the model to choose its order by."""

BEGUN = 1_700_000_000 * 10 ** 9
"""Stamp at which recordings begin [ns], of a day like any other."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(subparsers, 'sample', json=False, quiet=False,
                        example='forcecal sample rig -o sample')
    parser.add_argument('kind', choices=tuple(KINDS),
                        help='rig: two recordings of the simulated rig, one without any fault '
                             'and one whose wrench is 4 ms late; rigid_arm: two of an arm, '
                             'one without any fault and one whose gripper weighs 5 %% more than '
                             'in its MuJoCo model, and that model; insitu: tables of a limb with '
                             'added masses, and the spec.yaml that describes them; shaken: the '
                             'simulated rig shaken along x, for fit-rig --for impedance')
    add_output(parser, '-o', '--output', kind=RESULTS, metavar='DIR', required=True,
               help='folder for them; earlier ones are kept as NAME~')
    parser.add_argument('--seed', type=whole, default=0, help='of the sensor noise')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    return KINDS[args.kind](args)


def _rig(args: argparse.Namespace) -> int:
    from dataclasses import replace

    from forcecal_ros.diagnose.plan import motion_for
    from forcecal_ros.effects import with_effects
    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate, waits_for_compiler

    rig, folder = load_rig(), Path(args.output)
    warn_if_compiling(waits_for_compiler(), 'the simulator')
    make_folder(folder)
    moved = motion_for(rig, contact=True, brief=True)
    for i, (name, effects) in enumerate((('sound', {}), ('late', LATE))):
        recording = simulate(with_effects(rig, effects) if effects else rig, moved.target,
                             seed=args.seed + i)
        write_recording(folder / name, replace(
            recording, phases=moved.phases, start_ns=BEGUN))
    say(f'written to {folder}: sound, late ({moved.target.t[-1]:.0f} s each)')
    say(f'try: forcecal calibrate {folder}/sound -o calibration.yaml')
    say(f'try: forcecal diagnose {folder}/late -o diagnosis')
    return 0


def _rigid_arm(args: argparse.Namespace) -> int:
    from dataclasses import replace
    from importlib.resources import files

    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.mujoco import load_mujoco
    from forcecal_ros.sim.samples import HEAVIER, recorded
    from forcecal_ros.sim.third_party import third_party

    folder = Path(args.output)
    source = files('forcecal_ros') / 'config' / 'examples' / 'rigid_arm.xml'
    model = folder / source.name
    arm = third_party(str(model), load_mujoco(str(source)))
    make_folder(folder)
    write_text(model, source.read_text())
    for i, (name, factors) in enumerate((('sound', {}), ('heavier', HEAVIER))):
        recording = recorded(arm, factors, args.seed + i, motion=args.seed)
        write_recording(folder / name, replace(recording, start_ns=BEGUN))
    say(f'written to {folder}: {source.name}, sound, heavier')
    say(f'try: forcecal diagnose {folder}/heavier --simulated {folder}/sound -o two_bags')
    say(f'try: forcecal diagnose {folder}/heavier --mujoco {model} -o diagnosis')
    return 0


def _insitu(args: argparse.Namespace) -> int:
    from io import StringIO

    from forcecal_ros.sim.samples import LOADS, logs
    import numpy as np
    import yaml

    folder, columns = Path(args.output), ('t', *(f'raw{k}' for k in range(6)), 'ax', 'ay', 'az')
    files = {}
    for name, log in logs(args.seed).items():
        table = StringIO()
        np.savetxt(table, np.column_stack([log.t, log.raw, log.accel]), fmt='%.6g',
                   delimiter=',', header=','.join(columns), comments='')
        files[f'{name}.csv'] = table.getvalue()
    document = {
        'format': 'forcecal-insitu/1', 'time': {'column': 't', 'unit': 's'},
        'accelerometer': {'columns': ['ax', 'ay', 'az']},
        'sensors': {'limb': {'columns': list(columns[1:7]), 'unit': 'counts',
                             'frame': 'limb_ft'}},
        'data_sets': [{'file': f'{name}.csv', 'use': load.use, 'added_mass': load.mass,
                       **({'position': list(load.position)} if load.mass else {})}
                      for name, load in LOADS.items()]}
    files['spec.yaml'] = yaml.safe_dump(document, sort_keys=False)
    write_results(folder, files)
    say(f'written to {folder}: {", ".join(files)}')
    say(f'try: forcecal insitu {folder}/spec.yaml -o limb')
    return 0


def _shaken(args: argparse.Namespace) -> int:
    from dataclasses import replace

    from forcecal_ros.core.streams import PoseStream
    from forcecal_ros.impedance.plant_fit import excitation_commands
    from forcecal_ros.io.bags import write_recording
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import simulate, waits_for_compiler
    import numpy as np

    rig, folder = load_rig(), Path(args.output)
    warn_if_compiling(waits_for_compiler(), 'the simulator')
    R, period = rig.home.R_base_sensor, rig.robot.period
    along_x = excitation_commands(SHAKEN, period, seed=args.seed)
    t = np.arange(len(along_x), dtype=float) * period
    recording = simulate(rig, PoseStream(
        t, rig.home.position + np.outer(along_x, R[:, 0]), np.broadcast_to(R, (len(t), 3, 3))),
        seed=args.seed)
    make_folder(folder)
    write_recording(folder / 'shaken', replace(recording, contact_truth=None, start_ns=BEGUN))
    say(f'written to {folder}: shaken ({t[-1]:.0f} s)')
    say(f'try: forcecal fit-rig {folder}/shaken --for impedance -o plant.yaml')
    return 0


KINDS = {'rig': _rig, 'rigid_arm': _rigid_arm, 'insitu': _insitu, 'shaken': _shaken}
