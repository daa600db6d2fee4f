import numpy as np

from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import areas, jacobian, warp_flags
from zeromethod.warp.validity import Flag

GRID = NodeGrid((256, 320))
U, V = GRID.mesh()
INNER = GRID.inner
SIZE = (1920, 1080)


def _rest():
    return np.stack([800 + 0.8 * U + 0.05 * V, 300 + 0.7 * V], axis=-1)


def _bumped(height_px, sigma_px=40.0):
    q = _rest()
    q[..., 0] += height_px * np.exp(-((U - 160) ** 2 + (V - 128) ** 2) / (2 * sigma_px**2))
    return q


def test_cubic_warps_have_exact_derivatives_inside():
    x, y = U / 100, V / 100
    q = np.stack([x**3 * y, 2 * x - x * y**3], axis=-1)
    expected = (
        np.stack([3 * x * x * y, x**3, 2 - y**3, -3 * x * y * y], axis=-1).reshape(*U.shape, 2, 2) / 100
    )
    np.testing.assert_allclose(jacobian(q, 8)[2:-2, 2:-2], expected[2:-2, 2:-2], atol=1e-12)  # rounding


def test_planes_have_exact_derivatives_everywhere_and_beside_nan():
    q = _rest()
    q[10, 10] = np.nan
    J = jacobian(q, 8)
    there = np.ones(GRID.shape, dtype=bool)
    there[10, 10] = False
    np.testing.assert_allclose(J[there], np.broadcast_to([[0.8, 0.05], [0, 0.7]], J[there].shape), atol=1e-12)


def test_folded_exactly_where_the_area_turns_over():
    q = _bumped(60.0)  # steepest slope 60 exp(-1/2) / 40 = 0.91 > 0.8
    flags = warp_flags(q, _rest(), 16, SIZE)
    slope = 0.8 - (U - 160) / 40**2 * (q[..., 0] - _rest()[..., 0])
    clear = np.abs(slope) > 0.05  # the fourth-order rule errs by 0.01 at 8 px to sigma 40
    clear[[0, 1, -2, -1]] = clear[:, [0, 1, -2, -1]] = False
    folded = (flags & Flag.FOLDED) != 0
    assert folded.sum() > 5
    assert np.array_equal(folded[clear], (slope < 0)[clear])


def test_a_mirrored_rig_is_not_folded_at_rest():
    q = _rest()
    q[..., 0] *= -1
    q[..., 0] += 1900
    assert not (warp_flags(q, q, 16, SIZE) & Flag.FOLDED).any()


def test_undrawable_where_fringes_are_closer_than_four_lcd_px():
    for stretch, expected in ((0.24, True), (0.26, False)):  # 16 px x 0.25 = 4 LCD px
        q = np.stack([800 + stretch * U, 300 + 0.8 * V], axis=-1)
        undrawable = (warp_flags(q, _rest(), 16, SIZE) & Flag.UNDRAWABLE) != 0
        assert undrawable.all() == undrawable.any() == expected


def test_shear_crowds_fringes_although_no_axis_shrinks():
    q = np.stack([400 + U, 100 + 0.5 * V + 1.8 * U], axis=-1)
    # fringes of v: 16 |det| / |dq/du| = 8 / 2.06 = 3.9 LCD px
    assert ((warp_flags(q, q, 16, SIZE) & Flag.UNDRAWABLE) != 0).all()


def test_off_display_within_one_period_of_the_edge():
    q = np.stack([0.8 * U, 300 + 0.7 * V], axis=-1)
    off = (warp_flags(q, q, 16, SIZE) & Flag.OFF_DISPLAY) != 0
    assert np.array_equal(off, q[..., 0] < 16 * 0.8 - 0.5)


def test_nan_is_undrawable_and_spares_its_neighbours():
    """And where nothing is, at rest, no node has a flag."""
    q = _rest()
    q[12, 15] = np.nan
    flags = warp_flags(q, _rest(), 16, SIZE)
    assert flags[12, 15] & Flag.UNDRAWABLE
    flags[12, 15] = 0
    assert not flags.any()


def test_areas_at_rest_that_are_known_change_no_flag():
    q, rest = _rest().copy(), _rest()
    q[3:9, 4:8] = q[3:9, 7:3:-1]  # mirrored
    np.testing.assert_array_equal(
        warp_flags(q, rest, 16, SIZE), warp_flags(q, rest, 16, SIZE, rest_areas=areas(rest))
    )
    assert (warp_flags(q, rest, 16, SIZE) & Flag.FOLDED).any()
