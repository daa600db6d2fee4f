"""Order of the carrier over a saw's seams, on exact warps of planted dents."""

import numpy as np
import pytest
from surface_bench import Bench, Gauss

from benchmarks.dents import Planted, straight
from zeromethod import load_rig
from zeromethod.loop.across_seams import at_seams, bridged, settle_order
from zeromethod.optics import Dented
from zeromethod.sensing.residual import Residual
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag


@pytest.fixture(scope="module")
def thin():
    bench = Bench(load_rig("thin"))
    return bench, Rest.of(bench.rig, bench.optics)


def seams_before(rest: Rest) -> np.ndarray:
    """How many seams there are at or before each node of a row; the second is next to the view's middle."""
    seam = (rest.flags & np.uint16(Flag.SEAM) != 0).astype(int)
    return np.cumsum(np.diff(seam, axis=1, prepend=0) == 1, axis=1)


def planted(thin, dent, periods: int, axis: int = 0) -> tuple[Residual, np.ndarray]:
    """What is seen of a dent with the picture at rest, misread by periods after a seam; the truth."""
    bench, rest = thin
    residual = Residual.empty(bench.grid)
    warp = bench.warp(dent)
    along = np.gradient(rest.q, axis=1)[..., 0] / rest.grid.spacing_px
    down = np.gradient(rest.q, axis=0)[..., 1] / rest.grid.spacing_px
    true = (warp.q - rest.q) / np.stack([along, down], axis=-1)  # the rest map of this rig is nearly straight
    residual.flags[:] = warp.flags
    residual.d[:] = true
    residual.d[seams_before(rest) >= 2, axis] += periods * rest.grid.period_px
    return residual, true


@pytest.mark.parametrize(("periods", "axis"), [(-2, 0), (-1, 0), (1, 1)])
@pytest.mark.parametrize("y_mm", [0.0, 9.0])
def test_a_side_of_a_seam_that_was_misread_is_brought_back(thin, periods, axis, y_mm):
    # its flanks lie on two seams, where rays are longer on one side by up to 0.7 periods
    residual, true = planted(thin, Gauss(0.2, 42.0, y_mm, 5.0), periods, axis)
    settle_order(residual, thin[1].q, np.full_like(true, np.nan), thin[1])
    good = (residual.flags | thin[1].flags) == 0
    assert good.any()
    np.testing.assert_allclose(residual.d[good], true[good], atol=1e-9)


@pytest.mark.parametrize("size_mm", [2.0, 3.0, 5.0])
def test_what_is_right_stays(thin, size_mm):
    # a long edge bends all rows of a seam as much
    dent = Planted(straight, 0.003 * size_mm**2, 41.5, 0.0, size_mm)
    residual, true = planted(thin, dent, 0)
    settle_order(residual, thin[1].q, np.full_like(true, np.nan), thin[1])
    good = (residual.flags | thin[1].flags) == 0
    np.testing.assert_allclose(residual.d[good], true[good], atol=1e-9)


def test_fringes_that_look_like_steps_move_no_tooth_that_rests(thin):
    residual, true = planted(thin, Gauss(0.05, 42.0, 0.0, 5.0), 1, 1)
    # a burst's fringes after the same seam, in four rows of ten, read a period the other way
    fringes = (seams_before(thin[1]) >= 2) & (np.arange(true.shape[0])[:, None] % 10 < 4)
    residual.d[fringes] = true[fringes] - thin[1].grid.period_px
    settle_order(residual, thin[1].q, true, thin[1])
    good = ((residual.flags | thin[1].flags) == 0) & ~fringes
    np.testing.assert_allclose(residual.d[good], true[good], atol=1e-9)


def test_pieces_of_a_tooth_cut_off_by_fringes_are_brought_back_each_by_itself(thin):
    residual, true = planted(thin, Gauss(0.05, 42.0, 0.0, 5.0), 0)
    row, tooth = np.arange(true.shape[0])[:, None], seams_before(thin[1]) == 2
    fringes = tooth & (row >= 60) & (row < 80)
    away = tooth & (row < 60)  # fewer nodes than the rest of the tooth has
    residual.d[away, 1] += thin[1].grid.period_px
    residual.d[fringes] += 3.0
    settle_order(residual, thin[1].q, true, thin[1], fringes)
    good = ((residual.flags | thin[1].flags) == 0) & ~fringes
    assert (good & away).any()
    np.testing.assert_allclose(residual.d[good], true[good], atol=1e-9)


def test_a_seam_with_a_misread_side_joins_nothing(thin):
    bench, rest = thin
    warp = bench.warp(Gauss(0.1, 42.0, 0.0, 4.0))
    seam = rest.flags & np.uint16(Flag.SEAM) != 0
    flags = np.where(seam, np.uint16(Flag.SEAM), warp.flags)
    joined = bridged(warp.q, flags, rest)
    period = rest.grid.period_px / rest.grid.spacing_px * np.gradient(rest.q[..., 0], axis=1)
    warp.q[..., 0] += np.where(seams_before(rest) >= 2, period, 0.0)
    second = seam & (seams_before(rest) == 2)
    again = bridged(warp.q, flags, rest)
    assert joined[second].any()
    assert not again[second].any()
    assert again[seam & ~second].any()


def test_nodes_whose_window_sees_a_seam_where_a_press_has_moved_it_are_its_own(thin):
    bench, rest = thin
    dent, row = Gauss(0.2, 42.0, 0.0, 5.0), bench.grid.shape[0] // 2
    # pixel by pixel through the dent's middle: where light is lost, or the picture jumps
    u_px = rest.grid.u_px
    u = np.arange(u_px[3], u_px[-4] + 1)
    v, mirror = np.full(len(u), rest.grid.v_px[row]), Dented(bench.optics.rest, dent)
    bends = np.diff(bench.optics.trace(u, v, mirror).q[:, 0], n=2)
    jumps = u[1:-1][~(np.abs(bends) < 0.5)]
    # further out a seam takes a twentieth of the window's weight at most
    reach_px = 2 / 3 * rest.grid.period_px
    sees = (np.abs(u_px[:, None] - jumps) < reach_px).any(axis=1) & rest.grid.measurable[row]
    q = bench.warp(dent).q
    found = at_seams(np.where(np.isfinite(q), q, rest.q), rest)[row]
    at_rest = rest.flags[row] & np.uint16(Flag.SEAM) != 0
    assert (sees & ~at_rest).any()
    assert not (sees & ~found).any()
    # seams at rest stay, and a node on either side of five of them may be too many
    assert np.count_nonzero(found & ~sees & ~at_rest) <= 2 * 5
