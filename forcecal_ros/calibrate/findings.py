"""What speaks against estimates: one check a function, each finding names what it spoils.

The fits assume one rigid tool that nothing touches, sensors that stay as they are, and clocks
that agree. What they leave over is to be noise, at every instant and over every stretch; where
it is not, an estimate may be off by many of its standard errors.

No recording of one motion shows a wrong gain of all force axes alike, a wrong magnitude of
gravity, or a force that never changes: they look like another mass and another bias.
"""

from collections.abc import Iterator

from forcecal_ros.calibrate.joint import (
    Blocks,
    INFLATION,
    row_noise,
    SUSPECT_UNEXPLAINED,
)
from forcecal_ros.calibrate.poses import values_in
from forcecal_ros.calibrate.residuals import (
    DRIFT,
    drift,
    farthest,
    largest_deviation,
    pose_errors,
    rejected,
    Residuals,
    restless,
    scatters,
    touched,
)
from forcecal_ros.calibrate.result import Stages
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.checks.messages import Finding, STANDSTILL
from forcecal_ros.core.estimation import CHANCE
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import CHANNELS
import numpy as np

ACCELEROMETER = ('accelerometer',)
"""The key that is estimated from the accelerometer."""

MOTION = ('inertia', 'accelerometer', 'tool')
"""Keys that are estimated from motion."""

ALL = (*STANDSTILL, *MOTION)
"""All keys that a finding can call into question."""

_RESTLESS = 5.0
"""So many times as much as in the others a signal moves in a pose where something changed; in
sound runs 2.2 times at most, behind a high-pass that settles, where jumps hid 10 and more."""

_SMALL = 1e-4
"""Residuals below this share of the tool's weight or of gravity are not worth a warning."""

_RESOLVED = 5
"""Blocks that a derivative of the pose reaches over: where commands were held back for a moment
the turning is abrupter than it can show, within fewer."""


NO_ACCELEROMETER = (
    'accelerometer: not identified, gravity spans fewer than three directions of ft_sensor in the '
    'poses and the motion between them; add a pose, or rotate further about two horizontal axes')
"""Why readings of an accelerometer are not used, and what would help."""


