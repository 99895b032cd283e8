"""An offset that jumps within a data set is told with its instant; bends and drift are none."""


from forcecal_ros.insitu.blocks import Chunk, Mounting, prepare, to_blocks
from forcecal_ros.insitu.offset import jump_within
from insitu_leg import Leg, PROTOCOL, REAL, record
import numpy as np
import pytest

TARE = np.array([100.0, -80.0, 60.0, 200.0, -150.0, 90.0])
"""Two or four percent of what gravity moves a channel by."""


LEG = Leg(duration=20.0)


def jump(change, leg=LEG, seed=1):
    log = record(PROTOCOL[1], leg, seed)
    chunk = Chunk(log.t, log.raw + change(log.t), log.accel, None)
    blocks = to_blocks(prepare(chunk, Mounting(), False))
    return jump_within(blocks, np.ones(len(blocks), dtype=bool))


@pytest.mark.parametrize('share', [0.25, 0.5, 1.0])
def test_a_tare_is_told_with_its_instant_and_size(share):
    for seed in range(3):
        found = jump(lambda t: share * (t[:, None] > 12.0) * TARE, seed=seed)
        assert abs(found.start - 12.0) < 0.5
        moved = np.ptp(record(PROTOCOL[1], LEG, seed).wrench @ LEG.channels.T, axis=0)
        # four standard errors of two means of noise, over what gravity moves
        assert found.share == pytest.approx(share * (np.abs(TARE) / moved).max(), rel=0.1,
                                            abs=0.0025)


@pytest.mark.parametrize('leg', [LEG, pytest.param(REAL, marks=pytest.mark.long)])
def test_noise_bends_hysteresis_and_drift_are_no_jump(leg):
    for seed in range(3):
        assert jump(lambda t: 0.0 * t[:, None], leg, seed) is None
    assert jump(lambda t: t[:, None] / t[-1] * TARE, leg) is None
