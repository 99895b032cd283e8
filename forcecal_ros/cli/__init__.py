"""One module a command of ``forcecal``: ``add_parser`` declares it, ``run`` carries it out."""

from typing import NamedTuple


class Command(NamedTuple):
    """The module of a command in this folder, and what the command does, in a line."""

    module: str
    summary: str


GROUPS = {
    'trying out': {
        'demo': Command(
            'demo', 'calibrate a simulated rig over ROS 2 and estimate a contact, end to end'),
        'sample': Command('sample', 'make recordings to try the other commands on'),
    },
    'calibrating': {
        'calibrate': Command(
            'calibrate', 'identify tool, sensors and noise from a recording, and design the '
            'observer by them'),
        'insitu': Command(
            'insitu', 'find matrix and offset of a six-axis sensor in place, from added masses '
            'and an accelerometer'),
        'identify-robot': Command(
            'identify_robot', 'identify how the robot follows commands and how the tool slides, '
            'for impedance control'),
        'compare': Command(
            'compare', 'show what changed between two calibrations or diagnoses, in standard '
            'errors'),
        'export': Command(
            'export', 'write a calibration in the format of another package, with its keys and '
            'signs'),
        'fleet': Command(
            'fleet', 'show what drifted, and what first, of many robots over many nights'),
    },
    'contact force from a recording': {
        'estimate': Command('estimate', 'run the contact-force observer over a recording'),
        'gravity': Command(
            'gravity', 'take weight, inertia and bias off a recorded wrench, and estimate the '
            'bias meanwhile'),
    },
    'gaps between robot and simulation': {
        'plan': Command(
            'plan', 'plan a motion to record: one that shows chosen effects, or a calibration of '
            'least error'),
        'fit-rig': Command(
            'fit_rig', 'make a rig of your robot from recordings of it, to simulate and to '
            'diagnose by'),
        'simulate': Command(
            'simulate', 'simulate the rig under recorded commands and write every sensor topic'),
        'diagnose': Command(
            'diagnose', 'find where and why simulation and recording differ, and how much of the '
            'misfit is explained'),
        'check-simulator': Command(
            'check_simulator', 'check whether your own simulator can be compared with a robot'),
    },
    'contact tasks': {
        'impedance': Command(
            'impedance', 'simulate the contact experiment, and compare what is fed back: raw '
            'sensor, gravity-compensated, observers'),
    },
    'recordings': {
        'record': Command('record', 'record live topics; Ctrl-C or --duration ends it'),
        'play': Command(
            'play', 'replay a recording on live topics, with the recorded time on /clock and '
            'without commands'),
        'import': Command('import_csv', 'turn CSV tables into a recording'),
    },
    'running nodes': {
        'node': Command('node', 'run a node, without ros2 run'),
        'live': Command(
            'live', 'show wrenches, states, phases and gap of running nodes on a page of this '
            'machine'),
        'status': Command('status', 'show in a line each how the running nodes are'),
        'preview': Command('service', 'say what the sequencer would do, without moving'),
        'start': Command('service', 'let the sequencer, or the impedance node, begin its motion'),
        'abort': Command('service', 'stop the motion of the sequencer, or of the impedance node'),
        'save': Command('service', 'let the sequencer write its calibration to the file that its '
                                   'parameter save.path names'),
        'tare': Command(
            'service', 'take the present reading of the observer, at rest, for no load'),
    },
}
"""By what they are for, and by the word on the command line."""

COMMANDS = {name: one for group in GROUPS.values() for name, one in group.items()}
"""By the word on the command line."""
