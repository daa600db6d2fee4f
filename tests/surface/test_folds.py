"""Depth behind folds, and what holes leave open about the deepest point."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from surface_bench import Load, Several

from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface import SurfaceReader, peak
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.validity import Flag

RING_CURVATURE = 0.446
"""Largest curvature of a Gaussian dent outside its bottom, where it folds first, over depth / sigma^2."""


def flagged(warp, nodes, flag):
    flags = warp.flags.copy()
    flags[nodes] |= np.uint16(flag)
    return replace(warp, flags=flags)


def distance_nodes(bench, row, col):
    i, j = np.indices(bench.grid.shape)
    return np.hypot(i - row, j - col)


def middle(bench):
    rows, cols = bench.grid.shape
    u, v = bench.grid.mesh()
    point = bench.optics.trace(u, v, bench.optics.rest).point[rows // 2, cols // 2]
    return rows // 2, cols // 2, float(point[0]), float(point[1])


def ball_warp(bench, depth_mm, contact_mm, x_mm, y_mm):
    """The exact warp with the flags of a run, and the ball."""
    ball = Mirror((Dent(Shape.BALL, x_mm, y_mm, depth_mm, contact_mm**2 / depth_mm),))
    warp = bench.warp(ball)
    rest_q = bench.optics.rest_map(*bench.grid.mesh())
    size = bench.rig.display.columns, bench.rig.display.rows
    flags = warp.flags | warp_flags(warp.q, rest_q, bench.grid.period_px, size)
    return replace(warp, flags=flags), ball


@pytest.mark.parametrize("contact_mm", [3.5, 4.0])
@pytest.mark.parametrize("aside_mm", [0.0, 0.3])
def test_a_ball_whose_rim_folds_is_read_inside_the_fold(finer, contact_mm, aside_mm):
    _, _, x, y = middle(finer)
    warp, _ = ball_warp(finer, 0.15, contact_mm, x + aside_mm, y)
    assert np.count_nonzero(warp.flags & Flag.FOLDED) > 20
    surface = finer.reader.read(warp)
    found = peak(surface)
    # outside the fold it is 0.06 mm deep; nodes 0.7 mm apart do not resolve the rim, and sigma says so
    assert found.depth_mm == pytest.approx(0.15, rel=0.02)
    assert abs(found.depth_mm - 0.15) < 2 * found.sigma_mm
    assert found.sigma_mm < 0.06 * 0.15


def test_what_is_cut_off_counts_as_beyond_and_not_as_valid(finer):
    row, col, x, y = middle(finer)
    warp, ball = ball_warp(finer, 0.15, 3.5, x, y)
    surface = finer.reader.read(warp)
    inside = surface.cut_off.valid
    assert not (inside & surface.valid).any()
    assert not surface.valid[row, col]
    assert np.isnan(surface.depth_mm[inside]).all()
    error = surface.cut_off.depth_mm[inside] - finer.truth(ball)[inside]
    assert (np.abs(error) < 2 * surface.cut_off.sigma_depth_mm[inside]).all()
    # the step over the gap is wrong alike for all of them: within the fold depth holds together
    assert np.ptp(error) < 5e-4
    # what was connected reads as before, and so does its covariance
    one = np.zeros(finer.grid.shape)
    one[8, 8] = 1.0
    assert finer.reader.covariance(surface).with_mean(one).total[8, 8] > 0


def test_a_smooth_dent_behind_a_ring_of_lost_nodes_is_read_to_a_percent(small):
    row, col, x, y = middle(small)
    warp = small.warp(Load(0.2, x, y, 6.0))
    away = distance_nodes(small, row, col)
    surface = small.reader.read(flagged(warp, (away > 3.2) & (away < 4.8), Flag.FOLDED))
    assert surface.cut_off is not None
    found = peak(surface)
    # slopes bend little over the two nodes of 1.5 mm each that are lost
    assert found.depth_mm == pytest.approx(0.2, rel=0.01)
    assert abs(found.depth_mm - 0.2) < 2 * found.sigma_mm
    assert found.sigma_mm > peak(small.reader.read(warp)).sigma_mm


def test_across_a_wide_gap_nothing_is_tied_and_sigma_covers_what_may_be_inside(small):
    row, col, x, y = middle(small)
    warp = small.warp(Load(0.2, x, y, 7.0))
    away = distance_nodes(small, row, col)
    surface = small.reader.read(flagged(warp, (away > 2.5) & (away < 8.5), Flag.FOLDED))
    assert surface.cut_off is None
    found = peak(surface)
    assert found.depth_mm < 0.1
    assert 0.2 - found.depth_mm < 2 * found.sigma_mm


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_contact_without_light_leaves_open_what_is_inside(small, sign):
    row, col, x, y = middle(small)
    warp = small.warp(Load(sign * 0.1, x, y, 6.0))
    lost = distance_nodes(small, row, col) < 4.5
    found = peak(small.reader.read(flagged(warp, lost, Flag.LIGHT_LOST)))
    # loads are taken to push: of a pull the constant is known to 30 um, and within that
    assert abs(found.depth_mm) < (0.08 if sign > 0.0 else 0.1)
    assert abs(sign * 0.1 - found.depth_mm) < 2 * found.sigma_mm
    # what was measured next to the contact is as well known as ever
    assert sign < 0.0 or found.sigma_local_mm < 0.02 * abs(found.depth_mm)


@pytest.mark.parametrize("sigma_mm", [0.8, 1.0, 1.5])
@pytest.mark.parametrize("share", [1.0, 2.0])
def test_a_dent_all_inside_the_hole_that_it_makes_is_within_sigma(finer, sigma_mm, share):
    """As deep as folds, and twice: 1 to 2 nodes wide; what is left at the rim is flat, as under dirt."""
    row, col, x, y = middle(finer)
    rest = finer.reader.read(finer.warp(Load(1e-9, x, y, 4.0)))
    depth = share * rest.fold_per_mm * sigma_mm**2 / RING_CURVATURE
    warp = finer.warp(Load(depth, x, y, sigma_mm))
    rest_q = finer.optics.rest_map(*finer.grid.mesh())
    size = finer.rig.display.columns, finer.rig.display.rows
    flags = warp_flags(warp.q, rest_q, finer.grid.period_px, size) & np.uint16(Flag.FOLDED | Flag.UNDRAWABLE)
    inner = distance_nodes(finer, row, col) < 12
    hole = ndimage.binary_dilation((flags != 0) & inner, np.ones((5, 5)))
    found = peak(finer.reader.read(flagged(warp, hole, Flag.LIGHT_LOST)))
    # outside the hole 1/r is left of it, and a constant that is known from there alone
    assert abs(found.depth_mm) < 0.5 * depth
    assert abs(found.depth_mm - depth) < 2 * found.sigma_mm
    # not simply large
    assert found.sigma_mm < 2 * depth
    assert found.sigma_local_mm < 0.01 * depth


@pytest.mark.parametrize("radius_nodes", [0.5, 2.3])
def test_a_speck_that_hides_no_more_than_a_window_leaves_sigma_at_rest(finer, radius_nodes):
    row, col, x, y = middle(finer)
    warp = finer.warp(Load(1e-9, x, y, 4.0))
    whole = peak(finer.reader.read(warp))
    hole = distance_nodes(finer, row, col) < radius_nodes
    holed = peak(finer.reader.read(flagged(warp, hole, Flag.MODULATION)))
    assert holed.sigma_mm < 1.1 * whole.sigma_mm


def test_an_opening_in_the_fold_leaves_most_of_its_sigma(finer):
    _, _, x, y = middle(finer)
    warp, _ = ball_warp(finer, 0.15, 4.3, x, y)
    surface = finer.reader.read(warp)
    assert np.count_nonzero(warp.flags & Flag.FOLDED) > 20
    assert surface.cut_off is None
    found = peak(surface)
    # off by 0.6 %, eight times what the noise alone would say
    assert abs(found.depth_mm - 0.15) < 2 * found.sigma_mm
    assert found.sigma_mm > 5 * np.nanmax(surface.sigma_depth_mm)


def test_holes_aside_from_the_dent_change_nothing(small):
    row, col, x, y = middle(small)
    warp = small.warp(Load(0.2, x, y, 4.0))
    whole = peak(small.reader.read(warp))
    holed = small.reader.read(flagged(warp, distance_nodes(small, row + 4, col + 12) < 2.0, Flag.LIGHT_LOST))
    assert peak(holed).sigma_mm == pytest.approx(whole.sigma_mm, rel=0.02)


def test_a_dead_node_within_the_fit_changes_little(small):
    row, col, x, y = middle(small)
    warp = small.warp(Load(0.2, x, y, 7.0))
    found = peak(small.reader.read(flagged(warp, (row, col + 1), Flag.MODULATION)))
    # the constant is off by 0.13 um, 7e-4, by a block that lacks a node
    assert found.depth_mm == pytest.approx(0.2, rel=1e-3)
    # the quartic reaches over it
    assert found.sigma_mm < 1.5 * peak(small.reader.read(warp)).sigma_mm


def test_the_deeper_of_two_dents_may_be_the_one_with_the_hole(small):
    row, col, x, y = middle(small)
    apart = 14 * small.pitch_mm
    dents = Several((Load(0.12, x - apart / 2, y, 4.0), Load(0.15, x + apart / 2, y, 4.0)))
    lost = distance_nodes(small, row, col + 7) < 2.6
    found = peak(small.reader.read(flagged(small.warp(dents), lost, Flag.LIGHT_LOST)))
    assert found.depth_mm < 0.14
    assert abs(found.depth_mm - 0.15) < 2 * found.sigma_mm


def test_a_reader_that_met_a_fold_reads_the_next_warp_as_a_new_one_does(finer):
    _, _, x, y = middle(finer)
    folded, _ = ball_warp(finer, 0.15, 3.5, x, y)
    smooth = finer.warp(Load(0.1, x, y, 5.0))
    finer.reader.read(folded)
    after = peak(finer.reader.read(smooth)).depth_mm
    fresh = SurfaceReader(finer.rig, finer.optics, finer.grid).read(smooth)
    assert after == pytest.approx(peak(fresh).depth_mm, abs=1e-6)
