"""The lever against plane geometry: a ray turned by twice the slope, unfolded prism, slabs by Snell."""

import numpy as np
import pytest
from scipy.special import ive

from zeromethod.design import SampledView, lever

from .design_benches import GAP, PIXEL_MM, PLATE, telecentric

SIN, COS = np.sin(np.radians(50.0)), np.cos(np.radians(50.0))


def reach_mm(view: SampledView, layers: tuple) -> np.ndarray:
    """LCD shift in mm per rad of the ray's turn in the rubber: each slab counts n / n_i of its thickness."""
    slabs = sum(layer.thickness_mm / layer.index for layer in layers)
    return view.x_mm * SIN + 1.41 * slabs


@pytest.mark.parametrize("layers", [(), (GAP,), (PLATE, GAP)])
def test_the_lcd_moves_by_twice_the_slope_times_the_path(layers):
    view = SampledView(telecentric(layers=layers))
    reach, pitch = reach_mm(view, layers), view.rig.display.pitch_mm
    found = lever.lcd_px_per_mrad(view)
    # closed form against closed form: rounding only
    np.testing.assert_allclose(found[view.on_lcd][:, 0], 2e-3 * reach[view.on_lcd] / pitch, rtol=1e-9)
    # across the plane of incidence the ray turns by 2 slope cos(incidence)
    np.testing.assert_allclose(found[view.on_lcd][:, 1], 2e-3 * COS * reach[view.on_lcd] / pitch, rtol=1e-9)


def test_the_image_moves_by_as_many_of_its_own_pixels():
    view = SampledView(telecentric(layers=(GAP,)))
    reach = reach_mm(view, (GAP,))[view.on_lcd]
    # parallel rays at right angles: the image of the LCD has the camera's own scale
    found = lever.camera_px_per_mrad(view)[view.on_lcd]
    np.testing.assert_allclose(found, 2e-3 * np.outer(reach, [1.0, COS]) / PIXEL_MM, rtol=1e-6)


def test_a_pixel_covers_more_of_the_mirror_along_x(view):
    found = lever.mirror_mm_per_px(view)[view.on_lcd]
    np.testing.assert_allclose(found, [[PIXEL_MM / COS, PIXEL_MM]] * len(found), rtol=1e-6)


def test_depth_per_pixel_is_the_slope_of_one_pixel_over_the_width_of_one_pixel(view):
    reach = reach_mm(view, ())[view.on_lcd]
    expected = 1e6 * PIXEL_MM**2 / (2 * reach * COS)  # the same along x and y
    found = lever.depth_nm_per_px(view)[view.on_lcd]
    np.testing.assert_allclose(found, np.stack([expected, expected], axis=-1), rtol=1e-6)


def test_the_sharpest_bend_focuses_on_the_lcd(view):
    # a mirror of radius R at incidence i focuses parallel light at R cos(i) / 2 in the plane of incidence
    expected = COS / (2 * view.x_mm * SIN)
    np.testing.assert_allclose(
        lever.largest_curvature_per_mm(view)[view.on_lcd], expected[view.on_lcd], rtol=1e-6
    )


def test_the_ring_of_a_gaussian_bends_0_446_times_as_much_as_its_middle():
    r = np.linspace(0.0, 5.0, 20001)
    profile = np.exp(-(r**2) / 2)
    assert pytest.approx(((r**2 - 1) * profile).max(), rel=1e-6) == lever.GAUSSIAN_RING


def test_the_ring_of_a_load_bends_0_358_times_as_much_as_its_middle():
    r = np.linspace(0.0, 5.0, 20001)
    u = r**2 / 4
    slope = (ive(1, u) - ive(0, u)) * r / 2  # the curvature in the middle is -1 / 2
    # differences over 2.5e-4 of a width
    assert pytest.approx(2 * np.gradient(slope, r).max(), rel=1e-5) == lever.LOAD_RING


def test_the_depth_that_folds_grows_with_the_square_of_the_size(view):
    curvature = lever.largest_curvature_per_mm(view)[view.on_lcd]
    np.testing.assert_allclose(
        lever.gaussian_fold_mm(view, 3.0)[view.on_lcd], 9 * curvature / lever.GAUSSIAN_RING
    )
