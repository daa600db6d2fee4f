"""Figures of all nodes of a frame; the mirror is at rest though dirt moves some, and not under a press."""

import numpy as np
import pytest

from zeromethod.loop.node_figures import at_rest, node_figures
from zeromethod.warp.validity import Flag

SHAPE = (40, 60)
ROW, COL = np.indices(SHAPE)
SIGMA, WITHIN = 0.02, 0.05


def rests(away):
    noise = SIGMA * np.random.default_rng(1).standard_normal((*SHAPE, 2))
    valid = np.ones(SHAPE, bool)
    valid[:2] = False
    known = np.full((*SHAPE, 2), SIGMA), valid
    return at_rest(away[..., None] + noise, np.zeros((*SHAPE, 2)), *known, 4, 3.0, WITHIN)


@pytest.mark.parametrize(("top", "left"), [(5, 7), (8, 8), (21, 34), (36, 56)])
def test_dirt_four_nodes_across_is_not_a_press_wherever_it_lies(top, left):
    spot = np.zeros(SHAPE)
    spot[top : top + 4, left : left + 4] = 1.0
    assert rests(spot)


@pytest.mark.parametrize(("row", "column"), [(19.5, 31.5), (21.0, 29.0), (35.0, 57.0)])
def test_a_press_three_nodes_wide_is_seen_wherever_it_lies(row, column):
    # its sigma; within 1.2 sigma, 40 nodes, it is above half of its largest, ten times the limit
    assert not rests(np.exp(-((ROW - row) ** 2 + (COL - column) ** 2) / (2 * 3.0**2)))


def test_a_whole_view_that_moved_a_little_is_not_at_rest():
    assert rests(np.full(SHAPE, 0.0))
    assert not rests(np.full(SHAPE, 1.2 * (3 * SIGMA + WITHIN)))


def test_dark_nodes_count_as_covered_but_not_those_that_see_coded_pictures():
    flags = np.zeros((2, 4), np.uint16)
    flags[0] = Flag.LIGHT_LOST
    flags[0, 1:] |= np.uint16(Flag.CODED)
    seen = np.ones((2, 4), np.bool_)
    valid = flags == 0
    square, valid_share, covered_share = node_figures(np.full((2, 4, 2), 0.1), valid, valid, seen, flags)
    assert (valid_share, covered_share) == (0.5, 0.125)
    assert square == np.float64(0.1) ** 2 + np.float64(0.1) ** 2
