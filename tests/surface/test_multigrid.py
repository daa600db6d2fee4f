"""Graph Laplacians solved by multigrid, against dense pseudoinverses and planted solutions."""

import numpy as np
import pytest

from zeromethod.surface.integrate import largest_island
from zeromethod.surface.multigrid import LatticeSolution


def edges(island, generator=None, spread=0.0):
    """Weights across and down between nodes of an island, scattered by a factor exp(spread)."""
    both = island[:, :-1] & island[:, 1:], island[:-1] & island[1:]
    if generator is None:
        return [one.astype(float) for one in both]
    return [one * np.exp(spread * generator.standard_normal(one.shape)) for one in both]


def product(across, down, depth):
    """A D."""
    out = np.zeros_like(depth)
    for axis, weight in ((1, across), (0, down)):
        step = weight * np.diff(depth, axis=axis)
        first, second = (slice(None), slice(None, -1)), (slice(None), slice(1, None))
        out[first[:: 2 * axis - 1]] -= step
        out[second[:: 2 * axis - 1]] += step
    return out


def dense(across, down):
    rows, cols = across.shape[0], down.shape[1]
    units = np.eye(rows * cols).reshape(-1, rows, cols)
    return np.array([product(across, down, unit).ravel() for unit in units])


def comb(shape):
    """Teeth one node wide on a back one node wide: nothing that a coarse lattice could show."""
    island = np.zeros(shape, bool)
    island[::2] = True
    island[:, 5] = True
    return island


def ring(shape):
    """A disc that is tied to the rest by one node."""
    row, col = np.indices(shape)
    away = np.hypot(row - shape[0] / 2, col - shape[1] / 2)
    island = np.abs(away - 0.3 * shape[0]) > 1.0
    island[shape[0] // 2, shape[1] // 2 :] = True
    return island


def hole(shape):
    row, col = np.indices(shape)
    return np.hypot(row - shape[0] / 3, col - shape[1] / 2) > shape[0] / 8


def part(rows, cols):
    """Few nodes of a lattice, as where most of the view is dark."""

    def island(shape):
        out = np.zeros(shape, bool)
        out[3 : 3 + rows, 2 : 2 + cols] = True
        return out

    return island


MASKS = {
    "whole": lambda shape: np.ones(shape, bool),
    "salted": lambda shape: largest_island(np.random.default_rng(1).random(shape) > 0.25),
    "comb": comb,
    "ring": ring,
    "hole": hole,
    "square": part(6, 6),
    "line": part(1, 18),
}
SHAPES = (17, 22), (24, 25)
SMALL = [("whole", shape) for shape in ((2, 2), (2, 31), (31, 3))]


@pytest.mark.parametrize(("mask", "shape"), SMALL + [(mask, shape) for mask in MASKS for shape in SHAPES])
def test_it_is_the_pseudoinverse(mask, shape):
    generator = np.random.default_rng(0)
    island = MASKS[mask](shape)
    across, down = edges(island, generator, 1.0)
    rhs = np.where(island, generator.standard_normal((2, *shape)), 0.0)
    rhs -= island * rhs.sum(axis=(1, 2), keepdims=True) / np.count_nonzero(island)
    found = LatticeSolution.of(across, down).solve(rhs)
    expected = (np.linalg.pinv(dense(across, down)) @ rhs.reshape(2, -1).T).T.reshape(rhs.shape)
    found -= island * found[:, island].mean(axis=1)[:, None, None]
    # conditions of 1e4 and a share of 1e-11 in energy
    np.testing.assert_allclose(found[:, island], expected[:, island], atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("shape", [(125, 157), (250, 314), (500, 628)])
@pytest.mark.parametrize("mask", ["whole", "hole"])
def test_a_digit_takes_about_a_cycle_at_every_size(shape, mask):
    """A smooth planted depth comes back: the cycles that this takes must not grow with the lattice."""
    island = MASKS[mask](shape)
    row, col = np.indices(shape)
    depth = np.sin(3.0 * row / shape[0]) + np.cos(5.0 * col / shape[1])
    across, down = edges(island)
    found = LatticeSolution.of(across, down).solve(product(across, down, depth), most_cycles=9)
    assert np.ptp((found - depth)[island]) < 1e-8 * np.ptp(depth)


def test_islands_that_rounding_alone_ties_together_are_solved_in_any_unit():
    """A coarse node without edges keeps 1e-17 of the others', whose inverse single precision cannot hold."""
    generator = np.random.default_rng(7)
    whole = np.ones((17, 17), bool)
    islands = generator.random(whole.shape) < 0.6
    across, down = (1e-22 * one for one in edges(islands, generator, 1.0))
    depth = generator.standard_normal(whole.shape)
    force = product(across, down, depth)
    found = LatticeSolution.of(across, down).solve(force)
    # as in the other tests: a share of 1e-11 in energy
    np.testing.assert_allclose(product(across, down, found), force, atol=1e-8 * np.abs(force).max())


def test_what_is_not_solved_is_not_returned():
    depth = np.random.default_rng(0).standard_normal((17, 22))
    across, down = edges(np.ones((17, 22), bool))
    assert np.isnan(LatticeSolution.of(across, down).solve(product(across, down, depth), most_cycles=1)).all()
