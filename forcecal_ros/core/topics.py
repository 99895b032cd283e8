"""The topics of this package: role, usual name, message type; and what a command must have."""

from collections.abc import Collection, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
import re
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.safe_yaml import load_yaml
from forcecal_ros.core.streams import Recording

WRENCH = 'geometry_msgs/msg/WrenchStamped'
POSE = 'geometry_msgs/msg/PoseStamped'
VECTOR3 = 'geometry_msgs/msg/Vector3Stamped'
ACCEL = 'geometry_msgs/msg/AccelStamped'
TWIST = 'geometry_msgs/msg/TwistStamped'
INERTIA = 'geometry_msgs/msg/InertiaStamped'
IMU = 'sensor_msgs/msg/Imu'
JOINT_STATE = 'sensor_msgs/msg/JointState'
JOINT_POSE = 'urdf:FILE:BASE:LINK'
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
STRING = 'std_msgs/msg/String'
MULTI_ARRAY = 'std_msgs/msg/Float64MultiArray'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
CONTROLLER_STATE = 'control_msgs/msg/JointTrajectoryControllerState'


class Role(NamedTuple):
    """What a topic is for: its usual relative name, and the types it may have."""

    topic: str
    types: tuple[str, ...]
    latched: bool = False


ROLES: Mapping[str, Role] = {
    'wrench': Role('wrench', (WRENCH,)),
    'accelerometer': Role('accelerometer/raw', (VECTOR3, IMU, ACCEL)),
    'imu': Role('imu/data_raw', (IMU,)),
    'accel': Role('accel', (ACCEL,)),
    'pose': Role('current_pose', (POSE,)),
    'target': Role('target_frame', (POSE,)),
    'joint_commands': Role('joint_commands', (JOINT_STATE, CONTROLLER_STATE, MULTI_ARRAY)),
    'joint_states': Role('joint_states', (JOINT_STATE,)),
    'optidrive': Role('optidrive', (JOINT_STATE,)),
    'contact_truth': Role('sim/contact_wrench', (WRENCH,)),
    'contact_wrench': Role('observer/contact_wrench', (WRENCH,)),
    'inertial_wrench': Role('observer/inertial_wrench', (WRENCH,)),
    'innovation': Role('observer/innovation', (WRENCH,)),
    'tool': Role('observer/tool', (INERTIA,), latched=True),
    'status': Role('observer/status', (DIAGNOSTICS,)),
    'phase': Role('sequencer/phase', (DIAGNOSTICS,)),
    'calibration': Role('sequencer/calibration', (STRING,), latched=True),
    'observer_gain': Role('sequencer/observer_gain', (MULTI_ARRAY,), latched=True),
    'tool_inertia': Role('sequencer/tool_inertia', (INERTIA,), latched=True),
}
"""Role -> topic, as nodes publish it and recordings hold it."""

MAIN_ROLES = ('wrench', 'pose', 'accelerometer')
"""Roles that a user is shown topics for, if they have none."""

_COMMANDS = re.compile(
    r'(^|[/_])(cmds?|commands?|goals?|jog|references?|setpoints?|targets?)([/_]|$)')
"""Names that drivers and controllers give to what they obey, target_frame among them."""

_OUTPUTS = re.compile(r'(^|/)((observer|sequencer|impedance)/\w+|diagnostics)$')


class Topic(NamedTuple):
    """One topic of a recording; ``definition`` is the text of its message type, or empty."""

    name: str
    type: str
    definition: str = ''

    @property
    def is_command(self) -> bool:
        """Whether a robot may move by it, by its type or else by its name."""
        return self.type == TRAJECTORY or _COMMANDS.search(self.name.lower()) is not None

    @property
    def is_output(self) -> bool:
        """Whether nodes of this package say it, and others, running now, may say it as well."""
        return _OUTPUTS.search(self.name) is not None


def find_topics(
        available: Collection[Topic], names: Mapping[str, str],
        roles: Collection[str]) -> tuple[dict[str, Topic], list[str]]:
    """
    Find the topic of each role, in any one namespace.

    A name the caller gives must be there with a type that fits. Otherwise the usual name is
    looked for: as it is, then in the namespace of the names given, then in any namespace.

    Parameters
    ----------
    names : mapping of str to str
        Role to topic, where it is not the usual one.
    roles : collection of str
        What to look for.

    Returns
    -------
    found : dict of str to Topic
        Roles without a topic are left out.
    notes : list of str
        Topics with the right name and a type that cannot be used.

    Raises
    ------
    ConfigError
        A role does not exist.
    DataError
        A topic given is missing or of the wrong type, or several would do.
    """
    if unknown := sorted(set(names) - set(ROLES)):
        raise ConfigError(f'unknown role {", ".join(unknown)}; roles are {", ".join(ROLES)}')
    found: dict[str, Topic] = {}
    for role, name in names.items():
        found[role] = _given(available, role, name)
    namespaces = {namespace for role, topic in found.items()
                  if (namespace := _namespace(topic.name, ROLES[role].topic)) is not None}
    notes: list[str] = []
    for role in roles:
        if role not in found:
            topic = _usual(available, role, namespaces, notes)
            if topic is not None:
                found[role] = topic
    return {role: topic for role, topic in found.items() if role in roles}, notes


def _namespace(name: str, usual: str) -> str | None:
    name = '/' + name.lstrip('/')
    return name[:-len(usual)] if name.endswith('/' + usual) else None


def _given(available: Collection[Topic], role: str, name: str) -> Topic:
    expected = ROLES[role].types
    same = [topic for topic in available if topic.name.lstrip('/') == name.lstrip('/')]
    if not same:
        others = sorted({topic.name for topic in available if topic.type in expected})
        raise DataError(
            f'topic {name} ({role}) is not in the recording; topics of a matching type: '
            f'{", ".join(others) or "none"}')
    for topic in same:
        if topic.type in expected:
            return topic
    raise DataError(f'topic {name} is {same[0].type}, but {role} must be {" or ".join(expected)}')


