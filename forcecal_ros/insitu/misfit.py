"""What an affine fit hides of a misfit: a bend under load is in part an affine map of gravity.

Squares of gravity are seen as far as they leave the affine map. The rest of them bends offset and
slopes, the same in all data sets and however long these are, so that no residual tells its size.
"""

from collections.abc import Sequence

from forcecal_ros.geometry import Array
from forcecal_ros.insitu.departure import Causes
from forcecal_ros.insitu.moments import Moments
import numpy as np

HIDDEN = 2.0
"""
What is hidden along each regressor over what is seen of a bend, as RMS; from simulated legs with
bias, hysteresis and flex at 1, 3 and 10 times the protocol's (`benchmark/insitu_protocol.py`),
where 92 to 99 % of the truths are then within two standard errors, 60 to 65 % without.
"""


def hidden_covariance(moments: Sequence[Moments], causes: Causes | None) -> Array | None:
    """
    Covariance that the hidden part of a bend adds, at rest.

    Parameters
    ----------
    moments : sequence of Moments
    causes : Causes or None
        None where they could not be told.

    Returns
    -------
    ndarray or None
        Of [offset, raw pseudo-samples of every data set]; None where nothing bends.
    """
    if causes is None or not causes.bending.significant:
        return None
    n = len(causes.bending.covariance)
    x = [np.column_stack([m.ones, m.directions]) for m in moments]
    gram = np.sum([one.T @ one for one in x], axis=0)
    gram[0, 0] = sum(m.count for m in moments)
    of_offset = np.eye(1, gram.shape[0])
    linear = np.kron(np.vstack([of_offset, *x]), np.eye(n))
    hidden = np.kron(HIDDEN ** 2 * gram[0, 0] * np.linalg.inv(gram), causes.bending.covariance)
    return np.asarray(linear @ hidden @ linear.T)
