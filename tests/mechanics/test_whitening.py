"""Correlated noise of two halves made white: covariance, way back, weights and volume."""

import numpy as np
import pytest

from zeromethod.mechanics.whitening import Whitening

N = 9


def of_two_halves():
    draw = np.random.default_rng(1)
    apart = np.subtract.outer(np.arange(N), np.arange(N))
    halves = np.exp(-(apart**2) / 8.0) + 0.1 * np.eye(N), 4.0 * np.exp(-np.abs(apart) / 2.0)
    more = draw.uniform(0.0, 0.5, 2 * N)
    whole = np.diag(more)
    whole[:N, :N] += halves[0]
    whole[N:, N:] += halves[1]
    return Whitening(halves, more), whole, draw


def test_its_noise_becomes_white():
    white, whole, _ = of_two_halves()
    half = white(np.eye(2 * N))
    # W C W' of the whole covariance, to rounding
    np.testing.assert_allclose(half @ whole @ half.T, np.eye(2 * N), atol=1e-12)


def test_the_way_back_ends_where_it_began():
    white, _, draw = of_two_halves()
    values = draw.standard_normal(2 * N)
    np.testing.assert_allclose(white.back(white(values)), values, atol=1e-12)


def test_weights_for_values_do_what_those_for_white_ones_do():
    white, _, draw = of_two_halves()
    values, weights = draw.standard_normal((2, 2 * N))
    assert white.weights(weights) @ values == pytest.approx(weights @ white(values), rel=1e-12)


def test_the_volume_lost_is_the_root_of_the_determinant():
    white, whole, _ = of_two_halves()
    assert white.log_size == pytest.approx(0.5 * np.linalg.slogdet(whole)[1], rel=1e-12)
