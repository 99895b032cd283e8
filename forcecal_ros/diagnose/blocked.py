"""What locating a gap asks of a recording, whether commands or measured motion explain it."""

from collections.abc import Mapping
from typing import Protocol

from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray


class Blocked(Protocol):
    """A recording in blocks, of which each phase covers some."""

    @property
    def groups(self) -> NDArray[np.intp]:
        """Say of each block whether it rests (0), moves (1) or is in contact (2)."""

    @property
    def times(self) -> Array:
        """Middle of each block [s]."""

    def phase_rows(self) -> Mapping[str, NDArray[np.bool_]]:
        """Say which blocks each phase word covers."""
