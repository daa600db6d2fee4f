import numpy as np

from zeromethod.warp.compose import compose
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import sample

GRID = NodeGrid((256, 320))


def _q(u, v):
    return np.stack([30 + 0.8 * u + 1e-4 * u * v, 20 + 0.7 * v - 2e-4 * u * u], axis=-1)


def test_composing_agrees_with_reading_between_the_nodes():
    rng = np.random.default_rng(1)
    shown, d = rng.normal(size=(2, *GRID.shape, 2))
    row, col = np.indices(GRID.shape, dtype=float)
    expected = sample(shown, col + d[..., 0] / 8, row + d[..., 1] / 8)
    np.testing.assert_allclose(compose(shown, d, 8), expected, atol=1e-14)  # rounding


def test_no_residual_returns_the_shown_warp_bit_for_bit():
    shown = np.random.default_rng(2).normal(size=(*GRID.shape, 2))
    out = compose(shown, np.zeros_like(shown), 8)
    assert np.array_equal(out[1:-1, 1:-1], shown[1:-1, 1:-1])
    assert np.isnan(out[0]).all()
    assert np.isnan(out[:, -1]).all()


def test_what_was_not_measured_or_lies_outside_is_nan():
    u, v = GRID.mesh()
    d = np.zeros((*GRID.shape, 2))
    d[10, 12] = np.nan
    d[5, 1, 0] = -1e-6
    q = compose(_q(u, v), d, GRID.spacing_px)
    assert np.isnan(q[10, 12]).all()
    assert np.isnan(q[5, 1]).all()
    assert np.isfinite(q[5, 2]).all()
