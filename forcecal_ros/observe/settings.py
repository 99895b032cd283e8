"""What a user may say about the chain."""

from dataclasses import dataclass
from typing import Annotated

from forcecal_ros.core.schema import Row, Section

MODES = ('kalman', 'newton')
"""Filters that a calibration may name as its own."""

FILTERS = (*MODES, 'ukf', 'ekf', 'static')
"""All filters of the chain; ``static`` removes weight and bias alone and filters nothing."""

LEARNING = ('ukf', 'ekf')
"""Filters that estimate the wrench biases along."""

OFFSETS = ('auto', 'on', 'off')

_PAIR = tuple[float, float]


@dataclass(frozen=True)
class FilterSettings(Section, name='gravity'):
    """Choices of filters ``ukf`` and ``ekf``, after [Ukf2025]."""

    rise_time: Annotated[float, Row(
        '10-90 % rise time of a contact wrench, target of the design', 's', above=0.0)
        ] = 0.012
    bias_prior: Annotated[_PAIR, Row(
        'Drift of the biases since the calibration, 1 sigma', 'N, N m', 0.0)] = (0.0, 0.0)
    contact_floor: Annotated[_PAIR, Row(
        'Residual of weight and inertia that does not count as contact', 'N, N m', 0.0)
        ] = (0.03, 0.003)


POSE_RATE_HZ = 250.0
"""Rate of the poses that the pose filters are designed for [Hz]."""

CONTACT_WALK = 2.5
"""Wander of a contact force that is expected where no other is stated: with the noise of the
nominal rig it makes a force rise in 14 ms, within the 15 ms of benchmark/observer_response.py
[N/sqrt(s)]."""

BANDWIDTH_LIMITS = (2.0, 250.0)
"""Corners beyond which that expectation is not followed where no others are stated, a rise in
175 ms and in 1.4 ms: between them noise from a tenth to ten times the nominal rig's finds its
corner, 247 and 2.5 Hz [Hz]."""


@dataclass(frozen=True)
class ObserverSettings(Section, name='observer'):
    """
    Choices of the chain.

    The position of a pose is trusted less than a robot's repeatability: flexing and timing count
    as well. ``skew`` costs no latency while all streams flow; it bounds the pause when one of
    them stops.
    """

    filter: Annotated[str | None, Row('None: that of the calibration', words=FILTERS)] = None
    bandwidth_hz: Annotated[float | None, Row(
        'Bandwidth of the contact wrench in mode kalman; 0: computed from noise and contact_walk',
        'Hz', above=0.0, high=1000.0)] = None
    contact_walk: Annotated[float | None, Row(
        f'Expected random walk of a contact force; 0: that of the calibration, or '
        f'{CONTACT_WALK:g}', 'N/sqrt(s)', above=0.0, high=1e4)] = None
    bandwidth_min_hz: Annotated[float | None, Row(
        'Lower limit of a computed bandwidth; 0: that of the calibration, or '
        f'{BANDWIDTH_LIMITS[0]:g}', 'Hz', above=0.0, high=1000.0)] = None
    bandwidth_max_hz: Annotated[float | None, Row(
        'Upper limit of a computed bandwidth; 0: that of the calibration, or '
        f'{BANDWIDTH_LIMITS[1]:g}', 'Hz', above=0.0, high=1000.0)] = None
    adaptive: Annotated[bool, Row(
        'Whether mode kalman becomes slower, down to bandwidth_min, if the wrench is noisier '
        'than calibrated')] = True
    offset: Annotated[str, Row(
        'Whether the accelerometer offset is tracked; auto: if poses hold positions',
        words=OFFSETS)] = 'auto'
    position: Annotated[bool, Row(
        'Whether the pose stream is expected to hold a position; read by offset only')] = True
    pose_position_std: Annotated[float, Row(
        f'Error of a pose of {POSE_RATE_HZ:g} Hz, 1 sigma', 'm', above=0.0)] = 1e-4
    pose_rotation_std: Annotated[float, Row('Error of its orientation', 'rad', above=0.0)] = 2e-5
    accelerometer_timeout: Annotated[float, Row(
        'Pause after which accelerometer and displacement count as missing', 's', 0.002, 1.0)
        ] = 0.025
    pose_timeout: Annotated[float, Row(
        'Pause after which the pose counts as missing', 's', 0.005, 10.0)] = 0.1
    skew: Annotated[float, Row(
        'Largest difference of transport times that the observer waits for', 's',
        0.001, 1.0)] = 0.05
    wrench_limit: Annotated[tuple[float, ...] | None, Row(
        'Measuring range of the force sensor', 'N, N m', shape=(6,), finite=False)] = None
    accelerometer_limit: Annotated[float | None, Row(
        'Measuring range of the accelerometer about zero, in its unit', above=0.0)] = None
    learning: FilterSettings = FilterSettings()

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.bandwidth_min_hz, self.bandwidth_max_hz
        if low is not None and high is not None and low > high:
            raise self.wrong('bandwidth_min_hz', f'at most bandwidth_max_hz, {high:g}')
