import numpy as np
import pytest
from surface_bench import Gauss

from zeromethod.surface.integrate import SlopeIntegrator, largest_island

SHAPE = (90, 110)
PITCH = 0.35
DENT = Gauss(1.0, 25.0, 13.4, 16 * PITCH)


def irregular_points(shape=SHAPE):
    """Points of a lattice stretched and bent as a camera sees a tilted mirror."""
    j, i = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    x = 0.40 * j + 0.0004 * j**2 + 0.3 * np.cos(i / 40)
    y = 0.30 * i + 0.3 * np.sin(j / 50)
    return x, y


def integrated(dent, valid, variance=None):
    x, y = irregular_points(valid.shape)
    integrator = SlopeIntegrator(x, y)
    island = integrator.prepare(valid, np.ones((*valid.shape, 2)) if variance is None else variance)
    slope = np.where(valid[..., None], np.stack(dent.slope(x, y), axis=-1), np.nan)
    return integrator.integrate(slope, x, y), dent.depth(x, y), island


def spread(depth, truth, island):
    return np.ptp((depth - truth)[island])


def holed():
    valid = np.ones(SHAPE, bool)
    valid[30:45, 50:62] = False
    valid[60, 10:80] = False
    return valid


# PITCH is the lattice's mean; where it is widest the narrowest dent has 2.8 nodes.
# A trapezoid errs by 5e-3 at 4 nodes.
# What the sixth-order rule leaves, 191/60480 w^6 with w = 1 / sigma in nodes, summed over the spectrum.
@pytest.mark.parametrize(("nodes", "bar"), [(4, 1e-4), (6, 1e-5), (16, 1e-7), (64, 1e-7)])
def test_gaussians_of_every_width_come_back_whole(nodes, bar):
    dent = Gauss(1.0, 25.03, 13.4, nodes * PITCH)
    depth, truth, island = integrated(dent, np.ones(SHAPE, bool))
    assert spread(depth, truth, island) < bar


def test_holes_are_not_reached_over():
    valid = holed()
    depth, truth, island = integrated(DENT, valid)
    np.testing.assert_array_equal(island, valid)
    # one-sided cubic rule next to the hole: 19/720 w^4, w = 1/16, a few edges add up
    assert spread(depth, truth, island) < 2e-5


def test_scattered_dropouts_cost_little():
    valid = np.random.default_rng(3).random(SHAPE) > 0.05
    depth, truth, island = integrated(DENT, valid)
    assert np.count_nonzero(island) > 0.94 * valid.size
    # many short runs with rules of low order: a thousandth of the peak at most
    assert spread(depth, truth, island) < 1e-3


def test_islands_cut_off_are_left_out():
    valid = np.ones((40, 50), bool)
    valid[:, 30] = False
    _, _, island = integrated(Gauss(1.0, 5.0, 5.0, 4.0), valid)
    assert island[:, :30].all()
    assert not island[:, 30:].any()
    diagonal = np.eye(3, dtype=bool)
    assert np.count_nonzero(largest_island(diagonal)) == 1


def test_nothing_valid_gives_nothing():
    _, _, island = integrated(Gauss(1.0, 5.0, 5.0, 4.0), np.zeros((40, 50), bool))
    assert not island.any()


def test_weights_favour_the_precise_reading():
    """A strip of bad slopes is overruled when its variance says so."""
    x, y = irregular_points()
    slope = np.stack(DENT.slope(x, y), axis=-1)
    slope[40:50, 20:60] += 0.05
    variance = np.ones((*SHAPE, 2))
    variance[38:52, 18:62] = 1e6
    errors = []
    for weights in (np.ones_like(variance), variance):
        integrator = SlopeIntegrator(x, y)
        integrator.prepare(np.ones(SHAPE, bool), weights)
        error = integrator.integrate(slope, x, y) - DENT.depth(x, y)
        outside = np.ones(SHAPE, bool)
        outside[36:54, 16:64] = False
        errors.append(np.ptp(error[outside]))
    assert errors[1] < 1e-3 * errors[0]


def test_kept_factors_follow_a_changing_mask():
    x, y = irregular_points()
    slope = np.stack(DENT.slope(x, y), axis=-1)
    integrator = SlopeIntegrator(x, y)
    for row in (10, 20, 30):
        valid = np.ones(SHAPE, bool)
        valid[row, 5:9] = False
        island = integrator.prepare(valid, np.ones((*SHAPE, 2)))
        depth = integrator.integrate(slope, x, y)
        assert spread(depth, DENT.depth(x, y), island) < 2e-5
        assert not island[row, 6]


def test_linear_part_and_its_transpose():
    """sum(weights * depth(s)) = sum(slope_weights(weights) * s) where weights add up to 0, with holes."""
    x, y = irregular_points()
    valid = holed()
    integrator = SlopeIntegrator(x, y)
    generator = np.random.default_rng(0)
    integrator.prepare(valid, generator.uniform(0.5, 2.0, (*SHAPE, 2)))
    linear = integrator.linear(x, y)
    slope = generator.standard_normal((*SHAPE, 2))
    weights = np.where(valid, generator.standard_normal(SHAPE), 0.0)
    weights -= valid * weights.sum() / valid.sum()
    there = (weights * linear.depth(slope)).sum()
    back = (linear.slope_weights(weights) * slope).sum()
    assert there == pytest.approx(back, rel=1e-9)
    np.testing.assert_allclose(linear.depth(slope), integrator.integrate(slope, x, y), atol=1e-12)
