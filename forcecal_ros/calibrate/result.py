"""From what the stages found to the calibration that leaves the identification."""

from dataclasses import dataclass, replace

from forcecal_ros.calibrate.accelerometer import AccelerometerFit, split_matrix, without_fading
from forcecal_ros.calibrate.gain import (
    measurement_covariance,
    observer_model,
    pole_gain,
    process_covariance,
    riccati_gain,
    slow_density,
    stream_covariance,
    with_unit_k23,
)
from forcecal_ros.calibrate.joint import JointFit
from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.calibrate.ringing import RingFit, Sag
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.calibrate.tool import Statics, ToolFit
from forcecal_ros.checks.signals import Clipping
from forcecal_ros.core.axes import pose_from_wire, unit_direction
from forcecal_ros.core.calibration import (
    Accelerometer,
    Calibration,
    Estimate,
    Noise,
    ObserverGain,
    Tool,
)
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.estimation import jacobian
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.rigid_body import symmetric
from forcecal_ros.core.streams import Recording, Stream
import numpy as np


@dataclass(frozen=True)
class Stages:
    """
    What each stage found.

    Attributes
    ----------
    recording : Recording
        Cleaned.
    poses, statics, tool, sag, ring, accelerometer, inertia
        See the modules of the same names; None where the recording did not hold what they need.
    pose_delay : tuple of float or None
        How much later than the wrench the pose shows the same instant, and its error [s].
    joint : JointFit or None
        None where the poses were single samples.
    stops : tuple of Clipping
        Where channels stop at a limit.
    """

    recording: Recording
    poses: list[StaticPose]
    statics: Statics
    tool: ToolFit
    sag: Sag | None
    ring: RingFit | None
    accelerometer: AccelerometerFit | None
    inertia: Estimate | None
    pose_delay: tuple[float, float] | None
    joint: JointFit | None
    stops: tuple[Clipping, ...] = ()


def with_settings(calibration: Calibration, settings: IdentificationSettings, wrench_sign: int
                  ) -> Calibration:
    """
    Give a calibration of another package what is stated of robot and sensor.

    Its numbers are in the axes of its wrench, which are turned into those of the pose, and of the
    sign in which its mass is positive, which readings are given by ``wrench_sign``.
    """
    R = pose_from_wire(settings.sensor_rotation)
    turn = np.eye(3) if R is None else R
    com, bias = calibration.com, calibration.wrench_bias
    return replace(
        calibration, gravity=settings.gravity, wrench_sign=wrench_sign,
        gravity_direction=unit_direction(settings.gravity_direction),
        sensor_rotation=None if R is None else settings.sensor_rotation,
        com=Estimate(turn @ com.value, com.std, com.unit),
        wrench_bias=Estimate(np.kron(np.eye(2), turn) @ bias.value, bias.std, bias.unit))


def tool_of(stages: Stages) -> Tool | None:
    """Stiffness and damping, the mass' uncertainty included; None for a rigid tool."""
    ring = stages.ring
    if ring is None:
        return None
    relative = stages.tool.covariance[0, 0] / stages.tool.mass**2
    k_std, d_std = (float(np.sqrt(ring.covariance[i, i] + value**2 * relative))
                    for i, value in enumerate((ring.stiffness, ring.damping)))
    return Tool(Estimate(ring.stiffness, k_std, 'N/m'), Estimate(ring.damping, d_std, 'N s/m'))


def inertia_of(found: JointFit) -> Estimate:
    """Return the inertia about the centre of mass, with its standard error [kg m^2]."""
    def about(p: Array) -> Array:
        first = p[1:4]
        offset = (first @ first * np.eye(3) - np.outer(first, first)) / p[0]
        return np.asarray(symmetric(p[4:]) - offset).ravel()

    p, C = found.theta[:10], found.covariance[:10, :10]
    if not np.isfinite(C).all():
        return Estimate(about(p).reshape(3, 3), np.inf, 'kg m^2')
    J = jacobian(about, p, 1e-4 * np.maximum(np.sqrt(np.diag(C)), 1e-12))
    std = np.sqrt(np.maximum(np.einsum('ij,jk,ik->i', J, C, J), 0.0))
    return Estimate(about(p).reshape(3, 3), std.reshape(3, 3), 'kg m^2')


def known_inertia(inertia: Estimate | None, threshold: float) -> Estimate | None:
    """Return an inertia whose standard errors are below a share of its mean moment, else None."""
    if inertia is None:
        return None
    size = float(np.trace(inertia.value)) / 3
    return inertia if size > 0 and inertia.std.max() <= threshold * size else None


