import numpy as np

from zeromethod.warp.interpolant import keys_weights, sample


def _nodes(function, rows=12, cols=15):
    col, row = np.meshgrid(np.arange(cols, dtype=float), np.arange(rows, dtype=float))
    return function(col, row)


def _positions(rows=12, cols=15, count=500):
    rng = np.random.default_rng(0)
    return rng.uniform(1, cols - 2, count), rng.uniform(1, rows - 2, count)


def test_weights_are_keys_kernel_with_a_minus_one_half():
    def kernel(x):
        x = abs(x)
        return 1.5 * x**3 - 2.5 * x**2 + 1 if x <= 1 else -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2

    for t in np.linspace(0, 1, 11):
        expected = [kernel(t + 1), kernel(t), kernel(1 - t), kernel(2 - t)]
        np.testing.assert_allclose(keys_weights(t), expected, atol=1e-15)  # rounding


def test_biquadratic_fields_come_back_exactly():
    def field(x, y):
        return np.stack([1 + 2 * x - y + 0.3 * x * x * y * y, x * y - y * y, 5 + 0 * x], axis=-1)

    col, row = _positions()
    # rounding: values reach 6000
    np.testing.assert_allclose(sample(_nodes(field), col, row), field(col, row), atol=1e-10)


def test_error_falls_with_the_third_power_of_the_spacing():
    errors = []
    for cells in (20, 40):
        x = np.sin(2 * np.pi * np.arange(cells + 5) / cells)
        at = np.linspace(1, cells + 2, 997)
        line = sample(np.tile(x[None, :, None], (6, 1, 1)), at, np.full_like(at, 2.5))[:, 0]
        errors.append(np.abs(line - np.sin(2 * np.pi * at / cells)).max())
    assert errors[0] / errors[1] > 7.5  # 8 to leading order


def test_nodes_come_back_bit_for_bit_up_to_the_last_whole_support():
    field = np.random.default_rng(1).normal(size=(9, 11, 2))
    col, row = np.meshgrid(np.arange(1, 10), np.arange(1, 8))
    assert np.array_equal(sample(field, col, row), field[1:-1, 1:-1])


def test_outside_of_whole_supports_and_beside_nan_there_is_no_value():
    field = np.ones((9, 11, 2))
    field[4, 5] = np.nan
    assert np.isnan(sample(field, [0.99, 9.01, 5, 5, np.nan], [4, 4, 0.99, 7.01, 2])).all()
    assert np.isnan(sample(field, 6.5, 4.5)).all()
    assert np.array_equal(sample(field, 8.5, 4.5), [1, 1])
