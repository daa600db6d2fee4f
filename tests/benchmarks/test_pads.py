"""What benchmarks press: as curved as they say, as steep, and nowhere where a ray misses the mirror."""

import numpy as np
import pytest

from benchmarks.pads import HOLLOW, STEEPEST, bar, pad
from zeromethod.simulation.press import Mirror


def test_a_pads_middle_slopes_and_hollow_are_those_of_its_sigma():
    depth_mm, sigma_mm = 0.2, 4.0
    mirror = Mirror((pad(42.0, 0.0, depth_mm, sigma_mm),))
    x = np.linspace(42.0, 62.0, 20001)
    slope = mirror.slope(x, 0 * x)[0]
    curvature = np.gradient(slope, x)
    assert curvature[1] == pytest.approx(-depth_mm / sigma_mm**2, rel=1e-4)
    assert -slope.min() == pytest.approx(STEEPEST * depth_mm / sigma_mm, rel=1e-3)
    assert curvature.max() == pytest.approx(HOLLOW * depth_mm / sigma_mm**2, rel=2e-3)


def test_a_rod_is_no_steeper_nor_hollower_than_a_pad():
    depth_mm, sigma_mm = 0.2, 4.0
    mirror = Mirror((bar(42.0, 0.0, depth_mm, sigma_mm, 10.0, 90.0),))
    x = np.linspace(30.0, 62.0, 8001)
    slope = mirror.slope(x, 0 * x)[0]
    assert np.abs(slope).max() <= STEEPEST * depth_mm / sigma_mm
    assert np.gradient(slope, x).max() <= HOLLOW * depth_mm / sigma_mm**2


def test_a_ray_that_misses_the_mirror_has_no_depth():
    assert np.isnan(Mirror((pad(42.0, 0.0, 0.2, 4.0),)).depth(np.array([np.nan]), np.zeros(1))).all()
