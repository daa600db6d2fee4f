"""Figures of all nodes of a frame."""

import numpy as np

from zeromethod.loop.node_figures import node_figures
from zeromethod.warp.validity import Flag


def test_dark_nodes_count_as_covered_but_not_those_that_see_coded_pictures():
    flags = np.zeros((2, 4), np.uint16)
    flags[0] = Flag.LIGHT_LOST
    flags[0, 1:] |= np.uint16(Flag.CODED)
    seen = np.ones((2, 4), np.bool_)
    valid = flags == 0
    square, valid_share, covered_share = node_figures(np.full((2, 4, 2), 0.1), valid, valid, seen, flags)
    assert (valid_share, covered_share) == (0.5, 0.125)
    assert square == np.float64(0.1) ** 2 + np.float64(0.1) ** 2
