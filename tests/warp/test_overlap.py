import numpy as np
import pytest

from zeromethod.warp.overlap import component_correlation, mean_noise_gain, overlap_correlation


def test_without_a_carrier_it_is_the_cubic_spline():
    # continuous cubic B-spline at 0, 1/2, 1, 3/2, 2 over its value at 0; the pixel grid adds 1e-3
    expected = [1, 23 / 32, 1 / 4, 1 / 32, 0]
    np.testing.assert_allclose(overlap_correlation(16, 8), expected, atol=3e-3)
    np.testing.assert_allclose(overlap_correlation(128, 64), expected, atol=1e-4)


@pytest.mark.parametrize(
    ("gradient", "carrier"), [("flat", lambda p: 1.0), ("sine", np.sin), ("cosine", np.cos)]
)
def test_weighted_windows_of_white_pixels_have_that_correlation(gradient, carrier):
    pixels = np.random.default_rng(0).standard_normal((4000, 80))
    weighted = pixels * carrier(2 * np.pi * np.arange(80) / 16)
    triangle = 16.0 - np.abs(np.arange(-15, 16))
    at = np.array([[weighted[:, u - 15 : u + 16] @ triangle] for u in (24, 32, 40, 48)])[:, 0]
    power = np.mean(at**2, axis=1)
    for lag, expected in enumerate(overlap_correlation(16, 8, gradient)[:4]):
        measured = np.mean(at[0] * at[lag]) / np.sqrt(power[0] * power[lag])
        # 4000 independent draws: 1.6 % of one
        assert measured == pytest.approx(expected, abs=0.04)


def test_crossed_carriers_have_one_gradient_per_axis():
    own, other = component_correlation(16, 8, "cosines")
    np.testing.assert_array_equal(own, overlap_correlation(16, 8, "sine"))
    np.testing.assert_array_equal(other, overlap_correlation(16, 8))
    # what the carrier does: 2 % at one node apart, opposite for sine and cosine
    assert abs(own[1] - other[1]) == pytest.approx(0.02, abs=0.002)
    own, other = component_correlation(16, 8, "checker")
    plain = overlap_correlation(16, 8)
    assert (own[1] - plain[1]) * (other[1] - plain[1]) < 0


def test_noise_of_a_mean_of_correlated_nodes():
    assert mean_noise_gain(np.array([1.0]), 5) == pytest.approx(0.2)
    assert mean_noise_gain(np.ones(9), 5) == pytest.approx(1.0)
    assert mean_noise_gain(np.array([1.0, 0.5]), 2) == pytest.approx(0.75)
