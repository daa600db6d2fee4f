import numpy as np
import pytest

from zeromethod.warp.mean import mean_warp
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

SHAPE = (6, 8)
SIGMA = 0.02


def noisy(rng: np.random.Generator, flags: np.ndarray, time_ns: int) -> Warp:
    q = 100.0 + SIGMA * rng.standard_normal((*SHAPE, 2))
    # what is flagged may be anything, or nothing
    q[flags != 0] = np.nan
    return Warp(q, np.full(q.shape, SIGMA), flags, time_ns)


def test_each_node_is_the_mean_of_the_frames_in_which_it_was_valid():
    rng = np.random.default_rng(0)
    warps = []
    for frame in range(8):
        flags = np.zeros(SHAPE, np.uint16)
        flags[2, 3] = int(Flag.FOLDED) if frame % 4 == 0 else 0
        flags[4, 5] = int(Flag.LIGHT_LOST) if frame != 1 else 0
        warps.append(noisy(rng, flags, frame))
    mean = mean_warp(warps)
    assert mean.valid.sum() == mean.valid.size - 1
    assert mean.flags[4, 5] == int(Flag.LIGHT_LOST)
    np.testing.assert_allclose(mean.q[mean.valid], 100.0, atol=5 * SIGMA / np.sqrt(6))
    assert mean.sigma[0, 0, 0] == pytest.approx(SIGMA / np.sqrt(8))
    assert mean.sigma[2, 3, 0] == pytest.approx(SIGMA / np.sqrt(6))
    assert mean.time_ns == 3


def test_the_mean_of_one_is_that_one():
    one = noisy(np.random.default_rng(1), np.zeros(SHAPE, np.uint16), 7)
    mean = mean_warp([one])
    np.testing.assert_array_equal(mean.q, one.q)
    np.testing.assert_allclose(mean.sigma, one.sigma)
