"""What a contact wrench is worth: one bit for each thing that was missing or wrong."""

from enum import IntFlag

# plain integers, because compiled code knows no IntFlag
NO_ACCELEROMETER = 1
NO_POSE = 2
NO_POSITION = 4
DISPLACEMENT_FROM_FORCE = 8
OFFSET_HELD = 16
NO_GRAVITY = 32
BAD_WRENCH = 64
RESTARTED = 128
SATURATED = 256
NO_GYRO = 512
NOISY = 1024

INVALID = NO_GRAVITY | BAD_WRENCH
"""With one of these the contact wrench is not to be used: it repeats the last estimate."""

DEGRADED = NO_ACCELEROMETER | NO_POSE | RESTARTED | SATURATED | NO_GYRO | NOISY
"""With one of these it is less accurate than the calibration promises."""


class Status(IntFlag):
    """The bits of a status by name; 0 when all is well."""

    OK = 0
    NO_ACCELEROMETER = NO_ACCELEROMETER
    NO_POSE = NO_POSE
    NO_POSITION = NO_POSITION
    DISPLACEMENT_FROM_FORCE = DISPLACEMENT_FROM_FORCE
    OFFSET_HELD = OFFSET_HELD
    NO_GRAVITY = NO_GRAVITY
    BAD_WRENCH = BAD_WRENCH
    RESTARTED = RESTARTED
    SATURATED = SATURATED
    NO_GYRO = NO_GYRO
    NOISY = NOISY


_TEXT = {
    NO_ACCELEROMETER: 'no accelerometer: acceleration from the pose, slower and noisier; without '
                      'a pose, gravity from the gyro alone',
    NO_POSE: 'no pose: the rotation is taken to be zero, gravity comes from the accelerometer',
    NO_POSITION: 'the pose holds no position',
    DISPLACEMENT_FROM_FORCE: 'no displacement sensor: the spring force stands in',
    OFFSET_HELD: 'the accelerometer offset is held, not tracked',
    NO_GRAVITY: 'weight unknown: neither pose nor accelerometer tells the direction of gravity; '
                'the last estimate is repeated',
    BAD_WRENCH: 'the wrench is no usable number; the last estimate is repeated',
    RESTARTED: 'the filter was restarted: the wrench had paused, or a covariance was no longer '
               'positive definite',
    SATURATED: 'a sensor is at the end of its range',
    NO_GYRO: 'no gyro: gravity is followed by the accelerometer alone',
    NOISY: 'the wrench is noisier than calibrated: the filter is slower than designed',
}


def describe(status: int) -> tuple[str, ...]:
    """Return one sentence for each bit that is set; none when all is well."""
    return tuple(text for bit, text in _TEXT.items() if status & bit)


def level(status: int) -> str:
    """Return ``error``, ``warn`` or ``ok``, as diagnostics want it."""
    if status & INVALID:
        return 'error'
    return 'warn' if status & DEGRADED else 'ok'


def saturated(values: tuple[float, ...], limits: tuple[float, ...]) -> bool:
    """Whether a reading is at the end of its sensor's range; limits infinite where unknown."""
    for value, limit in zip(values, limits):
        if abs(value) >= limit:
            return True
    return False
