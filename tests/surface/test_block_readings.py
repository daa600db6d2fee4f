"""What was read as means over blocks, at the points of rest: exact for slopes that change evenly."""

import numpy as np
import pytest

from zeromethod.surface.block_readings import BlockReader
from zeromethod.surface.pass_result import PassResult
from zeromethod.warp.blocks import Blocks

Y, X = np.mgrid[0:45, 0:60].astype(float)
SHIFT = 0.3, -0.2


def slopes(x, y):
    """(..., 2) of a quadratic depth."""
    return np.stack([1e-3 + 2e-4 * x + 1e-4 * y, -2e-3 + 1e-4 * x - 3e-4 * y], axis=-1)


@pytest.mark.parametrize("gaps", [False, True])
def test_slopes_are_those_at_the_points_of_rest_beside_gaps_too(gaps):
    there = np.ones(X.shape, bool)
    if gaps:
        # single nodes in the corners of blocks: in their middles what two neighbours miss would cancel
        there[3:40:9, 3:55:9] = False
    blocks = Blocks.of(X.shape)
    point = np.stack([X + SHIFT[0], Y + SHIFT[1], np.zeros(X.shape)], axis=-1)
    slope = slopes(X + SHIFT[0], Y + SHIFT[1])
    read = PassResult(slope, np.ones((*X.shape, 2)), point, there, np.zeros(X.shape))
    found = BlockReader(blocks, X, Y, np.ones(X.shape)).read(read)
    expected, _ = blocks.means(slopes(X, Y), np.ones(X.shape, bool))
    assert found.used.all()
    np.testing.assert_allclose(found.slope, expected, rtol=0, atol=1e-15)
