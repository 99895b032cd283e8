"""One module a command of ``forcecal``: ``add_parser`` declares it, ``run`` carries it out."""

from typing import NamedTuple


class Command(NamedTuple):
    """The module of a command in this folder, and what the command does, in a line."""

    module: str
    summary: str


COMMANDS = {
    'demo': Command(
        'demo', 'calibrate a simulated rig over ROS 2 and estimate a contact, end to end'),
    'sample': Command('sample', 'make recordings to try the other commands on'),
    'calibrate': Command(
        'calibrate', 'identify tool, accelerometer and noise from a recording, design the '
        'observer'),
    'estimate': Command('estimate', 'run the contact-force observer over a recording'),
    'export': Command(
        'export', 'write a calibration in the format of another package, with its keys and '
        'signs'),
    'compare': Command(
        'compare', 'show what changed between two calibrations or diagnoses, in standard errors'),
    'fleet': Command(
        'fleet', 'show what drifted, and what first, of many robots over many nights'),
    'simulate': Command(
        'simulate', 'simulate the rig under recorded commands and write every sensor topic'),
    'fit-rig': Command(
        'fit_rig', 'make a rig of your robot from recordings of it, to simulate and to diagnose '
        'by'),
    'check-simulator': Command(
        'check_simulator', 'try whether your own simulator can be compared with a robot'),
    'identify-robot': Command(
        'identify_robot', 'identify, for impedance control, how the robot follows commands and '
        'how the tool slides'),
    'diagnose': Command(
        'diagnose', 'find where and why simulation and recording differ, and how much of the '
        'misfit is explained'),
    'plan': Command(
        'plan', 'plan a sequence for the sequencer: an optimally designed calibration, or a '
        'recording that excites chosen effects'),
    'insitu': Command('insitu', 'calibrate six-axis sensors in situ with an accelerometer'),
    'gravity': Command('gravity', 'remove weight, inertia and bias from a recorded wrench'),
    'impedance': Command(
        'impedance', 'simulate the contact experiment: compares four ways of feeding force back'),
    'import': Command('import_csv', 'turn CSV tables into a recording'),
    'record': Command('record', 'record live topics; Ctrl-C or --duration ends it'),
    'play': Command(
        'play', 'replay a recording on live topics, with the recorded time on /clock and without '
        'commands'),
    'start': Command('service', 'let the sequencer, or the impedance node, begin its motion'),
    'abort': Command('service', 'stop that motion'),
    'preview': Command('service', 'say what the sequencer would do, without moving'),
    'save': Command('service', 'let the sequencer write its calibration to save.path'),
    'tare': Command('service', 'take the present reading of the observer, at rest, for no load'),
    'live': Command('live', 'show wrenches, states, phases and gap of running nodes on a page of '
                    'this machine'),
    'status': Command('status', 'show in a line each how the running nodes are'),
}
"""By the word on the command line."""