def accelerometer_of(fit: AccelerometerFit | None, unit: str, settings: IdentificationSettings
                     ) -> Accelerometer | None:
    """Accelerometer as the calibration has it."""
    if fit is None:
        return None
    scaled, std = unit != 'V', fit.std
    axes = split_matrix(fit.matrix, fit.covariance[3:12, 3:12], scaled)
    known = np.isfinite(fit.delay)
    place = None
    if settings.accelerometer_position is not None:
        place = Estimate(settings.accelerometer_position, 0.0, 'm')
    elif np.isfinite(fit.position).all() and std[14:].max() <= settings.thresholds.position:
        place = Estimate(fit.position, std[14:], 'm')
    cutoff = None
    if settings.coupling == 'ac':
        cutoff = Estimate(fit.cutoff, 0.0 if settings.cutoff else std[13], 'Hz')
    return Accelerometer(
        offset=Estimate(fit.offset, std[:3], unit),
        gain=Estimate(axes.gain, axes.gain_std, '1' if scaled else 'V/(m/s^2)'),
        map=Estimate(axes.map, axes.map_std, '1'),
        delay=Estimate(fit.delay if known else 0.0, std[12] if known else np.nan, 's'),
        coupling=settings.coupling, cutoff=cutoff, position=place)


def specific_force(stages: Stages, coupling: str) -> Stream | None:
    """
    Return the accelerometer's readings as specific force in ft_sensor [m/s^2].

    Where it is AC-coupled, the decay of its reading at standstill is no noise, and is taken off.
    """
    fit, stream = stages.accelerometer, stages.recording.accelerometer
    if fit is None or stream is None:
        return None
    force = Stream(stream.t, np.linalg.solve(fit.matrix, (stream.values - fit.offset).T).T)
    if coupling == 'ac':
        return without_fading(force, stages.poses, fit.cutoff)
    return force


def noise_of(stages: Stages, coupling: str) -> Noise | None:
    """Carry out step 9: covariances at standstill; None where they could not be measured."""
    recording, force = stages.recording, specific_force(stages, coupling)
    if recording.wrench is None or recording.pose is None or force is None:
        return None
    wrench = stream_covariance(recording.wrench, stages.poses)
    specific = stream_covariance(force, stages.poses)
    measured = measurement_covariance(stages.poses, recording.pose, recording.optidrive, force)
    if wrench is None or specific is None or measured is None:
        return None
    mass, variance = stages.tool.mass, float(wrench.value[0, 0])
    densities = [slow_density(stream, stages.poses) for stream in (recording.wrench, force)]
    Q = process_covariance(variance, wrench.rate, mass)
    relative = wrench.std[0, 0] / variance
    return Noise(
        Estimate(Q, Q * relative, '(m, m/s)^2 s'),
        Estimate(measured.density, measured.std / measured.rate, '(m, m/s, m/s^2)^2 s'),
        Estimate(wrench.value, wrench.std, '(N, N m)^2'),
        Estimate(specific.value, specific.std, '(m/s^2)^2'),
        wrench.rate, specific.rate,
        *(None if density is None else Estimate(density, np.nan, unit) for density, unit in zip(
            densities, ('(N, N m)^2 s', '(m/s^2)^2 s'))))


def observer_of(noise: Noise, mass: float, settings: IdentificationSettings
                ) -> ObserverGain | None:
    """Design the paper's gain with k23 = 1, steps 10 and 11; None where R is singular."""
    model, upper = observer_model(mass), np.triu_indices(3)

    def gain(p: Array) -> Array:
        Q, R = np.diag([0.0, p[0]]), np.zeros((3, 3))
        R[upper] = p[1:]
        R.T[upper] = p[1:]
        return with_unit_k23(riccati_gain(model.A, model.C, Q, R)).ravel()

    if settings.observer_design == 'poles':
        K = with_unit_k23(pole_gain(model.A, model.C, settings.observer_poles))
        std = np.zeros_like(K)
    else:
        p = np.concatenate([[noise.Q.value[1, 1]], noise.R.value[upper]])
        errors = np.concatenate([[noise.Q.std[1, 1]], noise.R.std[upper]])
        try:
            K, sensitivity = gain(p).reshape(2, 3), jacobian(gain, p, 0.01 * errors)
        except UnobservableError:
            return None
        std = np.sqrt(sensitivity**2 @ errors**2).reshape(2, 3)
    return ObserverGain(
        K=Estimate(K, std, '1'), A=Estimate(model.A, 0.0, '1'), C=Estimate(model.C, 0.0, '1'),
        dt=1 / noise.wrench_rate, mode=settings.observer_mode)
