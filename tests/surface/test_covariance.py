"""The full covariance against draws of the noise and against its own parts."""

import numpy as np
import pytest
from surface_bench import Bench, Gauss, Tail, small_rig

from zeromethod.errors import InputError
from zeromethod.rig.model import KnownRest

DRAWS = 400
RIM = KnownRest(x_mm=(62.0, 77.0), y_mm=(-30.0, 30.0))


@pytest.fixture(scope="module")
def drawn():
    """One pressed bench with a rim known to be at rest: depths and slopes of all draws, and a covariance."""
    bench = Bench(small_rig(known_rest=(RIM,)))
    dent = Gauss(0.2, 38.0, 0.0, 5.0)
    generator = np.random.default_rng(5)
    depths, slopes, surface = [], [], None
    for _ in range(DRAWS):
        surface = bench.reader.read(bench.warp(dent, generator), surface)
        depths.append(surface.depth_mm)
        slopes.append(surface.slope)
    depths, slopes = np.array(depths), np.array(slopes)
    return (
        bench,
        depths - depths.mean(axis=0),
        slopes - slopes.mean(axis=0),
        surface,
        bench.reader.covariance(surface),
    )


def one(shape, row, col):
    weights = np.zeros(shape)
    weights[row, col] = 1.0
    return weights


# 400 draws know a standard deviation to 3.5 % and a correlation to 5 %; bars at three of these
PEAK, NODES = (18, 19), [(18, 20), (18, 24), (10, 12), (25, 30), (18, 34), (5, 5)]


@pytest.mark.parametrize("node", NODES)
def test_differences_of_two_nodes(drawn, node):
    bench, depths, _, _, covariance = drawn
    shape = bench.grid.shape
    weights = one(shape, *PEAK) - one(shape, *node)
    difference = depths[:, *PEAK] - depths[:, *node]
    stated = covariance.variance_of(weights)
    assert np.sqrt(stated.noise) == pytest.approx(difference.std(), rel=0.11)
    assert stated.anchor == 0.0


def test_correlation_of_the_peak_with_all_others(drawn):
    _, depths, _, surface, covariance = drawn
    row = covariance.with_node(*PEAK).noise
    v = surface.valid
    measured = np.einsum("nk,n->k", depths[:, v], depths[:, *PEAK]) / DRAWS
    sigma = surface.sigma_depth_mm[v] * surface.sigma_depth_mm[PEAK]
    off = (row[v] - measured) / sigma
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert np.abs(off).max() < 0.25
    # neighbours share most of the noise, the rim's other end none of it
    stated = row / surface.sigma_depth_mm[PEAK] / surface.sigma_depth_mm
    assert stated[18, 20] > 0.8
    assert abs(stated[18, 35]) < 0.3


@pytest.mark.parametrize("patch", [(slice(8, 14), slice(10, 18)), (slice(15, 22), slice(16, 23))])
def test_means_over_patches(drawn, patch):
    bench, depths, _, _, covariance = drawn
    weights = np.zeros(bench.grid.shape)
    weights[patch] = 1.0 / weights[patch].size
    mean = (depths[:, *patch]).mean(axis=(1, 2))
    assert np.sqrt(covariance.variance_of(weights).noise) == pytest.approx(mean.std(), rel=0.11)


def test_slopes_with_a_depth(drawn):
    bench, depths, slopes, surface, covariance = drawn
    v = surface.valid
    stated = covariance.slope_with_mean(one(bench.grid.shape, *PEAK))[v]
    measured = np.einsum("nki,n->ki", slopes[:, v], depths[:, *PEAK]) / DRAWS
    scale = surface.sigma_slope[v] * surface.sigma_depth_mm[PEAK]
    assert np.sqrt(np.mean(((stated - measured) / scale) ** 2)) < 0.1
    # a slope beside the peak is what the peak is made of
    assert np.abs(stated / scale).max() > 0.3


def test_a_row_is_the_covariance_with_a_single_node_and_symmetric(drawn):
    bench, _, _, _, covariance = drawn
    a, b = covariance.with_node(18, 19), covariance.with_node(10, 12)
    assert a.noise[10, 12] == pytest.approx(b.noise[18, 19], rel=1e-6)
    both = one(bench.grid.shape, 18, 19) + one(bench.grid.shape, 10, 12)
    expected = a.noise[18, 19] + b.noise[10, 12] + 2 * a.noise[10, 12]
    assert covariance.variance_of(both).noise == pytest.approx(expected, rel=1e-6)


def test_the_anchors_part_is_one_multiple_of_h():
    """Another constant lifts every node together: it does not enter differences at equal h."""
    bench = Bench(small_rig())
    surface = bench.reader.read(bench.warp(Tail(0.2, bench.centre_mm, 0.0, 3.0)))
    covariance = bench.reader.covariance(surface)
    h = np.ones(bench.grid.shape)
    h[bench.grid.inner] = bench.reader.scale
    v = surface.valid
    row = covariance.with_node(18, 19)
    outer = row.anchor[v] / h[18, 19] / h[v]
    np.testing.assert_allclose(outer, outer[0], rtol=1e-9)
    typical = np.sqrt(outer[0] * np.mean(h[v] ** 2))
    assert typical == pytest.approx(surface.anchor.sigma_mm, rel=1e-6)
    difference = one(bench.grid.shape, 18, 19) / h[18, 19] - one(bench.grid.shape, 18, 30) / h[18, 30]
    assert covariance.variance_of(difference).anchor == pytest.approx(0.0, abs=1e-20)
    total = covariance.variance_of(one(bench.grid.shape, 18, 19))
    assert total.sigma == pytest.approx(surface.sigma_depth_mm[18, 19], rel=0.02)


def test_it_outlives_the_next_reading(drawn):
    bench, _, _, _, covariance = drawn
    weights = one(bench.grid.shape, *PEAK)
    before = covariance.variance_of(weights)
    warp = bench.warp(Gauss(0.0, 38.0, 0.0, 5.0))
    warp.flags[10:14, 10:14] |= np.uint16(8)
    bench.reader.read(warp)
    assert covariance.variance_of(weights) == before


def test_what_cannot_be_answered_is_refused(drawn):
    bench, _, _, surface, covariance = drawn
    bench.reader.read(bench.warp(Gauss(0.0, 38.0, 0.0, 5.0)))
    with pytest.raises(InputError, match="not the one last read"):
        bench.reader.covariance(surface)
    with pytest.raises(InputError, match="weights: shape"):
        covariance.variance_of(np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"node: \(0, 0\)"):
        covariance.with_node(0, 0)
