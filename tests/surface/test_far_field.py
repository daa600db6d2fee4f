"""The law of the far field on planted fields, without optics: depth and slope by formula, plus C h."""

import numpy as np
import pytest

from zeromethod.surface.far_field import centre_of, fit_far_field

X, Y = np.meshgrid(np.linspace(20.0, 64.0, 80), np.linspace(-18.0, 18.0, 66))
H = (X + 20.0) / 62.0
H_GRADIENT = np.stack([np.full(X.shape, 1 / 62.0), np.zeros(X.shape)], axis=-1)
NOISE = 1e-6
AT = (40.0, 2.0)


def field(n, k, peak_mm=0.1, at=AT):
    """A r^-n exp(-k r^2 / 2), rounded off inside 1 mm; (depth, slope)."""
    dx, dy = X - at[0], Y - at[1]
    square = dx**2 + dy**2 + 1e-12
    inside = square < 1.0
    q = np.maximum(square, 1.0)
    depth = peak_mm * q ** (-n / 2) * np.exp(-k * q / 2)
    radial = np.where(inside, -1e-3, -(n + k * q) * depth / q)
    return depth, np.stack([radial * dx, radial * dy], axis=-1)


def fitted(depth, slope, constant, bound=5e-3, noise=NOISE):
    generator = np.random.default_rng(0)
    read = slope + constant * H_GRADIENT + noise * generator.standard_normal(slope.shape)
    variance = np.full(slope.shape, noise**2)
    everywhere = np.ones(X.shape, bool)
    return fit_far_field(read, variance, depth + constant * H, H, H_GRADIENT, X, Y, everywhere, bound, 1.0)


@pytest.mark.parametrize(("n", "k"), [(1.0, 0.0), (2.0, 0.0), (0.0, 0.015), (1.0, 0.01)])
@pytest.mark.parametrize("constant", [-4e-3, 1e-3])
def test_the_constant_comes_back_for_any_member_of_the_family(n, k, constant):
    found = fitted(*field(n, k), constant)
    assert found is not None
    # microradians over some 20 mm and thousands of nodes: nanometres; the stated sigma covers it
    assert abs(found.constant_mm - constant) < 3 * found.sigma_mm + 1e-7
    assert found.sigma_mm < 0.05 * abs(constant)


def test_slope_read_at_the_wrong_depth_is_allowed_for():
    """The slope at depth D + C h contains C grad h; without it the fit gives another C, far outside sigma."""
    depth, slope = field(1.0, 0.0)
    generator = np.random.default_rng(0)
    read = slope + NOISE * generator.standard_normal(slope.shape)
    variance = np.full(slope.shape, NOISE**2)
    everywhere = np.ones(X.shape, bool)
    wrong = fit_far_field(read, variance, depth - 4e-3 * H, H, H_GRADIENT, X, Y, everywhere, 5e-3, 1.0)
    # C grad h, 4e-3 / 62 rad, over r is some 40 % of C at the 20 mm of the far field
    assert wrong is not None
    assert abs(wrong.constant_mm + 4e-3) > max(0.25 * 4e-3, 10 * wrong.sigma_mm)


def test_fields_that_follow_no_law_are_refused():
    """Two dents on either side fall off about no common centre: the misfit refuses them."""
    (a, sa), (b, sb) = field(1.0, 0.0, at=(30.0, -5.0)), field(1.0, 0.0, 0.07, at=(56.0, 8.0))
    assert fitted(a + b, sa + sb, -4e-3) is None


def test_nothing_is_found_where_the_core_fills_the_view():
    depth, slope = field(0.0, 1 / 40.0**2)
    assert fitted(depth, slope, 0.0) is None


@pytest.mark.parametrize("cut", [np.s_[:, :], np.s_[:, 40:], np.s_[30:, :]])
def test_the_centre_is_found_from_any_part_of_the_dent(cut):
    _, slope = field(0.0, 0.03)
    everywhere = np.ones(X[cut].shape, bool)
    centre = centre_of(slope[cut], X[cut], Y[cut], everywhere)
    # exact lines: rounding only, but for the flattened 1 mm in the middle, whose lines agree
    np.testing.assert_allclose(centre, AT, atol=1e-6)


def test_parallel_lines_have_no_centre():
    slope = np.stack([np.ones(X.shape), np.zeros(X.shape)], axis=-1)
    assert centre_of(slope, X, Y, np.ones(X.shape, bool)) is None
