"""Stage filter: from an unloaded wrench to the contact wrench, by the filter of the model."""

from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.kalman import innovation, kalman_step
from forcecal_ros.observe.filters.memory import KALMAN, Memory, NEWTON, STOPPED
from forcecal_ros.observe.filters.newton import along_x
from forcecal_ros.observe.filters.noise_level import AS_CALIBRATED, believed
from forcecal_ros.observe.motion import MotionEstimate
from forcecal_ros.observe.sample import ContactSample, NO_WRENCH
from forcecal_ros.observe.status import INVALID, NOISY
from forcecal_ros.observe.tracking import ZERO
from forcecal_ros.observe.unload import Unloaded


def filtered(memory: Memory, reading: Unloaded, motion: MotionEstimate, model: Model
             ) -> tuple[Memory, ContactSample]:
    """Answer one wrench by ``kalman``, ``newton`` or no filter at all."""
    t, status, measured, inertial, _ = reading
    if status & INVALID:
        return memory, ContactSample(
            t, memory.contact, status, NO_WRENCH, NO_WRENCH, NO_WRENCH, None)
    if model.filter == KALMAN:
        status, e = innovation(memory, reading, model)
        memory = kalman_step(memory, reading, e, model)
        if believed(memory.noise.level) > 1.0:
            status |= NOISY
    elif model.filter == NEWTON:
        status, e = innovation(memory, reading, model)
        memory = along_x(memory, reading, motion, model)
    else:
        e = NO_WRENCH
        memory = Memory(t, measured, STOPPED, ZERO, AS_CALIBRATED)
    return memory, ContactSample(t, memory.contact, status, measured, e, inertial, None)
