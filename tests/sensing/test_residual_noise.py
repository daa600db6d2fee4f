"""Sigma against Monte Carlo, the Cramer-Rao bound and the noise correlation."""

import numpy as np
import pytest

from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.sensing.window import triangle
from zeromethod.warp.overlap import overlap_correlation

from .sensing_scenes import GRID, INNER, PERIOD, checker, cosines, exposed, observed

FRAMES = 150


def spread(sensor, light, noise, bits):
    rng = np.random.default_rng(3)
    d, sigma = [], []
    for _ in range(FRAMES):
        residual = sensor.measure(exposed(light, bits, black=noise.black_grey, rng=rng, noise=noise))
        d.append(residual.d[INNER].copy())
        sigma.append(residual.sigma[INNER].copy())
    return np.array(d), np.median(sigma, axis=0)


@pytest.mark.parametrize(
    ("kind", "light", "noise", "bits"),
    [
        ("cosines", cosines, Noise(read_grey=2.0, black_grey=4.0), 8),
        ("cosines", cosines, Noise(read_grey=2.0, electrons_per_grey=150.0, black_grey=4.0), 8),
        ("cosines", cosines, Noise(read_grey=1.0, electrons_per_grey=2.0), 12),
        ("checker", checker, Noise(read_grey=2.0, electrons_per_grey=20.0), 8),
    ],
)
def test_sigma_matches_monte_carlo(kind, light, noise, bits):
    sensor = ResidualSensor(GRID, kind, noise, bits, light=light)
    d, sigma = spread(sensor, observed(light, 1.7, -2.4, samples=1 if kind == "cosines" else 6), noise, bits)
    ratio = d.std(axis=0, ddof=1) / sigma
    # one node's ratio scatters by 1/sqrt(2 x 150) = 6 %, the median over ~1000 (70 independent) by 1 %
    for k in range(2):
        assert 0.96 < np.median(ratio[..., k]) < 1.04


def test_sigma_reaches_the_cramer_rao_bound():
    noise = Noise(read_grey=2.0)
    sensor = ResidualSensor(GRID, "cosines", noise, 8)
    d, _ = spread(sensor, observed(cosines, 0.3, 0.4), noise, 8)
    amplitude = 0.8 * 255 * 0.5 * 0.45
    slope_rms = amplitude * 2 * np.pi / PERIOD / np.sqrt(2)
    w = np.outer(triangle(PERIOD), triangle(PERIOD))
    bound = np.sqrt(2.0**2 + 1 / 12) * np.sqrt(np.sum(w**2)) / slope_rms
    measured = np.median(d.std(axis=0, ddof=1))
    # the carrier's phase in the weights makes single nodes differ by 2 %; statistics 1 %
    assert 0.96 < measured / bound < 1.04


def correlation(d, lag):
    """Of the noise of nodes `lag` apart along a row and along a column, per component."""
    e = d - d.mean(axis=0)
    along = np.mean(e[:, :, : e.shape[2] - lag] * e[:, :, lag:], axis=(0, 1, 2))
    down = np.mean(e[:, : e.shape[1] - lag] * e[:, lag:], axis=(0, 1, 2))
    return np.stack([along, down]) / np.mean(e**2, axis=(0, 1, 2))


@pytest.mark.parametrize(
    ("kind", "light", "gradients", "lags"),
    [
        ("cosines", observed(cosines), ("sine", "flat"), 5),
        # two carriers across each other: a sine along the component's own axis, a cosine along the other
        ("checker", observed(checker, samples=6), ("sine", "cosine"), 2),
    ],
)
def test_noise_correlation_of_neighbours(kind, light, gradients, lags):
    noise = Noise(read_grey=2.0)
    d, _ = spread(ResidualSensor(GRID, kind, noise, 8), light, noise, 8)
    own, other = (overlap_correlation(PERIOD, PERIOD // 2, gradient) for gradient in gradients)
    for lag in range(lags):
        # 150 frames x 70 independent samples: 1 %; without the carrier lag 1 is off by 0.02
        expected = [[own[lag], other[lag]], [other[lag], own[lag]]]
        np.testing.assert_allclose(correlation(d, lag), expected, atol=0.015)


def test_components_have_independent_noise():
    noise = Noise(read_grey=2.0)
    d, _ = spread(ResidualSensor(GRID, "cosines", noise, 8), observed(cosines, 0.3, 0.4), noise, 8)
    e = d - d.mean(axis=0)
    assert abs(np.mean(e[..., 0] * e[..., 1])) / np.mean(e**2) < 0.03  # 150 x 70 independent samples: 1 %


def test_exact_picture_has_quantisation_noise_only():
    residual = ResidualSensor(GRID, "cosines", Noise(), 8).measure(exposed(observed(cosines), 8))
    amplitude = 0.8 * 255 * 0.5 * 0.45
    expected = PERIOD / (np.sqrt(2) * np.pi * amplitude) * np.sqrt(np.sum(triangle(PERIOD) ** 2) ** 2 / 12)
    assert np.median(residual.sigma[INNER]) == pytest.approx(expected, rel=0.03)
