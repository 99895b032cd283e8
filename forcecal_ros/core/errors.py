"""The exception tree, and the id of every error that a user can fix.

The command line and the nodes turn a :class:`ForcecalError` into one line on stderr or in the log,
which ends with its id; anything else that escapes is a defect of this package. The id follows from
where the error was raised, see :data:`KINDS`.
"""

from collections.abc import Iterator
from pathlib import Path
import re
from types import TracebackType
from typing import NamedTuple


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
    Print a value that is above a limit so that it reads above it.

    Digits are added until the rounded value is on its side of the limit.
    """
    texts = (f'{value:.{more}g}' for more in range(digits, 18))
    return next(text for text in texts if not value > limit or float(text) > limit)


def below(value: float, limit: float, digits: int = 3) -> str:
    """Print a value that is below a limit so that it reads below it; see :func:`above`."""
    texts = (f'{value:.{more}g}' for more in range(digits, 18))
    return next(text for text in texts if not value < limit or float(text) < limit)


class Kind(NamedTuple):
    """
    One kind of error.

    Attributes
    ----------
    id : str
        Ends each message of this kind.
    what, why, fix : str
        What is wrong, why it matters, and what to do; sentences of the reference page.
    places : str
        Where it is raised: ``module``, ``module:function`` or ``module:function/about`` of this
        package, or the name of a class, with spaces between them. The longest that fits counts.
    """

    id: str
    what: str
    why: str
    fix: str
    places: str


KINDS = (
    # the command line, and what it needs
    Kind('FC0001', 'The arguments cannot be right for any data',
         'Options exclude or require each other, or a word is unknown.',
         'Follow the message; `forcecal COMMAND --help` lists the options.', 'cli'),
    Kind('FC0002', 'The result cannot be written there',
         'The place is an input, an existing file of another kind, or not writable.',
         'Name another file or folder with `-o`.', 'cli.outputs core.files io.bags.write'),
    Kind('FC0003', 'A package is not installed',
         'Some commands need ROS 2, MuJoCo, Dask or `tf2_msgs`.',
         'Run the command that the message prints.',
         'ModuleNotFoundError cli.common:needs_ros cli.many:_on_cluster sim.mujoco:load_mujoco '
         'nodes.inputs:transform_type nodes.runtime:starting'),
    Kind('FC0004', 'The operating system refused a file',
         'The file does not exist, its permissions are too narrow, or the disk is full.',
         'Correct the path, the permissions or the space.', 'OSError fleet.history:refuse'),
    Kind('FC0005', 'A node does not answer',
         'It is not running, or it is in another domain or namespace.',
         'Start it with the same `ROS_DOMAIN_ID`, and state `--namespace`.',
         'cli.robot nodes.client nodes.demo nodes.live'),
    Kind('FC0006', 'A recording is not played',
         'No message is left to publish, or a robot would follow recorded commands.',
         'Change `--start` or `--only`; `--yes` publishes commands on purpose.',
         'cli.play nodes.bags'),
    Kind('FC0007', 'No message arrived', 'A topic has another name, or another domain is used.',
         'Compare with `ros2 topic list`, and record again.', 'cli.record nodes.collector'),
    # files
    Kind('FC0101', 'A file is not plain YAML',
         'Aliases, tags, binary data and large files are refused for safety.',
         'Write plain keys and values.', 'core.safe_yaml'),
    Kind('FC0102', 'A value has the wrong form or is out of range',
         'A number, unit, word or length differs from what the key requires.',
         'Correct the key that the message names.',
         'core core.schema calibrate.settings observe.settings'),
    Kind('FC0103', 'A calibration file cannot be used',
         'It is damaged, edited, too old, or another kind of file.',
         'Calibrate again, or name another file.',
         'io.calibration_file core.sensor_matrix'),
    Kind('FC0104', 'A rig file is inconsistent',
         'The simulation of it would be unstable, or an effect has no sensor to act on.',
         'Correct the key that the message names.',
         'effects sim.rig.plant'),
    Kind('FC0105', 'An in-situ specification is inconsistent',
         'Data sets, masses, units and columns must fit together.',
         'Correct the entry; `forcecal sample insitu` writes an example.',
         'insitu.spec insitu.sources'),
    Kind('FC0106', 'An import specification is inconsistent',
         'Each column has one meaning, one unit and one time.',
         'Correct the entry, see [CSV](../how-to/csv.md).',
         'io.csv_import.specification io.csv_import.assemble'),
    Kind('FC0107', 'A table cannot be read',
         'A column is missing, a cell is not a number, or times do not increase.',
         'Correct the table, or name other columns.', 'io.csv_import.table'),
    Kind('FC0108', 'Values of a table contradict their unit',
         'Wrong units give a wrong calibration that looks right.',
         'State the unit that the message proposes.', 'io.csv_import.plausibility'),
    Kind('FC0109', 'A URDF or a frame cannot be used',
         'Without a chain of frames there is no pose of the sensor.',
         'Name two connected frames, see [pose sources](../how-to/pose-sources.md).',
         'io.urdf io.transforms io.bags.poses observe.pose_sources nodes.inputs'),
    Kind('FC0110', 'A calibration cannot be exported to this consumer',
         'The other package has no setting for it, so its result would be wrong.',
         'Give it `observer/contact_wrench` instead.', 'io.exports'),
    Kind('FC0111', 'A result of an earlier command cannot be read',
         'The folder is empty, or the file is damaged or of another version.',
         'Name another one, or compute it again.',
         'diagnose.result fleet'),
    # what a recording holds
    Kind('FC0201', 'This is not a readable recording',
         'It is empty, damaged, a ROS 1 bag, or another kind of file.',
         'Name the folder of a rosbag2 (mcap or sqlite3).', 'io io.bags.storage io.bags.files'),
    Kind('FC0202', 'A topic is missing or ambiguous',
         'The command needs it, and cannot guess its name.',
         'State `--topic role=NAME` or `--preset NAME`; `forcecal check BAG` lists the topics.',
         'core.topics io.bags.read io.bags.series cli.estimate:_needs_imu rig_fit.fit:_required'),
    Kind('FC0203', 'Stamps cannot be used',
         'They are in the wrong unit, do not increase, or come from two senders.',
         'Stamp in the driver, in nanoseconds of one clock.',
         'io.bags.header_stamps io.bags.messages'),
    Kind('FC0204', 'The recording is too short, or its streams do not overlap',
         'Some seconds with all streams are required.',
         'Record all topics together for 15 s or more.',
         'calibrate.joint:require_overlap checks.hypotheses:candidates core.streams '
         'diagnose.dataset diagnose.recordings diagnose.sources.rig '
         'calibrate.pipeline:fit_motion'),
    # single signals
    Kind('FC0301', 'A stream is empty', 'Its driver was not running, or the name is wrong.',
         'Start the driver, and record again.', 'checks.entry'),
    Kind('FC0302', 'Readings are raw counts or not finite',
         'A converter without a scale, or an error code of the driver.',
         'Scale in the driver, and drop invalid readings.',
         'checks.signals:note checks.hypotheses:_refuse_counts'),
    Kind('FC0303', 'A channel is dead or stuck',
         'A constant channel gives a wrong tool without any residual.',
         'Check the cable and the driver, and record again.',
         'checks.signals:refuse_dead checks.signals:refuse_stuck insitu.reduce '
         'insitu.calibrate:_require_alive'),
    Kind('FC0304', 'A channel leaves its range',
         'Clipped or wrapped readings shift every estimate.',
         'Use a sensor or a setting with a larger range.',
         'checks.signals:refuse_wrapped calibrate.requirements:refuse_poses_at_a_limit'),
    Kind('FC0305', 'Clocks of streams differ',
         'A wrench is then compared with another pose.',
         'Synchronise the computers (PTP or chrony).',
         'checks.signals:refuse_apart checks.hypotheses:refuse_late_accelerometer'),
    Kind('FC0306', 'The pose stops while the robot moves',
         'A wrench is then compared with another pose.',
         'Check the driver that publishes the pose.', 'checks.signals:refuse_frozen_pose'),
    Kind('FC0307', 'A rate, a speed or a length has another unit',
         'Stamps in ms, positions in mm and rates in deg/s look like faster motion.',
         'Publish SI units.',
         'checks.signals:refuse_other_pace checks.signals:_refuse_other_speed '
         'checks.signals:refuse_degrees_a_second checks.hypotheses:_other_time '
         'io.bags.poses:refuse_degrees'),
    Kind('FC0308', 'The accelerometer does not show gravity as its type states',
         'It is in g, AC-coupled, without gravity, or has another gain.',
         'Publish specific force in m/s^2 (REP-145), or state `--coupling ac`.',
         'checks.accelerometer checks.calibrated insitu.offset:norm'),
    # the recording against a rigid weight
    Kind('FC0400', 'The recording contradicts itself',
         'A calibration from it would be wrong.', 'Follow the message.', 'checks'),
    Kind('FC0401', 'The wrench has the opposite sign',
         'The driver reports the force of the tool on its environment.',
         'Set `wrench.sign` or `--wrench-sign`.',
         'checks.hypotheses:judge/sign calibrate.static_readings:refuse_negative '
         'calibrate.pipeline:identify'),
    Kind('FC0402', 'The wrench is expressed in the base frame',
         'The weight does not rotate, so that no tool can be identified.',
         'Publish in the frame of the sensor, see [base frame](../how-to/base-frame.md).',
         'checks.hypotheses:judge/base'),
    Kind('FC0403', 'The pose is inverted, or its quaternion begins with w',
         'Gravity then rotates the wrong way.', 'Publish the sensor in the base, x y z w.',
         'checks.hypotheses:judge/inverted checks.hypotheses:judge/wxyz'),
    Kind('FC0404', 'The axes of the wrench are rotated against the pose',
         'Gravity would be removed along wrong axes.',
         'State the rotation that the message prints (`--sensor-rotation`).',
         'checks.hypotheses:judge/rotated'),
    Kind('FC0405', 'The axes of the wrench are mirrored, or those of the torques differ',
         'No rotation explains them.', 'Correct order and signs in the driver.',
         'checks.hypotheses:judge/mirrored checks.hypotheses:judge/force '
         'checks.hypotheses:judge/torque checks.hypotheses:judge/exchanged'),
    Kind('FC0406', 'The base is not level',
         'Gravity has another direction in the base than stated.',
         'State `--gravity-direction`.', 'checks.hypotheses:judge/tilted'),
    Kind('FC0407', 'Wrench and pose are of different times',
         'Their clocks differ by more than a delay.',
         'Synchronise the clocks (PTP or chrony), and record again.',
         'checks.hypotheses:judge/clock'),
    Kind('FC0408', 'The driver smooths or zeroes the wrench',
         'Contacts are smoothed too, or the weight is removed.',
         'Switch the filter or the automatic tare off.',
         'checks.hypotheses:judge/smoothed checks.hypotheses:judge/zeroed'),
    Kind('FC0409', 'Bias, load or base changed during the recording',
         'One tool cannot explain both parts.', 'Use either part alone.',
         'checks.hypotheses:judge/bias checks.hypotheses:judge/load '
         'checks.hypotheses:judge/vertical'),
    Kind('FC0410', 'The wrench does not contain the weight of a tool',
         'The driver or the robot controller removed it, or nothing is mounted.',
         "Record the sensor's own readings; set the payload of the controller to zero.",
         'checks.messages:refuse_weightless checks.messages:refuse_unexplained'),
    Kind('FC0411', 'The forces belong to another mass',
         'Their unit is not newton, or another tool was mounted.',
         'State the unit in the driver, or calibrate that tool.',
         'checks.hypotheses:refuse_other_mass checks.hypotheses:_other_tool'),
    Kind('FC0412', 'The torques are about another point or in another unit',
         'Two estimates of the centre of mass differ.',
         'Correct unit, sign or point in the driver.', 'checks.hypotheses:_other_point'),
    Kind('FC0413', 'The accelerometer is on another link',
         'Its gravity does not rotate like the pose.',
         'Mount it on the tool, or leave it out.',
         'checks.accelerometer:refuse_on_another_link rig_fit.fit:_with_accelerometer'),
    # calibration
    Kind('FC0501', 'The sensor rotates too little',
         'Mass, centre of mass and biases are separated by gravity in several directions.',
         'Rotate the wrist by 60 deg or more about two axes.',
         'calibrate.joint:require_rotation calibrate.static_readings calibrate.tool '
         'calibrate.accelerometer'),
    Kind('FC0502', 'The forces are not those of a rigid tool',
         'A hand, a cable or a contact acts for much of the recording.',
         'Record free motion with the tool fixed.',
         'calibrate calibrate.joint:require_tool calibrate.requirements'),
    Kind('FC0503', 'The delay between the sensors is not identifiable',
         'It shows in fast motion only.', 'Add brisk moves, or `--free-motion BAG2`.',
         'calibrate.delay calibrate.paper'),
    Kind('FC0504', 'A static pose cannot be used',
         'Poses need a rest, a wrench and a current pose in phases `measure`.',
         'Hold each pose for a second, and record throughout.',
         'calibrate.poses calibrate.means core.noise.autocovariance'),
    Kind('FC0505', 'The observer gain cannot be computed',
         'The noise levels contradict each other or are missing.',
         'Check units; calibrate with a second of rest.',
         'calibrate.gain observe.bandwidth observe.bias_filter observe.playback:white_noise'),
    Kind('FC0506', 'The compliant axis is inconsistent',
         'The tool would slide against its load.',
         'Turn the sign of the topic `optidrive`, and state metres.',
         'calibrate.statics checks.signals:refuse_far_displacement'),
    # observer
    Kind('FC0601', 'The calibration does not suit the observer',
         'A value is missing, or a sensor has another unit than calibrated.',
         'Calibrate again with the sensors in use.',
         'observe observe.design '
         'nodes.observer nodes.observer_settings nodes.observer_outputs'),
    Kind('FC0602', 'The direction of gravity is unknown',
         'Neither pose nor IMU shows it, so that weight cannot be removed.',
         'Record a pose, or an IMU with angular rate.',
         'observe.playback:replay observe.playback:follow observe.playback:_replay_pose_free '
         'cli.estimate:_tool_figures'),
    Kind('FC0603', 'The tare was refused',
         'The robot moves or touches something, or readings are invalid.',
         'Stop the robot without contact, and call it again.',
         'observe.live nodes.observer:_tare'),
    Kind('FC0604', 'Frames of the sensor contradict each other',
         'The contact wrench would be in a wrong frame.',
         'State the same `sensor.from_pose` everywhere.', 'observe.frames sim.measured_motion'),
    Kind('FC0605', 'A payload on `observer/tool` was refused',
         'It has no physical inertia, or is given in another frame.',
         'Publish mass, centre of mass and inertia in `ft_sensor`.', 'nodes.messages'),
    # motion
    Kind('FC0701', 'A planned motion exceeds a limit',
         'Nothing moves unless the whole plan is within the limits.',
         'Change the pose, the pace or the limit that the message names.',
         'motion sim.rig.simulator diagnose.plan'),
    Kind('FC0702', 'A sensor is not ready for motion',
         'Without fresh readings at rest a contact would not be detected.',
         'Start the driver, wait at rest, and start again.', 'motion.monitor'),
    Kind('FC0703', 'The sequencer does not start now',
         'A motion is active, another node commands, or the preview is out of date.',
         'Abort the motion, or call the preview again.',
         'motion.sequence nodes.motion_node nodes.sequencer impedance.session'),
    Kind('FC0704', 'The commands do not fit the controller',
         'Frame, joints or backend differ.', 'Set `motion.frame`, `joints.names` or the preset.',
         'nodes.backends'),
    Kind('FC0705', 'A parameter of a node is wrong',
         'Unknown names and values out of range are refused at the start.',
         'Correct it; `forcecal init` writes a complete file.',
         'nodes motion.profiles:read_poses motion.profiles:reach_of '
         'motion.optimal_design:sensors_of motion.optimal_design:_density'),
    Kind('FC0706', 'The impedance loop would be unstable, or its plant is not identified',
         'It would oscillate against a wall.',
         'Change impedance or effort; shake the tool along x for longer.', 'impedance'),
    # diagnosis
    Kind('FC0801', 'There is nothing to compare the recording with',
         'A diagnosis needs commands or poses, and a model.',
         'Give `--rig`, `--calibration`, `--simulated` or `--mujoco`.',
         'api cli.diagnose:_require_simulated_rig diagnose diagnose.recordings:_require_commands '
         'diagnose.recordings:estimate_start diagnose.sources.simulator'),
    Kind('FC0802', 'Robot and simulation recorded different things',
         'Only the same motion, sensors and frames can be compared.',
         'Record the same topics of the same motion on both sides.',
         'diagnose.sources.pair diagnose.sources.simulated_tool '
         'diagnose.recordings:require_same_sensors '
         'diagnose.recordings:apply_accelerometer_calibration'),
    Kind('FC0803', 'Commands or pauses of the recording cannot be bridged',
         'Setpoints between sparse records cannot be reconstructed.',
         'Log commands at the control rate, or give `--calibration`.',
         'diagnose.recordings:bridge_pauses diagnose.recordings:refuse_sparse_commands '
         'rig_fit'),
    Kind('FC0804', 'The simulator broke its protocol',
         'Results would depend on the defect.',
         'Correct the method that the message names, see '
         '[own simulator](../how-to/own-simulator.md).',
         'sim sim.third_party sim.runs'),
    Kind('FC0805', 'The MuJoCo model cannot follow the recording',
         'Joints, sites, actuators or the time step do not fit.',
         'Change the model as the message states, see [MuJoCo](../how-to/mujoco.md).',
         'sim.mujoco sim.mujoco_numbers'),
    Kind('FC0806', 'The noise cannot be estimated',
         'Without it no residual can be judged.', 'Record some seconds at a steady rate.',
         'diagnose.judge.coverage'),
    # in situ
    Kind('FC0901', 'The data do not determine the matrix',
         'Each unknown needs a mass, a place or a rotation that shows it.',
         'Add the masses or rotations that the message names.',
         'insitu.fit insitu.loads insitu.offset insitu.calibrate insitu.result'),
    Kind('FC0902', 'A data set cannot be used',
         'It is too short, touches something, or lacks samples.',
         'Record it again, a minute or longer.',
         'insitu'),
    Kind('FC0990', 'Code outside this package refused the data',
         'A simulator of yours may raise the same errors.', 'Follow its message.', ''),
)
"""All kinds; ids are never used again for another kind."""

_PACKAGE = Path(__file__).resolve().parents[1]
_ID = re.compile(r'\[FC\d{4}\]$')


def kind_of(error: BaseException) -> Kind:
    """Return the kind of an error, by the innermost function that refused something."""
    while isinstance(error.__cause__, ForcecalError):
        error = error.__cause__
    places: Iterator[str] = (one.__name__ for one in type(error).__mro__)
    if isinstance(error, ForcecalError):
        places = _places(error.__traceback__, error.about.partition(' ')[0])
    return next((_KIND_AT[place] for place in places if place in _KIND_AT), _KIND_AT[''])


def with_id(error: BaseException, message: str = '') -> str:
    """Return the message of an error in one line that ends with its id."""
    line = ' '.join((message or str(error)).split())
    return line if _ID.search(line) else f'{line} [{kind_of(error).id}]'


def _places(at: TracebackType | None, about: str) -> Iterator[str]:
    """Yield where an error passed, from the innermost function on, and the packages around it."""
    frames = []
    while at is not None:
        path = Path(at.tb_frame.f_code.co_filename)
        if path.is_relative_to(_PACKAGE):
            module = '.'.join(path.relative_to(_PACKAGE).with_suffix('').parts)
            frames.append((module, at.tb_frame.f_code.co_name))
        at = at.tb_next
    for module, function in reversed(frames):
        yield from (f'{module}:{function}/{about}', f'{module}:{function}')
        parts = module.split('.')
        yield from ('.'.join(parts[:n]) for n in range(len(parts), 0, -1))


_KIND_AT = {place: kind for kind in KINDS for place in kind.places.split(' ')}
