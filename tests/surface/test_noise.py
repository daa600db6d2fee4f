from dataclasses import replace

import numpy as np
import pytest

from zeromethod.rig.load import load_rig
from zeromethod.surface.noise import correlated_noise, overlap_correlation

from .surface_bench import Bench, Gauss, small_rig


@pytest.fixture(scope="module")
def small():
    return Bench(small_rig())


def test_overlap_correlation_is_the_cubic_spline():
    # continuous cubic B-spline at 0, 1/2, 1, 3/2 over its value at 0; the pixel grid adds 1e-3
    np.testing.assert_allclose(overlap_correlation(16, 8)[:4], [1, 23 / 32, 1 / 4, 1 / 32], atol=3e-3)


def test_window_averages_of_white_pixels_have_that_correlation():
    triangle = np.convolve(np.ones(16), np.ones(16))
    pixels = np.random.default_rng(0).standard_normal((400, 800))
    filtered = np.array([np.convolve(line, triangle, mode="valid")[::8] for line in pixels])
    filtered /= filtered.std()
    for lag, expected in enumerate(overlap_correlation(16, 8)[:4]):
        measured = np.mean(filtered[:, : filtered.shape[1] - lag] * filtered[:, lag:])
        # 400 x 96 samples, correlated over three: 0.9 %
        assert measured == pytest.approx(expected, abs=0.03)


def test_correlated_noise_has_unit_variance_and_the_wanted_correlation():
    correlation = overlap_correlation(16, 8)
    noise = correlated_noise(100, (40, 50), correlation, np.random.default_rng(0))
    assert noise.std() == pytest.approx(1.0, abs=0.02)
    for lag in (1, 2):
        assert np.mean(noise[:, lag:] * noise[:, :-lag]) == pytest.approx(correlation[lag], abs=0.02)
        assert np.mean(noise[..., lag:] * noise[..., :-lag]) == pytest.approx(correlation[lag], abs=0.02)


@pytest.mark.parametrize("peak_mm", [0.0, 0.2])
def test_sigma_map_matches_monte_carlo(small, peak_mm):
    generator = np.random.default_rng(5)
    dent = Gauss(peak_mm, small.centre_mm, 0.0, 5.0)
    truth = small.truth(dent)
    previous, squares, slopes = None, [], []
    exact = np.stack(dent.slope(*np.nan_to_num(_points(small, dent))), axis=-1)
    for _ in range(200):
        surface = small.reader.read(small.warp(dent, generator), previous)
        previous = surface
        squares.append((surface.depth_mm - truth) ** 2)
        slopes.append((surface.slope - exact) ** 2)
    rms = np.sqrt(np.mean(squares, axis=0))[surface.valid]
    ratio = surface.sigma_depth_mm[surface.valid] / rms
    # bar 15 %; 200 draws know rms to 5 %, 96 probes sigma to 7 %, both alike over wide parts of the map
    assert np.median(ratio) == pytest.approx(1.0, abs=0.15)
    assert np.quantile(ratio, 0.05) > 0.7
    assert np.quantile(ratio, 0.95) < 1.4
    slope_ratio = surface.sigma_slope[surface.valid] / np.sqrt(np.mean(slopes, axis=0))[surface.valid]
    # the lever is the rest's; a press of 0.2 mm moves the mirror a little nearer to the LCD
    assert np.median(slope_ratio) == pytest.approx(1.0, abs=0.05)


def _points(bench, dent):
    surface = bench.reader.read(bench.warp(dent))
    return surface.x_mm, surface.y_mm


def test_single_frame_noise_at_rest_on_the_full_grid():
    bench = Bench(load_rig("simulated"))
    dent = Gauss(0.0, bench.centre_mm, 0.0, 5.0)
    generator = np.random.default_rng(2)
    squares = []
    for _ in range(6):
        surface = bench.reader.read(bench.warp(dent, generator))
        assert surface.anchor.sigma_mm < 20e-6
        squares.append(surface.depth_mm[surface.valid] ** 2)
    rms = np.sqrt(np.mean(squares))
    # 8 nm in the middle; towards P0 the mirror is within 1 mm of the LCD, where the lever is gone
    assert 5e-6 < np.sqrt(np.median(np.mean(squares, axis=0))) < 12e-6
    assert rms < 30e-6


def test_sigma_scales_with_the_warp_without_new_probes(small):
    warp = small.warp(Gauss(0.0, small.centre_mm, 0.0, 5.0))
    once = small.reader.read(warp)
    probes = small.reader._noise._probes
    twice = small.reader.read(replace(warp, sigma=2 * warp.sigma))
    assert small.reader._noise._probes is probes
    np.testing.assert_allclose(
        twice.sigma_depth_mm[twice.valid], 2 * once.sigma_depth_mm[once.valid], rtol=0.05
    )
