"""One module a command of ``forcecal``: ``add_parser`` declares it, ``run`` carries it out."""

from typing import NamedTuple


class Command(NamedTuple):
    """The module of a command in this folder, and what the command does, in a line."""

    module: str
    summary: str


GROUPS = {
    'first steps': {
        'demo': Command('demo', 'calibrate a simulated rig over ROS 2 and estimate a contact, '
                                'end to end'),
        'sample': Command('sample', 'make recordings to try the other commands on'),
        'init': Command('init', 'write a commented parameter file for your robot'),
        'check': Command('check', 'show what is in a recording, what it can be used for, and the '
                                  'next command'),
    },
    'calibration': {
        'calibrate': Command('calibrate', 'estimate tool, sensors and noise from a recording, and '
                                          'design the observer'),
        'insitu': Command('insitu', 'estimate matrix and offset of a six-axis sensor in place, '
                                    'from added masses and an accelerometer'),
        'export': Command('export', 'write a calibration in the format of another package'),
        'compare': Command('compare', 'show what changed between two calibrations or diagnoses, '
                                      'in standard errors'),
        'fleet': Command('fleet', 'show what drifted, and what first, in calibrations of many '
                                  'robots over time'),
    },
    'contact force from a recording': {
        'estimate': Command('estimate', 'run the contact-force observer over a recording'),
    },
    'sim-to-real gap': {
        'diagnose': Command('diagnose', 'find where and why simulation and recording differ'),
        'plan': Command('plan', 'plan a motion to record, for a diagnosis or for a calibration'),
        'fit-rig': Command('fit_rig', 'fit a model of your robot to recordings, to simulate, to '
                                      'diagnose, or for impedance control'),
        'simulate': Command('simulate', 'simulate a rig under recorded commands'),
    },
    'recordings': {
        'record': Command('record', 'record live topics; Ctrl-C or --duration ends it'),
        'play': Command('play', 'publish a recording again, with /clock and without commands'),
        'import': Command('import_csv', 'turn CSV tables into a recording'),
    },
    'running nodes': {
        'node': Command('node', 'run a node, without ros2 run'),
        'live': Command('live', 'show running nodes on a web page of this machine'),
        'robot': Command('robot', 'start, abort, preview, save, tare or status of running nodes; '
                                  'the word robot may be left out'),
    },
}
"""By purpose, and by the word on the command line."""

COMMANDS = {name: one for group in GROUPS.values() for name, one in group.items()}
"""By the word on the command line."""

VERBS = ('start', 'abort', 'preview', 'save', 'tare', 'status')
"""Of ``forcecal robot``, which may be left out before them."""
