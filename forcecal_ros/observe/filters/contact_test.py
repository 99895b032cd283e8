"""Whether something touches the tool: readings tested against the hypothesis that nothing does.

Under that hypothesis a reading less load and bias is noise: its Mahalanobis distance, the NIS of
the hypothesis, is chi-square with 6 degrees of freedom. Two such tests run side by side, on each
reading for blows, and on an average over ``window`` for what presses softly. Both add the errors
of weight and inertia (``floor``) to the noise; they do not average out.
"""

from math import exp
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.filters.bias_model import ContactModel
from forcecal_ros.observe.filters.gaussian import Expected, Gaussian, mahalanobis
import numpy as np


class Contact(NamedTuple):
    """
    What the test remembers.

    Attributes
    ----------
    assumed : bool
        Whether contact is assumed.
    quiet : float
        Time since the tests last spoke of contact [s].
    average : ndarray, shape (6,)
        Of the residuals [N, N m].
    share : float
        Variance of the average over that of one residual.
    """

    assumed: bool = False
    quiet: float = 0.0
    average: Array = np.zeros(6)
    share: float = 0.0


ONSET_VARIANCE = 10.0
"""At the onset of contact the wrench is held for that many times as uncertain, in variance, as
its bias: then what came up is read as wrench (91 % of it at once), not as bias."""


class Free(NamedTuple):
    """A reading under the hypothesis of no contact: residual (6,) and its covariance (6, 6)."""

    residual: Array
    cov: Array
    uncertainty: Array
    """Share of ``cov`` that is no noise of this reading: that of the biases."""


def free_hypothesis(belief: Gaussian, expected: Expected, reading: Array, R: Array) -> Free:
    """
    Take the wrench out of what was expected.

    The first six states are the wrench, which adds to the reading (6,); R (6, 6) is the
    covariance of its noise.
    """
    wrench_cov, cross = belief.cov[:6, :6], expected.cross[:6, :6]
    cov = expected.cov[:6, :6] - cross - cross.T + wrench_cov
    return Free(reading - expected.mean[:6] + belief.mean[:6], cov, cov - R)


def assess(contact: Contact, free: Free, dt: float, model: ContactModel
           ) -> tuple[Contact, float]:
    """
    Test one reading, ``dt`` [s] after the one before.

    Returns
    -------
    Contact
    nis : float
        Of the hypothesis of no contact, this reading alone.

    Raises
    ------
    NotPositiveDefinite
        The covariance is none.
    """
    k = 1 - exp(-dt / model.window)
    average = contact.average + k * (free.residual - contact.average)
    share = (1 - k) ** 2 * contact.share + k * k
    noise = free.cov - free.uncertainty
    blow = mahalanobis(free.residual, free.cov + model.floor)
    push = mahalanobis(average, share * noise + free.uncertainty + model.floor)
    nis = mahalanobis(free.residual, free.cov)
    if max(blow, push) > model.limit:
        return Contact(True, 0.0, average, share), nis
    quiet = contact.quiet + dt
    # half a period of slack: how stamps were rounded must not decide
    held = contact.assumed and quiet + dt / 2 < model.release_time
    return Contact(held, quiet, average, share), nis


def opened(belief: Gaussian) -> Gaussian:
    """
    Return the belief at the onset of contact: a wrench of any size may have come up.

    The biases are frozen from here on. Where little is known of them yet, a wrench thought to be
    small would take a second to follow, for all that time suspecting the bias. The first six
    states are the wrench, the next six its biases.
    """
    cov = belief.cov.copy()
    cov[:6, :6] += ONSET_VARIANCE * cov[6:12, 6:12]
    return Gaussian(belief.mean, cov)