def _usual(
        available: Collection[Topic], role: str, namespaces: Collection[str],
        notes: list[str]) -> Topic | None:
    usual, expected, _ = ROLES[role]
    candidates = {}
    for topic in available:
        namespace = _namespace(topic.name, usual)
        if namespace is None:
            continue
        if topic.type in expected:
            candidates[namespace] = topic
        else:
            notes.append(f'{topic.name} is {topic.type}, but {role} must be '
                         f'{" or ".join(expected)}: not used')
    for namespace in (*namespaces, '/'):
        if namespace in candidates:
            return candidates[namespace]
    if len(candidates) > 1:
        listed = ', '.join(sorted(topic.name for topic in candidates.values()))
        raise DataError(f'several topics could be {role}: {listed}; choose one with '
                        f'--topic {role}=NAME')
    return next(iter(candidates.values()), None)


def candidates(available: Collection[Topic], found: Mapping[str, Topic],
               roles: Collection[str]) -> dict[str, tuple[str, ...]]:
    """
    Return what else could be the topic of a role that has none.

    Parameters
    ----------
    available : collection of Topic
        All of the recording.
    found : mapping of str to Topic
        What roles have.
    roles : collection of str
        What was looked for.

    Returns
    -------
    dict of str to tuple of str
        Roles without a topic, to the topics of a type that fits and that no role has; joint states
        give the pose, too.
    """
    used = {topic.name for topic in found.values()}
    free = [topic for topic in available if topic.name not in used and not topic.is_output]
    from_joints = [JOINT_POSE] if 'joint_states' in found or any(
        topic.type == JOINT_STATE for topic in free) else []
    return {role: names for role in roles if role not in found
            and (names := (*sorted(
                topic.name for topic in free if topic.type in ROLES[role].types),
                *(from_joints if role == 'pose' else ())))}


_ATTRIBUTES = {'phase': 'phases', 'imu': 'angular_velocity', 'accel': 'accelerometer'}


def require(recording: Recording, roles: Collection[str]) -> None:
    """
    Refuse a recording that lacks something.

    Parameters
    ----------
    roles : collection of str
        ``wrench``, ``accelerometer``, ``pose``, ``target``, ``optidrive``, ``phase``, ...

    Raises
    ------
    DataError
        Names the topics that are missing, what reading had to say about them, and the topics
        that could be meant.
    """
    missing = [role for role in roles if not getattr(recording, _ATTRIBUTES.get(role, role))]
    if not missing:
        return
    reported = [note for note in recording.notes
            if any(ROLES[role].topic in note for role in missing)]
    raise DataError(
        f'{recording.source or "the recording"}: no messages of '
        f'{", ".join(f"{ROLES[role].topic} ({role})" for role in missing)}; '
        + ' and '.join(naming(recording, role) for role in missing)
        + ''.join(f'; {note}' for note in reported))


def naming(recording: Recording, role: str) -> str:
    """Say what to do without a topic of a role: name the one it may be, record it if none may."""
    others = recording.candidates.get(role, ())
    if not others:
        return f'record {ROLES[role].topic}'
    if len(others) < 2:
        how = 'compute it from joint states' if JOINT_POSE in others else 'select its topic'
        return f'{how} with --topic {role}={others[0]}'
    return f'select its topic with --topic {role}=NAME, one of {listed(others)}'


def naming_words(unnamed: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the options that name topics of :func:`candidates`; NAME if several may be meant."""
    return [word for role, names in unnamed.items() for word in (
        '--topic', f'{role}={names[0] if len(names) == 1 else "NAME"}')]


def listed(names: Sequence[str]) -> str:
    """Return names of topics to choose from, as many as fit in a line of a terminal or two."""
    most = 6
    more = f' and {len(names) - most} more' if len(names) > most else ''
    return ', '.join(names[:most]) + more


ROBOTS = ('broadcaster', 'franka', 'kuka_fri', 'ur')
CONTROLLERS = ('admittance_controller', 'cartesian_controllers', 'joint_trajectory_controller',
               'moveit_servo')


def preset_file(name: str) -> Path:
    """Return the parameter file of a preset, which nodes take as it is."""
    return Path(str(files('forcecal_ros') / 'config' / 'presets' / f'{name}.yaml'))


def read_preset(name: str) -> Mapping[str, dict[str, Any]]:
    """Return parameters by node; next to ``topics``, names of topics by launch argument."""
    document = load_yaml(preset_file(name).read_text(), name)
    return {node.removeprefix('/**/'): parameters['ros__parameters']
            for node, parameters in document.items()}


def topic_of(argument: str, usual: str, robot: str, controller: str) -> str:
    """
    Return the name of a topic by its launch argument, as presets say.

    The controller counts before the robot, except for joints: a robot that names their topics has
    its controllers in a namespace of its own.
    """
    for name in (robot, controller) if argument.startswith('joint_') else (controller, robot):
        if name and argument in (topics := read_preset(name)['topics']):
            return str(topics[argument])
    return usual


def topics_by_role(robot: str) -> dict[str, str]:
    """Return the names of a robot's topics by the roles of a recording."""
    preset, roles = read_preset(robot), {'current_pose': 'pose', 'target_frame': 'target'}
    names = {roles.get(argument, argument): str(name)
             for argument, name in preset['topics'].items()
             if roles.get(argument, argument) in ROLES}
    if frame := preset['sequencer'].get('pose.frame'):
        names['pose'] = f'tf:{preset["sequencer"]["pose.base"]}:{frame}'
    return names
