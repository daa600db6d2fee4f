from dataclasses import replace

import numpy as np
import pytest
from surface_bench import Gauss

from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.noise import SlopeNoise, sample_nodes
from zeromethod.warp.overlap import component_correlation
from zeromethod.warp.validity import Flag


def stated_over_exact(bench, surface, among=True, count=60):
    """Sigma map over the exact sigma from the covariance, at random nodes."""
    covariance = bench.reader.covariance(surface)
    nodes = np.random.default_rng(0).permutation(np.argwhere(surface.valid & among))[:count]
    exact = []
    for row, col in nodes:
        weights = np.zeros(bench.grid.shape)
        weights[row, col] = 1.0
        exact.append(covariance.variance_of(weights).sigma)
    return surface.sigma_depth_mm[tuple(nodes.T)] / np.array(exact)


def test_covariance_of_slopes_is_that_of_drawn_noise():
    """The matrix-free product against the explicit matrix F R F^T."""
    generator = np.random.default_rng(0)
    factor = generator.standard_normal((5, 6, 2, 2))
    own, other = component_correlation(16, 8, "cosines")
    noise = SlopeNoise(lambda: factor, (factor**2).sum(axis=-1), own, other)
    line = {
        name: toeplitz(c, n)
        for name, c, n in (("ox", own, 6), ("oy", own, 5), ("px", other, 6), ("py", other, 5))
    }
    R = np.zeros((5, 6, 2, 5, 6, 2))
    R[:, :, 0, :, :, 0] = line["py"][:, None, :, None] * line["ox"][None, :, None, :]
    R[:, :, 1, :, :, 1] = line["oy"][:, None, :, None] * line["px"][None, :, None, :]
    C = np.einsum("ijac,ijcklb,klmb->ijaklm", factor, R, factor)
    weights = generator.standard_normal((3, 5, 6, 2))
    product = np.einsum("ijaklm,nklm->nija", C, weights)
    np.testing.assert_allclose(noise.covariance(weights), product, atol=1e-12)
    np.testing.assert_allclose(noise.variance_of(weights), (product * weights).sum(axis=(1, 2, 3)))
    np.testing.assert_allclose(noise.variance, np.einsum("ijaija->ija", C))


def toeplitz(correlation, count):
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.where(lag < len(correlation), correlation[np.minimum(lag, len(correlation) - 1)], 0.0)


def test_samples_stay_on_the_island_and_line_its_holes():
    island = np.ones((40, 50), bool)
    island[15:22, 20:30] = False
    nodes = sample_nodes(island)
    assert island.ravel()[nodes].all()
    assert {0, 49, 39 * 50, 40 * 50 - 1} <= set(nodes.tolist())
    rows, cols = np.unravel_index(nodes, island.shape)
    near = (np.abs(rows - 18) <= 4) & (np.abs(cols - 24.5) <= 6)
    assert np.count_nonzero(near) >= 10


def test_sigma_between_the_samples_is_that_of_the_covariance(full):
    dent = Gauss(0.0, full.centre_mm, 0.0, 5.0)
    ratio = stated_over_exact(full, full.reader.read(full.warp(dent)))
    # thin-plate spline of the logarithm over 13 x 13 points: 1 % rms, 3 % at the border
    assert np.abs(ratio - 1).max() < 0.06
    assert np.median(ratio) == pytest.approx(1.0, abs=0.005)


def test_a_press_rescales_the_map_without_new_samples(full):
    """The dent stretches the warp and so the noise there, by up to a third in sigma."""
    full.reader.read(full.warp(Gauss(0.0, full.centre_mm, 0.0, 5.0)))
    sampled = full.reader._noise._sampled
    surface = full.reader.read(full.warp(Gauss(0.2, full.centre_mm, 0.0, 5.0)))
    assert full.reader._noise._sampled is sampled
    ratio = stated_over_exact(full, surface)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
    # octave by octave is a rough weight: 10 % in the flanks
    assert np.quantile(np.abs(ratio - 1), 0.95) < 0.12


def test_a_moved_anchor_is_accounted_for_without_new_samples(small):
    small.reader.read(small.warp(Gauss(0.05, small.centre_mm - 12.0, -5.0, 5.0)))
    sampled, anchor = small.reader._noise._sampled, small.reader._noise._anchor
    surface = small.reader.read(small.warp(Gauss(0.05, small.centre_mm + 12.0, 5.0, 5.0)))
    assert small.reader._noise._sampled is sampled
    assert small.reader._noise._anchor is not anchor
    ratio = stated_over_exact(small, surface)
    assert np.quantile(np.abs(ratio - 1), 0.95) < 0.06


