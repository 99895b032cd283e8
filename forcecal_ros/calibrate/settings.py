"""What a user may say about the identification; every default is stated with its reason."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from forcecal_ros.core.geometry import STANDARD_GRAVITY
from forcecal_ros.core.schema import Row, Section, Vector3
from forcecal_ros.core.streams import Recording, Stream

COUPLINGS = ('dc', 'ac')
COMPLIANCES = ('auto', 'yes', 'no')
DESIGNS = ('kalman', 'poles')
MODES = ('kalman', 'newton')


@dataclass(frozen=True)
class Thresholds:
    """
    Where an estimate is called into question; each names one line of ``quality.warnings``.

    Attributes
    ----------
    mass, gain, stiffness, damping, inertia : float
        Largest relative standard error. Above that of ``inertia`` it counts as not identified.
    com, position : float
        Largest standard error [m]. Above that of ``position`` the accelerometer's place counts
        as not identified.
    force_bias, torque_bias : float
        Largest standard error [N], [N m].
    offset : float
        Largest standard error, as a specific force [m/s^2].
    delay : float
        Largest standard error [s].
    condition : float
        Largest condition number of the poses, gravity directions scaled to unit spread.
    probability : float
        A chi-square of residuals less probable than this is reported: of 600 sound recordings
        the least probable had 2e-4.
    """

    mass: float = 0.001
    gain: float = 0.002
    stiffness: float = 0.01
    damping: float = 0.05
    inertia: float = 0.2
    com: float = 2e-4
    position: float = 0.005
    force_bias: float = 0.05
    torque_bias: float = 0.005
    offset: float = 0.02
    delay: float = 2e-4
    condition: float = 100.0
    probability: float = 1e-5


@dataclass(frozen=True)
class IdentificationSettings(Section, name=''):
    """Choices of the identification."""

    gravity: Annotated[float, Row(
        'Magnitude at the robot', 'm/s^2', above=0.0)] = STANDARD_GRAVITY
    gravity_direction: Annotated[Vector3 | None, Row(
        'Direction in base, of any length; None: along -z')] = None
    sensor_rotation: Annotated[Vector3 | None, Row(
        "Rotation vector of the wrench's axes, seen from the frame of the pose; None: the same",
        'rad')] = None
    coupling: Annotated[str, Row(
        'Of the accelerometer; ac: with a first-order high-pass', words=COUPLINGS)] = 'dc'
    cutoff: Annotated[float | None, Row(
        'Corner of that high-pass; None: estimated', 'Hz', above=0.0)] = None
    accelerometer_position: Annotated[Vector3 | None, Row(
        'In ft_sensor at zero displacement; None: estimated', 'm')] = None
    tool_compliance: Annotated[str, Row(
        'Whether the tool is compliant along x of ft_sensor; auto detects displacement of the '
        'optidrive or ringing after the step', words=COMPLIANCES)] = 'auto'
    largest_delay: Annotated[float, Row(
        'Largest delay between sensors that is searched', 's', above=0.0)] = 0.1
    observer_mode: Annotated[str, Row('Filter of the contact wrench', words=MODES)] = 'kalman'
    observer_design: Annotated[str, Row(
        "Of the paper's gain: kalman is Eq. 18, 19", words=DESIGNS)] = 'kalman'
    observer_poles: Annotated[tuple[float, float], Row(
        "Of the observer's error where poles places them", '1/s', below=0.0)] = (-30.0, -40.0)
    thresholds: Thresholds = Thresholds()
    source: Annotated[Mapping[str, object], Row("Copied into the calibration's source")
                      ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gravity_direction is not None and not any(self.gravity_direction):
            raise self.wrong('gravity_direction', 'a non-zero vector')

    def optidrive_of(self, recording: Recording) -> Stream | None:
        """Return the measured displacement of the tool; None where it is stated to be rigid."""
        return None if self.tool_compliance == 'no' else recording.optidrive
