"""One module a command of ``forcecal``: ``add_parser`` declares it, ``run`` carries it out."""

GROUPS = {
    'first steps': {
        'demo': 'calibrate a simulated rig over ROS 2 and estimate a contact, end to end',
        'sample': 'write sample recordings to try the other commands',
        'init': 'write a commented parameter file for your robot',
        'check': 'show what is in a recording, what it can be used for, and the next command',
    },
    'calibration': {
        'calibrate': 'estimate tool, sensors and noise from a recording, and design the observer',
        'insitu': 'estimate matrix and offset of a six-axis sensor in place, from added masses '
                  'and an accelerometer',
        'export': 'write a calibration in the format of another package',
        'compare': 'show what changed between two calibrations or diagnoses, beyond chance',
        'fleet': 'find drifts, and which came first, in calibrations of many robots over time',
    },
    'contact force from a recording': {
        'estimate': 'run the contact-force observer over a recording',
    },
    'sim-to-real gap': {
        'diagnose': 'find where and why simulation and recording differ',
        'plan': 'plan a motion to record, for a diagnosis or for a calibration',
        'fit-rig': 'fit a model of your robot to recordings, for simulation, diagnosis or '
                   'impedance control',
        'simulate': 'simulate a rig under recorded commands',
    },
    'recordings': {
        'record': 'record live topics; Ctrl-C or --duration ends it',
        'play': 'publish a recording again, with /clock and without commands',
        'import': 'convert CSV tables to a recording',
    },
    'running nodes': {
        'node': 'run a node, without ros2 run',
        'live': 'show running nodes on a web page of this machine',
        'robot': 'start, abort, preview, save, tare or status of running nodes; the word robot '
                 'may be omitted',
    },
}
"""What each command does, by purpose and by the word on the command line."""

COMMANDS = {name: one for group in GROUPS.values() for name, one in group.items()}
"""What each command does, by the word on the command line."""

VERBS = ('start', 'abort', 'preview', 'save', 'tare', 'status')
"""Of ``forcecal robot``, which may be left out before them."""
