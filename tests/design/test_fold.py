"""Fold limits against the caustic of a curved mirror and the exact rays of a press."""

import numpy as np
import pytest

from zeromethod.design import SampledView
from zeromethod.design.lever import GAUSSIAN_RING, gaussian_fold_mm, largest_curvature_per_mm

SIN, COS = np.sin(np.radians(50.0)), np.cos(np.radians(50.0))


def test_the_sharpest_bend_focuses_on_the_lcd(view: SampledView) -> None:
    # a mirror of radius R at incidence i focuses parallel light at R cos(i) / 2 in the plane of incidence
    expected = COS / (2 * view.x_mm * SIN)
    np.testing.assert_allclose(largest_curvature_per_mm(view)[view.on_lcd], expected[view.on_lcd], rtol=1e-6)


def test_the_ring_of_a_gaussian_bends_0_446_times_as_much_as_its_middle() -> None:
    r = np.linspace(0.0, 5.0, 20001)
    profile = np.exp(-(r**2) / 2)
    assert pytest.approx(((r**2 - 1) * profile).max(), rel=1e-6) == GAUSSIAN_RING


def test_the_depth_that_folds_grows_with_the_square_of_the_size(view: SampledView) -> None:
    curvature = largest_curvature_per_mm(view)[view.on_lcd]
    np.testing.assert_allclose(gaussian_fold_mm(view, 3.0)[view.on_lcd], 9 * curvature / GAUSSIAN_RING)
