"""Dents that noise hides node by node: what the sum over the view says of them."""

import numpy as np
import pytest

from zeromethod.surface.weak_dents import weak_far_field

ROWS, COLS, NOISE = 29, 37, 1e-5
Y, X = np.mgrid[:ROWS, :COLS].astype(float)
FAR = np.where(X >= 30, 1.0 / (7 * ROWS), 0.0)
"""Weights of an anchor at one side."""
ISLAND = np.ones((ROWS, COLS), bool)


def far_field(depth_mm, seed, size_mm=2.0, at=(10.0, 14.0)):
    """(mean, sigma, true depth) at the anchor, mm, of a dent of 1 / r and slopes' noise of 1e-5 rad."""
    to_x, to_y = X - at[0], Y - at[1]
    shape = 1.0 / np.sqrt(1.0 + (to_x**2 + to_y**2) / size_mm**2)
    steep = -depth_mm * shape**3 / size_mm**2
    noise = np.random.default_rng(seed).normal(0.0, NOISE, (ROWS, COLS, 2))
    slope = np.stack([steep * to_x, steep * to_y], axis=-1) + noise
    flat = np.zeros((ROWS, COLS, 2))
    scale, variance = np.ones((ROWS, COLS)), np.full((ROWS, COLS, 2), NOISE**2)
    found = weak_far_field(FAR, scale, slope, flat, 0.0, variance, ISLAND, X, Y, 1.0)
    return *found, float((FAR * depth_mm * shape).sum())


def test_an_untouched_mirror_keeps_its_anchor():
    found = np.array([far_field(0.0, seed) for seed in range(40)])
    # noise of depth between two sides of the view, 37 steps of 1e-5 rad each, averaged across: some 20 nm
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 3e-6
    assert np.sqrt(np.mean(found[:, 1] ** 2)) < 1e-5


@pytest.mark.parametrize("depth_mm", [2e-4, 5e-4, 2e-3])
def test_a_dent_that_shows_at_no_node_is_within_what_is_said_of_the_anchor(depth_mm):
    # steepest, its slope is 0.4 to 4 times one node's noise
    found = np.array([far_field(depth_mm, seed) for seed in range(20)])
    # depth's own noise between two sides of the view is stated apart: some 10 nm
    off = (found[:, 0] - found[:, 2]) / np.hypot(found[:, 1], 1e-5)
    # it lies half as deep as 1 / r has it, give or take as much: 1 / r itself is one sigma off
    assert np.abs(off).max() < 2.0
    assert np.median(found[:, 1]) < found[0, 2]


def test_a_dent_that_falls_faster_is_within_it_too():
    size_mm, depth_mm = 4.0, 1e-3
    to_x, to_y = X - 12.0, Y - 14.0
    shape = depth_mm * np.exp(-0.5 * (to_x**2 + to_y**2) / size_mm**2)
    noise = np.random.default_rng(3).normal(0.0, NOISE, (ROWS, COLS, 2))
    slope = np.stack([-shape * to_x, -shape * to_y], axis=-1) / size_mm**2 + noise
    flat, variance = np.zeros((ROWS, COLS, 2)), np.full((ROWS, COLS, 2), NOISE**2)
    mean, sigma = weak_far_field(FAR, np.ones((ROWS, COLS)), slope, flat, 0.0, variance, ISLAND, X, Y, 1.0)
    assert abs(mean) < 1.5 * sigma
