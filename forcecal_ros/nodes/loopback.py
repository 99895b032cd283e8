"""Keep nodes that stand in for a robot to this machine."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
import os
import random


def only_this_machine() -> dict[str, str]:
    """
    Return environment variables that keep a process' DDS traffic on the loopback interface.

    With Fast DDS, Jazzy's own, messages go over UDP and never through shared memory, where each
    process of the machine, of whatever domain, waits at locks that a killed one never releases.
    Its profile alone has to say so: ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` would bring
    shared memory back. Its buffers hold some tenths of a second of topics at 1 kHz, as far as the
    system grants them. Any other middleware is told LOCALHOST.

    Returns
    -------
    dict of str to str
    """
    if os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps'):
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                'FASTRTPS_DEFAULT_PROFILES_FILE': str(files(__package__) / 'loopback.xml')}
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


@contextmanager
def own_domain() -> Iterator[dict[str, str]]:
    """
    Take this process to a DDS domain of this machine only, where no robot listens.

    A ROS_DOMAIN_ID of the user is kept.

    Yields
    ------
    dict
        Environment variables for child processes.
    """
    domain = os.environ.get('ROS_DOMAIN_ID') or str(random.randint(1, 101))
    environment = {'ROS_DOMAIN_ID': domain, **only_this_machine()}
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        yield environment
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
