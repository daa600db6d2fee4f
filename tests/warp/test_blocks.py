"""Means over blocks of nodes: against polynomials, quadrature, gaps, and the whole covariance."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from zeromethod.mechanics.gaussian_load import HalfSpace, Loads
from zeromethod.surface.block_readings import BlockReader
from zeromethod.surface.pass_result import PassResult
from zeromethod.surface.possible_dents import PossibleDents
from zeromethod.warp.blocks import Blocks

SHAPES = [(37, 52), (61, 40), (16, 16), (12, 20), (150, 130)]


def row_and_col(shape):
    return np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")


def polynomial(degree, row, col, shape):
    """All terms up to a degree along each axis, over the lattice's size."""
    a, b = row / shape[0], col / shape[1]
    draw = np.random.default_rng(degree)
    return sum(draw.standard_normal() * a**i * b**j for i in range(degree + 1) for j in range(degree + 1))


@pytest.mark.parametrize("shape", SHAPES)
def test_every_node_is_of_one_block_and_blocks_are_nearly_square(shape):
    blocks = Blocks.of(shape)
    count = blocks.sums(np.ones(shape))
    assert count.sum() == np.prod(shape)
    assert len(count) == blocks.count
    assert count.min() >= 1
    # rounded to whole nodes
    assert count.max() <= np.ceil(max(min(shape) / 15, 1.0) + 1) ** 2
    values = np.random.default_rng(0).standard_normal(blocks.count)
    np.testing.assert_allclose(blocks.sums(blocks.spread(values)), count * values)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("degree", [1, 2, 5])
def test_a_polynomials_mean_is_that_over_nine_places(shape, degree):
    blocks = Blocks.of(shape)
    row, col = row_and_col(shape)
    means, used = blocks.means(polynomial(degree, row, col, shape)[..., None], np.ones(shape, bool))
    assert used.all()
    (rows, weights), (cols, _) = blocks.places(row), blocks.places(col)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    at_places = (weights * polynomial(degree, rows, cols, shape)).sum(axis=1)
    # exact to the fifth degree, but for rounding
    np.testing.assert_allclose(means[:, 0], at_places, atol=1e-12)


@pytest.mark.parametrize("shape", [(90, 95), (150, 130)])
def test_gaps_in_a_block_leave_a_planes_mean_exact(shape):
    blocks = Blocks.of(shape)
    row, col = row_and_col(shape)
    planes = np.stack([np.full(shape, 3.0), row - 0.4 * col, 0.1 * row + 2.0 * col - 7.0], axis=-1)
    nodes = np.random.default_rng(3).uniform(size=shape) > 0.2
    exact, _ = blocks.means(planes, np.ones(shape, bool))
    means, used = blocks.means(np.where(nodes[..., None], planes, np.nan), nodes)
    assert 0.5 * blocks.count < np.count_nonzero(used)
    np.testing.assert_allclose(means[used], exact[used], atol=1e-9)


def test_a_block_with_less_than_half_of_its_nodes_is_left_out():
    blocks = Blocks.of((150, 130))
    nodes = np.ones((150, 130), bool)
    nodes[:25, :40] = False
    _, used = blocks.means(np.zeros((150, 130, 1)), nodes)
    share = blocks.sums(nodes.astype(float)) / blocks.sums(np.ones(nodes.shape))
    np.testing.assert_array_equal(used, share >= 0.5)
    assert 0 < np.count_nonzero(~used) < 20


def test_noise_of_means_is_that_of_the_nodes_whole_covariance():
    shape, along = (18, 33), np.array([1.0, 0.6, 0.15])
    blocks = Blocks.of(shape)
    down, across = (
        np.where(apart < 3, along[np.minimum(apart, 2)], 0.0)
        for apart in (np.abs(np.subtract.outer(np.arange(n), np.arange(n))) for n in shape)
    )
    whole = np.kron(down, across).reshape(*shape, -1)
    of_means, _ = blocks.means(whole, np.ones(shape, bool))
    of_means, _ = blocks.means(of_means.T.reshape(*shape, -1), np.ones(shape, bool))
    np.testing.assert_allclose(np.kron(*blocks.correlation(along)), of_means, atol=1e-12)


def lattice(shape=(60, 64), pitch_mm=0.7):
    """Mirror points of a lattice that leans and narrows, as cameras see it."""
    row, col = row_and_col(shape)
    return pitch_mm * (col + 0.05 * row - 2e-3 * row * col), pitch_mm * (row - 0.5 * shape[0])


def test_a_dents_means_are_those_over_all_nodes():
    x, y = lattice()
    blocks = Blocks.of(x.shape)
    size_mm = float(np.sqrt(np.ptp(x) * np.ptp(y) / blocks.count))
    loads = Loads(np.array([20.0, 31.0]), np.array([-3.0, 6.0]), size_mm * np.array([0.8, 3.0]))
    found = PossibleDents(HalfSpace(), loads, blocks, x, y).fields
    exact = HalfSpace().at(x.ravel(), y.ravel())(loads).reshape(3, *x.shape, 2)
    for field, all_nodes in zip(found, exact, strict=True):
        means, _ = blocks.means(all_nodes, np.ones(x.shape, bool))
        # the narrowest possible load changes by 1.25 of its widths in a block: terms of degree 6
        np.testing.assert_allclose(field, means, atol=1e-3 * np.abs(means).max())


def test_readings_are_means_at_the_points_of_rest():
    """Nodes moved by up to 0.2 mm: slope and depth change on the way, to first order."""
    x, y = lattice()
    scale = 1.0 + 1e-3 * x
    blocks = Blocks.of(x.shape)
    away = np.stack([0.2 * np.sin(y / 9.0), 0.15 * np.cos(x / 11.0)], axis=-1)

    def depth(x, y):
        return 0.1 * np.exp(-((x - 20.0) ** 2 + y**2) / 200.0)

    def slope(x, y):
        return -depth(x, y)[..., None] * np.stack([x - 20.0, y], axis=-1) / 100.0

    point = np.stack([x, y, 0.0 * x], axis=-1)
    point[..., :2] += away
    moved = point[..., 0], point[..., 1]
    island = np.ones(x.shape, bool)
    island[20:23, 30:34] = False
    there = island[..., None]
    read = PassResult(
        np.where(there, slope(*moved), np.nan),
        np.full((*x.shape, 2), 2e-12),
        np.where(there, point, np.nan),
        island,
        np.where(island, depth(*moved), 0.0),
    )
    found = BlockReader(blocks, x, y, scale).read(read)
    exact = BlockReader(blocks, x, y, scale).means(slope(x, y), depth(x, y) / scale, island)
    np.testing.assert_array_equal(found.used, exact.used)
    gaps = blocks.spread((blocks.sums((~island).astype(float)) > 0).astype(float)) > 0
    # differences of slopes reach a node into the gap
    whole = found.used & ~(blocks.sums(binary_dilation(gaps).astype(float)) > 0)
    # second order: 1/2 x 0.25^2 mm^2 of curvatures of 1e-3 / mm; of slopes, a tenth of that per mm
    np.testing.assert_allclose(found.ratio[whole], exact.ratio[whole], atol=4e-5)
    np.testing.assert_allclose(found.slope[whole], exact.slope[whole], atol=1e-5)
    # and without what moving changes depth would be off by some ten times as much
    means, _ = blocks.means((depth(*moved) / scale)[..., None], island)
    assert np.abs(means[whole, 0] - exact.ratio[whole]).max() > 3e-4
    np.testing.assert_allclose(found.variance[found.used], 2e-12, rtol=1e-9)
