import numpy as np
import pytest

from zeromethod.warp.observable import gain, observable_part


def _window(f):
    return np.sinc(2 * f) ** 2


def _response(fx, fy, shape=(81, 81)):
    """Gain at the middle of a field that is one mode; edges are 40 nodes away."""
    row, col = np.indices(shape, dtype=float)
    mode = np.cos(2 * np.pi * (fx * (col - 40) + fy * (row - 40)))
    return observable_part(np.stack([mode, 2 * mode], axis=-1))[40, 40]


def test_what_the_window_sees_passes_and_what_it_does_not_see_is_removed():
    f = np.linspace(0, 0.5, 1001)
    H, W = gain(f), _window(f)
    assert np.abs(H - 1)[W > 0.5].max() < 1e-3
    assert np.abs(H)[W < 0.1].max() < 0.06
    assert H[(W > 0.15) & (W < 0.5)].min() > 0.2
    assert H.max() < 1.001
    assert abs(gain(0.5)) < 1e-12


@pytest.mark.parametrize(("fx", "fy"), [(0, 0), (0.1, 0), (0, 0.3), (0.17, 0.21), (0.4, 0.1), (0.5, 0.5)])
def test_the_filter_has_the_gain_it_states(fx, fy):
    expected = gain(fx) * gain(fy)
    np.testing.assert_allclose(_response(fx, fy), [expected, 2 * expected], atol=1e-12)  # rounding


def test_modes_that_the_window_misses_cannot_random_walk():
    """Per frame the error of a mode is multiplied by (1 - W) H; it must stay away from 1."""
    f = np.linspace(0, 0.5, 201)
    H = np.outer(gain(f), gain(f))
    W = np.outer(_window(f), _window(f))
    memory = np.abs((1 - W) * H)
    assert memory.max() < 0.8  # noise of one frame grows at most by 1 / sqrt(1 - 0.8^2) = 1.7


def test_cubics_away_from_edges_and_planes_everywhere_are_not_touched():
    row, col = np.indices((50, 60), dtype=float)
    x, y = col / 10, row / 10
    cubic = np.stack([1 + x - y + x * y * y + x**3, 100 + 0 * x], axis=-1)
    np.testing.assert_allclose(observable_part(cubic)[8:-8, 8:-8], cubic[8:-8, 8:-8], rtol=1e-13)
    plane = np.stack([3 + 2 * x - y, x + y], axis=-1)
    np.testing.assert_allclose(observable_part(plane), plane, atol=1e-13)


def test_a_held_dent_keeps_its_depth():
    row, col = np.indices((64, 64), dtype=float)
    dent = np.exp(-((row - 32) ** 2 + (col - 32) ** 2) / (2 * 8.0**2))
    truth = np.stack([dent, dent], axis=-1)
    q = truth
    for _ in range(300):
        q = observable_part(q + 0.8 * (truth - q))
    # sigma of 8 nodes: W > 0.9 up to f = 0.09; what one pass takes (5e-5), the next frame gives back
    assert abs(q[32, 32, 0] - 1) < 1e-4


def test_output_may_be_the_input():
    field = np.random.default_rng(0).normal(size=(33, 41, 2))
    expected = observable_part(field)
    assert observable_part(field, field) is field
    assert np.array_equal(field, expected)