def test_nodes_that_come_back_after_a_hole_have_their_own_sigma(small):
    """Samples taken with a hole are kept when it closes, and when the anchor has moved in between."""
    hole = np.zeros(small.grid.shape, bool)
    hole[14:19, 18:24] = True
    for shift_mm, y_mm in ((-12.0, -5.0), (12.0, 5.0)):
        warp = small.warp(Gauss(0.05, small.centre_mm + shift_mm, y_mm, 5.0))
        warp.flags[hole] |= np.uint16(Flag.LIGHT_LOST)
        holed = small.reader.read(warp)
    sampled = small.reader._noise._sampled
    surface = small.reader.read(small.warp(Gauss(0.05, small.centre_mm + 12.0, 5.0, 5.0)))
    assert small.reader._noise._sampled is sampled
    assert not holed.valid[hole].any()
    ratio = stated_over_exact(small, surface, hole)
    # octave by octave is a rough weight; it was 1.4 before nodes without a sample took their neighbours'
    assert np.abs(ratio - 1).max() < 0.12


def test_holes_and_odd_shapes_are_sampled_again(small):
    warp = small.warp(Gauss(0.0, small.centre_mm, 0.0, 5.0))
    warp.flags[12:20, 15:22] |= np.uint16(Flag.LIGHT_LOST)
    warp.flags[25:, :20] |= np.uint16(Flag.LIGHT_LOST)
    ratio = stated_over_exact(small, small.reader.read(warp))
    # within 1 % but for the corners between samples
    assert np.quantile(np.abs(ratio - 1), 0.95) < 0.03
    assert np.abs(ratio - 1).max() < 0.12


def test_sigma_scales_with_the_warp_without_new_samples(small):
    warp = small.warp(Gauss(0.0, small.centre_mm, 0.0, 5.0))
    once = small.reader.read(warp)
    sampled = small.reader._noise._sampled
    twice = small.reader.read(replace(warp, sigma=2 * warp.sigma))
    assert small.reader._noise._sampled is sampled
    np.testing.assert_allclose(
        twice.sigma_depth_mm[twice.valid], 2 * once.sigma_depth_mm[once.valid], rtol=1e-6
    )
    np.testing.assert_allclose(twice.sigma_slope[twice.valid], 2 * once.sigma_slope[once.valid], rtol=1e-9)


def test_single_frame_noise_at_rest_on_the_full_grid(full):
    generator = np.random.default_rng(2)
    squares = []
    for _ in range(6):
        surface = full.reader.read(full.warp(Gauss(0.0, full.centre_mm, 0.0, 5.0), generator))
        assert surface.anchor.sigma_mm < 20e-6
        squares.append(surface.depth_mm[surface.valid] ** 2)
    # 8 nm in the middle; towards P0 the mirror is within 1 mm of the LCD, where the lever is gone
    assert 5e-6 < np.sqrt(np.median(np.mean(squares, axis=0))) < 12e-6
    assert np.sqrt(np.mean(squares)) < 30e-6


def test_uncorrelated_readings_of_equal_weight_give_the_inverse_laplacian():
    """White noise on the steps themselves: least squares has covariance A^-1 (Gauss and Markov)."""
    rows, cols = 7, 9
    x, y = np.meshgrid(np.arange(float(cols)), np.arange(float(rows)))
    integrator = SlopeIntegrator(x, y)
    integrator.prepare(np.ones((rows, cols), bool), np.ones((rows, cols, 2)))
    linear = integrator.linear(x, y)
    steps = []
    for node in range(rows * cols):
        weights = -np.ones((rows, cols)) / (rows * cols)
        weights.flat[node] += 1.0
        potential = linear.solution.solve(weights)
        steps.append(np.concatenate([np.diff(potential, axis=a).ravel() for a in (0, 1)]))
    laplacian = np.zeros((rows * cols, rows * cols))
    index = np.arange(rows * cols).reshape(rows, cols)
    for a, b in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
        for i, j in zip(a.ravel(), b.ravel(), strict=True):
            laplacian[[i, j], [i, j]] += 1.0
            laplacian[i, j] -= 1.0
            laplacian[j, i] -= 1.0
    np.testing.assert_allclose(np.array(steps) @ np.array(steps).T, np.linalg.pinv(laplacian), atol=1e-9)
