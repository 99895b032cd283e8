"""The exception tree, and the id of every error that a user can fix.

The command line and the nodes turn a :class:`ForcecalError` into one line on stderr or in the log,
which ends with its id; from Python the message ends with it, too. Anything else that escapes is a
defect of this package. The id follows from where the error was raised, see :data:`KINDS`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import copyreg
from pathlib import Path
import re
from traceback import extract_tb
from types import TracebackType
from typing import Any


class ForcecalError(Exception):
    """
    Base of all errors a user can act on; the message names cause, numbers and remedy.

    Parameters
    ----------
    about : str
        Which of several faults that one function refuses, as :data:`KINDS` names it.
    """

    def __init__(self, message: str = '', about: str = '') -> None:
        super().__init__(message)
        self.about = about

    def __reduce__(self) -> tuple[Any, ...]:
        """Come back from another process as it was, whatever its kind is made from."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class DataError(ForcecalError):
    """A recording, a table or a message stream cannot answer the question."""


class ConfigError(ForcecalError):
    """A configuration value, file or argument is missing, malformed or contradictory."""


class UsageError(ConfigError):
    """The arguments of a command cannot be right for any data: exit status 2."""


class UnobservableError(ForcecalError):
    """The data or the sensors at hand do not determine a quantity that was requested."""


class MotionError(ForcecalError):
    """A motion was refused before it began, or stopped on its way."""


def above(value: float, limit: float, digits: int = 3) -> str:
    """
    Print a value that is above a limit so that it reads above it, and below one below.

    Digits are added until the rounded value is on its side of the limit.
    """
    texts = (f'{value:.{more}g}' for more in range(digits, 18))
    return next(text for text in texts if (float(text) > limit) >= (value > limit)
                and (float(text) < limit) >= (value < limit))


below = above