def findings(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Make every check of this module."""
    yield from poses_disagree(stages, settings)
    yield from samples_disagree(stages, settings)
    yield from torque_departs(stages, settings)
    yield from accelerometer_departs(stages, settings)
    yield from motion_departs(stages)
    yield from ringing_departs(stages)
    yield from delays_too_long(stages, settings)
    yield from clips_or_drifts(stages, settings)
    yield from moves_in_one_pose(stages, settings)


def poses_disagree(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Compare the static poses' readings with one rigid tool."""
    tool, statics = stages.tool, stages.statics
    if not tool.probability < settings.thresholds.probability or statics.covariance is None:
        return
    weight = tool.mass * settings.gravity
    small = _SMALL * weight * np.array([1.0] * 3 + [float(np.linalg.norm(tool.com))] * 3)
    sigma = np.sqrt(np.diagonal(statics.covariance, axis1=1, axis2=2))
    if not (np.abs(tool.residuals) > small).any():
        return
    errors = pose_errors(statics, tool)
    i = rejected(errors, settings.thresholds.probability)
    offs = tool.residuals if i is None else np.array([one.shift for one in errors])
    i = int(np.argmax(np.abs(offs / sigma).max(axis=1))) if i is None else i
    j = int(np.argmax(np.abs(offs[i]) / sigma[i]))
    names = ', '.join(str(k + 1) for k in touched(statics))
    remedy = (f'without pose {names} they fit: a cable or a contact disturbed it, or the tool was '
              'still moving' if names else
              'measure this pose again without contact or cable forces; if it deviates again, '
              'tighten the mount')
    yield Finding(
        f'the static poses do not fit one tool (chi-square {tool.chi_square:.3g} for '
        f'{tool.degrees} degrees of freedom): pose {i + 1} deviates by {offs[i, j]:+.3g} '
        f'{"N" if j < 3 else "N m"} in {CHANNELS["wrench"][j]}; {remedy}. This widens the '
        'standard errors', ALL)


def samples_disagree(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Judge what poses of one sample each leave over, whose noise nothing else shows."""
    tool, statics = stages.tool, stages.statics
    if statics.covariance is not None:
        return
    remedy = ('remove cables from the tool and measure again, each pose at rest; if that changes '
              'nothing, tighten the mount')
    if found := [f'{CHANNELS["wrench"][j]} by {rms:.2g} {"N" if j < 3 else "N m"} RMS, '
                 f'{share:.0%} of the effect of the weight'
                 for j, rms, share in scatters(tool.residuals, statics.wrench, tool.com)]:
        yield Finding(f'the static poses do not fit one tool: they scatter in {", ".join(found)}; '
                      f'{remedy}. Record several samples per pose', ALL)
    one = farthest(tool.residuals)
    if one is not None and one.probability < CHANCE:
        yield Finding(f'the static poses do not fit one tool: pose {one.pose + 1} deviates by '
                      f'{one.size:+.3g} {"N" if one.channel < 3 else "N m"} in '
                      f'{CHANNELS["wrench"][one.channel]}, more than the others allow; {remedy}',
                      ALL)


def residuals_of(values: Array, blocks: Blocks, noise: Array) -> Residuals:
    """
    Return residuals (m, k) of rows; at rest and in motion their noise is what half of them show.

    The noise of the sensor alone (k,) is less: derivatives of a noisy pose come on top of it.
    """
    sigma = np.tile(noise, (len(values), 1))
    for part in (blocks.groups == 0, blocks.groups == 1):
        if part.any():
            sigma[part] = np.maximum(noise, np.median(np.abs(values[part]), axis=0) / 0.6745)
    return Residuals(blocks.times, values, sigma, np.full(values.shape[1], INFLATION),
                     blocks.sampled)


def torque_departs(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Look for torques in motion and at rest that one tool does not explain."""
    fit = stages.joint
    if fit is None or fit.noise is None:
        return
    residuals = residuals_of(fit.residual[:, 3:], fit.blocks, row_noise(fit.noise)[3:])
    moves = fit.blocks.groups == 1
    by_motion = stages.tool.condition > settings.thresholds.condition
    small = _SMALL * stages.tool.mass * settings.gravity * np.linalg.norm(stages.tool.com)
    mentioned = False
    for where, part, shortest, suspect in (
            ('at rest', ~moves, 1, ALL),
            ('in motion', moves, _RESOLVED, ALL if by_motion else MOTION),
            ('overall', residuals.use, _RESOLVED, ALL)):
        found = largest_deviation(residuals._replace(use=part & residuals.use), shortest)
        if found.is_chance or abs(found.size) <= small or (
                mentioned and where == 'overall'):
            continue
        mentioned = True
        yield Finding(
            f'torque.{"xyz"[found.channel]} deviates by {found.size:+.2g} N m ({found.sigmas:.0f} '
            f'standard errors) {where} at about {found.time:.2f} s; record again without contact '
            'or cable forces; if it deviates again, check the stamps of pose and wrench', suspect)


def motion_departs(stages: Stages) -> Iterator[Finding]:
    """Look for forces in motion that are not those of a rigid tool."""
    fit = stages.joint
    if fit is None or fit.noise is None or not (fit.blocks.groups == 1).any():
        return
    noise = float(np.sqrt((row_noise(fit.noise)[:3]**2).mean()))
    if fit.unexplained > SUSPECT_UNEXPLAINED and fit.scale[0] > _RESTLESS * noise:
        yield Finding(
            f'in motion, forces differ from those of a rigid tool by {fit.scale[0]:.2g} N RMS, '
            f'{fit.unexplained:.0%} of the variation of its weight: the tool is in contact; move '
            'it without contact', MOTION)


def _small_volts(matrix: Array, settings: IdentificationSettings) -> float:
    return float(_SMALL * settings.gravity * np.abs(np.linalg.det(matrix))**(1 / 3))


def accelerometer_departs(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Look for readings of the accelerometer that the motion does not explain."""
    fit = stages.accelerometer
    if fit is None and stages.joint is not None and stages.recording.accelerometer is not None:
        yield Finding(NO_ACCELEROMETER)
    if fit is None or fit.residual is None or fit.blocks is None or fit.noise is None:
        return
    found = largest_deviation(
        residuals_of(fit.residual, fit.blocks, row_noise(fit.noise)), _RESOLVED)
    if not found.is_chance and abs(found.size) > _small_volts(fit.matrix, settings):
        yield Finding(
            f'accelerometer {"xyz"[found.channel]} deviates by {found.size:+.2g} '
            f'{stages.recording.accelerometer_unit} ({found.sigmas:.0f} standard errors) at about '
            f'{found.time:.2f} s. Record again without contact; if it deviates again, tighten its '
            'mount, and record again', MOTION)


def ringing_departs(stages: Stages) -> Iterator[Finding]:
    """Compare the ringing with that of a spring and a damper."""
    ring = stages.ring
    if ring is not None and ring.unexplained > SUSPECT_UNEXPLAINED:
        yield Finding(
            'the ringing of the tool does not fit a spring and a damper, which leave '
            f'{ring.unexplained:.0%} of it; record again without contact and with the robot at '
            'rest; if the message repeats, the compliant axis has friction or reaches an end stop',
            ('tool',))


def delays_too_long(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Look for delays beyond what is plausible."""
    limit = settings.largest_delay
    ring, fit = stages.ring, stages.accelerometer
    for name, delay, suspect in (
            ('pose', stages.pose_delay[0] if stages.pose_delay else 0.0, ALL),
            ('accelerometer', fit.delay if fit and np.isfinite(fit.delay) else 0.0, MOTION),
            ('optidrive', ring.slide_delay if ring else 0.0, MOTION)):
        if abs(delay) >= 0.95 * limit:
            yield Finding(f'{name}: its delay of {1e3 * delay:.1f} ms relative to the wrench is '
                          f'at the search limit ({1e3 * limit:.0f} ms); check the clocks', suspect)


def clips_or_drifts(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Look for readings that drift at rest or stay at an extreme."""
    recording = stages.recording
    for name, stream, suspect in (('wrench', recording.wrench, ALL),
                                  ('accelerometer', recording.accelerometer, ACCELEROMETER)):
        if stream is None:
            continue
        channels = CHANNELS[name]
        found = [str(x) for x in stages.stops if x.channel in channels]
        if found:
            yield Finding(f'{", ".join(found)}; increase the range of the {name}',
                          suspect)
        if name == 'accelerometer' and settings.coupling == 'ac':
            continue
        sigmas, pose, channel = drift(values_in(stream, stages.poses))
        if sigmas > DRIFT:
            remedy = ('set accelerometer.coupling: ac if it is AC-coupled'
                    if name == 'accelerometer' else 'let the sensor warm up, and record again')
            yield Finding(
                f'{channels[channel]} drifts by {sigmas:.0f} standard errors at standstill in '
                f'pose {pose + 1}; {remedy}', suspect)


def moves_in_one_pose(stages: Stages, settings: IdentificationSettings) -> Iterator[Finding]:
    """Look for signals that move in one static pose, where their noise hides a jump."""
    recording, fit, tool = stages.recording, stages.accelerometer, stages.tool
    weight = _SMALL * tool.mass * settings.gravity
    small = {'wrench': np.repeat([weight, weight * float(np.linalg.norm(tool.com))], 3),
             'accelerometer': np.full(3, _small_volts(fit.matrix, settings) if fit else 0.0),
             'optidrive': np.array([settings.thresholds.com])}
    for name, stream, suspect in (('wrench', recording.wrench, ALL),
                                  ('accelerometer', recording.accelerometer, MOTION),
                                  ('optidrive', recording.optidrive, ALL)):
        found = None if stream is None else restless(values_in(stream, stages.poses))
        if found and found.times > _RESTLESS and found.size > small[name][found.channel]:
            yield Finding(
                f'{CHANNELS[name][found.channel]} varies {found.times:.0f} times as much in pose '
                f'{found.window + 1} as in the others at standstill: it was touched or changed '
                'there; measure this pose again', suspect)
