"""Sigma of depth by the view's border: the bend of the slopes across it, times the distance of nodes."""

import numpy as np
import pytest

from zeromethod.surface.view_border import border_sigma_mm

SHAPE = (30, 40)
SPACING_MM = 0.4


def sigma_mm(cubic, valid=None):
    """Of depth cubic * y^3 + y^2 + x, whose slope bends along y alone."""
    y, x = SPACING_MM * np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    slope = np.stack([np.ones(SHAPE), 3 * cubic * y**2 + 2 * y], axis=-1)
    valid = np.ones(SHAPE, bool) if valid is None else valid
    slope[~valid] = np.nan
    return border_sigma_mm(slope, np.stack([x, y], axis=-1), valid)


@pytest.mark.parametrize("row", [0, 2, 27, 29])
def test_near_the_border_it_is_the_slopes_second_difference_times_a_node(row):
    # of 3 c y^2 over nodes h apart: 6 c h^2, over one node more h
    expected = 6 * 0.01 * SPACING_MM**3
    assert sigma_mm(0.01)[row, 20] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("row", "column"), [(3, 20), (15, 20), (15, 1), (15, 39)])
def test_further_inside_or_where_nothing_bends_across_it_there_is_none(row, column):
    assert sigma_mm(0.01)[row, column] == pytest.approx(0.0, abs=1e-12)


def test_a_paraboloid_has_none_as_its_slopes_are_straight():
    assert sigma_mm(0.0)[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_the_border_is_that_of_the_valid_nodes_and_a_hole_at_it_says_nothing():
    valid = np.ones(SHAPE, bool)
    valid[:4] = False
    assert sigma_mm(0.01, valid)[5, 20] > 0.0
    assert sigma_mm(0.01, valid)[8, 20] == pytest.approx(0.0, abs=1e-12)
    valid[4:10, 10:30] = False
    assert sigma_mm(0.01, valid)[5, 20] == 0.0