KINDS: dict[str, str] = {
    # the command line, and what it needs
    'FC0001': 'cli',
    'FC0002':
        'cli.common:check_outputs cli.common:_check_output cli.common:refuse_inputs core.files '
        'io.bags.write',
    'FC0003':
        'ModuleNotFoundError cli.common:needs_ros cli.many:_on_cluster '
        'sim.mujoco:load_mujoco/package nodes.inputs:transform_type nodes.runtime:starting',
    'FC0004': 'OSError report.fleet:refuse sim.mujoco:load_mujoco/file',
    'FC0005': 'cli.robot nodes.client nodes.demo nodes.live',
    'FC0006': 'cli.play nodes.bags',
    'FC0007': 'cli.record nodes.collector',
    # files
    'FC0101': 'core.safe_yaml',
    'FC0102': 'core core.schema calibrate.settings observe.settings',
    'FC0103': 'io.calibration_file core.sensor_matrix results:_of/Calibration',
    'FC0104': 'effects sim.rig.plant',
    'FC0105': 'insitu.spec insitu.sources',
    'FC0106': 'io.csv_import.specification io.csv_import.assemble',
    'FC0107': 'io.csv_import.table',
    'FC0108': 'io.csv_import.assemble:refuse_other_reading',
    'FC0109': 'io.urdf io.transforms io.bags.poses observe.pose_sources nodes.inputs',
    'FC0110': 'io.exports',
    'FC0111': 'diagnose.result report',
    # what a recording holds
    'FC0201': 'io io.bags.storage io.bags.files results:_of/Recording',
    'FC0202':
        'core.topics io.bags.read io.bags.series cli.estimate:_needs_imu rig_fit.fit:_required',
    'FC0203': 'io.bags.header_stamps io.bags.messages',
    'FC0204':
        'calibrate.joint:require_overlap checks.hypotheses:candidates core.streams '
        'diagnose.dataset diagnose.recordings diagnose.sources.rig calibrate.pipeline:fit_motion',
    # single signals
    'FC0301': 'checks.entry',
    'FC0302': 'checks.signals:readable checks.hypotheses:_refuse_counts',
    'FC0303':
        'checks.signals:refuse_dead checks.signals:refuse_stuck insitu.reduce '
        'insitu.calibrate:_require_alive',
    'FC0304': 'checks.signals:refuse_wrapped calibrate.poses:refuse_poses_at_a_limit',
    'FC0305': 'checks.signals:refuse_apart checks.hypotheses:refuse_late_accelerometer',
    'FC0306': 'checks.signals:refuse_frozen_pose',
    'FC0307':
        'checks.signals:refuse_other_pace checks.signals:_refuse_other_speed '
        'checks.signals:refuse_degrees_a_second checks.hypotheses:_other_time '
        'io.bags.poses:refuse_degrees',
    'FC0308': 'checks.gravity insitu.offset:norm',
    # the recording against a rigid weight
    'FC0400': 'checks',
    'FC0401': 'checks.hypotheses:judge/sign calibrate.tool:refuse_negative',
    'FC0402': 'checks.hypotheses:judge/base',
    'FC0403': 'checks.hypotheses:judge/inverted checks.hypotheses:judge/wxyz',
    'FC0404': 'checks.hypotheses:judge/rotated',
    'FC0405':
        'checks.hypotheses:judge/mirrored checks.hypotheses:judge/force '
        'checks.hypotheses:judge/torque checks.hypotheses:judge/exchanged '
        'checks.hypotheses:judge/crosstalk',
    'FC0406': 'checks.hypotheses:judge/tilted',
    'FC0407': 'checks.hypotheses:judge/clock',
    'FC0408': 'checks.hypotheses:judge/smoothed checks.hypotheses:judge/zeroed',
    'FC0409':
        'checks.hypotheses:judge/bias checks.hypotheses:judge/load '
        'checks.hypotheses:judge/vertical',
    'FC0410': 'checks.messages:refuse_weightless checks.messages:refuse_unexplained',
    'FC0411': 'checks.hypotheses:refuse_other_mass checks.hypotheses:_other_tool',
    'FC0412': 'checks.hypotheses:_other_point',
    'FC0413': 'checks.gravity:refuse_on_another_link rig_fit.fit:_with_accelerometer',
    # calibration
    'FC0501': 'calibrate.joint:require_rotation calibrate.tool calibrate.accelerometer',
    'FC0502': 'calibrate calibrate.joint:require_tool checks.hypotheses:judge/cable',
    'FC0503': 'calibrate.delay calibrate.paper',
    'FC0504': 'calibrate.poses core.noise.autocovariance',
    'FC0505': 'calibrate.gain observe.bandwidth observe.bias_filter observe.playback:white_noise',
    'FC0506': 'calibrate.ringing checks.signals:refuse_far_displacement',
    # observer
    'FC0601':
        'observe observe.design nodes.observer nodes.observer_outputs',
    'FC0602':
        'observe.playback:replay observe.playback:follow observe.playback:_replay_pose_free '
        'cli.estimate:_tool_figures',
    'FC0603': 'observe.live nodes.observer:_tare',
    'FC0604': 'observe.frames sim.measured_motion',
    'FC0605': 'nodes.messages',
    # motion
    'FC0701': 'motion sim.rig.simulator diagnose.plan',
    'FC0702': 'motion.monitor',
    'FC0703': 'motion.sequence nodes.motion_node nodes.sequencer impedance.session',
    'FC0704': 'nodes.backends',
    'FC0705':
        'nodes nodes.sequencer:_joint_vectors motion.profiles:read_poses motion.profiles:reach_of '
        'motion.optimal_design:sensors_of motion.optimal_design:_density',
    'FC0706': 'impedance',
    # diagnosis
    'FC0801':
        'results diagnose diagnose.recordings:require_commands '
        'diagnose.recordings:estimate_start diagnose.sources.simulator',
    'FC0802':
        'diagnose.sources.pair diagnose.sources.simulated_tool '
        'diagnose.recordings:require_same_sensors '
        'diagnose.recordings:apply_accelerometer_calibration',
    'FC0803':
        'diagnose.recordings:bridge_pauses diagnose.recordings:refuse_sparse_commands rig_fit',
    'FC0804': 'sim sim.third_party sim.rerun',
    'FC0805': 'sim.mujoco sim.mujoco_numbers',
    'FC0806': 'diagnose.judge.coverage',
    # in situ
    'FC0901': 'insitu.fit insitu.equations insitu.offset insitu.calibrate insitu.result',
    'FC0902': 'insitu',
    'FC0990': '',
}
"""
Id -> where errors of that kind are raised, with spaces between: ``module``, ``module:function`` or
``module:function/about`` of this package, or the name of a class. The longest that fits counts.
docs/reference/errors.md explains each id; none is ever used again for another kind.
"""

_PACKAGE = Path(__file__).resolve().parents[1]
_ID = re.compile(r'\[FC\d{4}\]$')


def id_of(error: BaseException) -> str:
    """Return the id of an error, by the innermost function that refused something."""
    while isinstance(error.__cause__, ForcecalError):
        error = error.__cause__
    places: Iterator[str] = (one.__name__ for one in type(error).__mro__)
    if isinstance(error, ForcecalError):
        places = _places(error.__traceback__, error.about.partition(' ')[0])
    return next((_ID_AT[place] for place in places if place in _ID_AT), _ID_AT[''])


def with_id(error: BaseException, message: str = '') -> str:
    """Return the message of an error in one line that ends with its id."""
    line = ' '.join((message or str(error)).split())
    return line if _ID.search(line) else f'{line} [{id_of(error)}]'


@contextmanager
def error_ids() -> Iterator[None]:
    """Let the errors of a function end with their id, as those of the commands do."""
    try:
        yield
    except ForcecalError as error:
        error.args = (with_id(error),)
        raise


def _places(at: TracebackType | None, about: str) -> Iterator[str]:
    """Yield where an error passed, from the innermost function on, and the packages around it."""
    for frame in reversed(extract_tb(at)):
        path = Path(frame.filename)
        if path.is_relative_to(_PACKAGE):
            parts = path.relative_to(_PACKAGE).with_suffix('').parts
            function = f'{".".join(parts)}:{frame.name}'
            yield from (f'{function}/{about}', function)
            yield from ('.'.join(parts[:n]) for n in range(len(parts), 0, -1))


_ID_AT = {place: id_ for id_, places in KINDS.items() for place in places.split(' ')}
