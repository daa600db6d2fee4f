import numpy as np
import pytest
from surface_bench import Load

from zeromethod.surface.lever import Lever
from zeromethod.surface.rays import MirrorRays


@pytest.fixture(scope="module")
def pixels(small):
    return [axis[small.grid.inner] for axis in small.grid.mesh()]


@pytest.fixture(scope="module")
def rays(small, pixels):
    return MirrorRays(small.optics, *pixels)


@pytest.fixture(scope="module")
def lever(small, rays, pixels):
    return Lever(rays, np.nan_to_num(small.optics.sensitivity(*pixels), nan=1.0))


@pytest.mark.parametrize("peak_mm", [0.0, 0.2])
def test_factor_is_the_slope_that_a_small_step_on_the_panel_makes(small, rays, lever, peak_mm):
    """At the pressed mirror itself: by exact rays, the points kept."""
    dent = Load(peak_mm, small.centre_mm - 8.0, 0.0, 5.0)
    inner = small.grid.inner
    q, depth = small.warp(dent).q[inner], np.nan_to_num(small.truth(dent)[inner])
    slope, _ = rays.slope(depth, q)
    good = np.isfinite(slope).all(axis=-1)
    ones = np.ones((*depth.shape, 2))
    isotropic = np.broadcast_to(np.eye(2), (*depth.shape, 2, 2)).copy()
    factor = lever.factor(isotropic, ones, depth, slope)
    step = 1e-2
    for axis in (0, 1):
        turned, _ = rays.slope(depth, q + step * (np.arange(2) == axis))
        exact = (turned - slope) / step
        size = np.linalg.norm(exact[good], axis=-1)
        off = np.linalg.norm(factor[..., axis][good] - exact[good], axis=-1) / size
        # second order in 24 mrad of slope; the lever at rest is off by 3 % at the median of the dent's flank
        assert np.quantile(off, 0.99) < 0.01


def test_noise_goes_by_the_warps_own_stretch_and_turn(lever):
    shape = lever._rest.shape[:2]
    jacobian = np.broadcast_to([[0.8, 0.3], [-0.1, 0.9]], (*shape, 2, 2)).copy()
    size = np.array([0.02, 0.01])
    sigma_q = np.sqrt((jacobian**2) @ size**2)
    zero, flat = np.zeros(shape), np.zeros((*shape, 2))
    factor = lever.factor(jacobian, sigma_q, zero, flat)
    expected = np.linalg.inv(lever._rest) @ jacobian * size
    np.testing.assert_allclose(factor, expected, rtol=1e-9)


def test_a_camera_turned_by_45_degrees_shares_the_noise_evenly(lever):
    """Both rows of the squared Jacobian are alike then: the components' noise cannot be separated."""
    shape = lever._rest.shape[:2]
    jacobian = np.broadcast_to(np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2), (*shape, 2, 2)).copy()
    sigma_q = np.full((*shape, 2), 0.01)
    factor = lever.factor(jacobian, sigma_q, np.zeros(shape), np.zeros((*shape, 2)))
    np.testing.assert_allclose(factor, np.linalg.inv(lever._rest) @ jacobian * 0.01, rtol=1e-9)
