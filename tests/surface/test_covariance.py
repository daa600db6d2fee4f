"""The full covariance against draws of the noise and its own parts; of sums: acceptance/test_sigma.py."""

import numpy as np
import pytest
from surface_bench import Bench, Gauss, Tail, small_rig

from zeromethod.errors import InputError
from zeromethod.rig.model import KnownRest

DRAWS = 400
RIM = KnownRest(x_mm=(62.0, 77.0), y_mm=(-30.0, 30.0))


@pytest.fixture(scope="module")
def drawn():
    """One pressed bench with a rim known to be at rest: depths of all draws, and a covariance."""
    bench = Bench(small_rig(known_rest=(RIM,)))
    dent = Gauss(0.2, 38.0, 0.0, 5.0)
    generator = np.random.default_rng(5)
    depths, surface = [], None
    for _ in range(DRAWS):
        surface = bench.reader.read(bench.warp(dent, generator), surface)
        depths.append(surface.depth_mm)
    return bench, np.array(depths) - np.mean(depths, axis=0), surface, bench.reader.covariance(surface)


def one(shape, row, col):
    weights = np.zeros(shape)
    weights[row, col] = 1.0
    return weights


# 400 draws know a standard deviation to 3.5 % and a correlation to 5 %; bars at three of these
PEAK = (18, 19)


def test_correlation_of_the_peak_with_all_others(drawn):
    bench, depths, surface, covariance = drawn
    row = covariance.with_mean(one(bench.grid.shape, *PEAK)).noise
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


def test_a_row_is_the_covariance_with_a_single_node_and_symmetric(drawn):
    bench, _, _, covariance = drawn
    here, there = one(bench.grid.shape, 18, 19), one(bench.grid.shape, 10, 12)
    a, b = covariance.with_mean(here), covariance.with_mean(there)
    assert a.noise[10, 12] == pytest.approx(b.noise[18, 19], rel=1e-6)
    expected = a.noise[18, 19] + b.noise[10, 12] + 2 * a.noise[10, 12]
    assert covariance.variance_of(here + there).noise == pytest.approx(expected, rel=1e-6)


def test_the_anchors_part_is_one_multiple_of_h(small):
    """Another constant lifts every node together: it does not enter differences at equal h."""
    dent = Tail(0.2, small.centre_mm, 0.0, 3.0)
    surface = small.reader.read(small.warp(dent, np.random.default_rng(1)))
    covariance = small.reader.covariance(surface)
    shape, v, h = small.grid.shape, surface.valid, small.grid.padded(small.reader.scale, 1.0)
    row = covariance.with_mean(one(shape, 18, 19))
    outer = row.anchor[v] / h[18, 19] / h[v]
    np.testing.assert_allclose(outer, outer[0], rtol=1e-9)
    typical = np.sqrt(outer[0] * np.mean(h[v] ** 2))
    assert typical == pytest.approx(surface.anchor.sigma_mm, rel=1e-6)
    difference = one(shape, 18, 19) / h[18, 19] - one(shape, 18, 30) / h[18, 30]
    assert covariance.variance_of(difference).anchor == pytest.approx(0.0, abs=1e-20)
    total = covariance.variance_of(one(shape, 18, 19))
    assert total.sigma == pytest.approx(surface.sigma_depth_mm[18, 19], rel=0.02)


def test_it_outlives_the_next_reading(drawn):
    bench, _, _, covariance = drawn
    weights = one(bench.grid.shape, *PEAK)
    before = covariance.variance_of(weights)
    warp = bench.warp(Gauss(0.0, 38.0, 0.0, 5.0))
    warp.flags[10:14, 10:14] |= np.uint16(8)
    bench.reader.read(warp)
    assert covariance.variance_of(weights) == before


def test_what_cannot_be_answered_is_refused(drawn):
    bench, _, surface, covariance = drawn
    bench.reader.read(bench.warp(Gauss(0.0, 38.0, 0.0, 5.0)))
    with pytest.raises(InputError, match="not the one last read"):
        bench.reader.covariance(surface)
    with pytest.raises(InputError, match="weights: shape"):
        covariance.variance_of(np.zeros((3, 3)))
