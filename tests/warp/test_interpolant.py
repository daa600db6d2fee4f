import numpy as np

from zeromethod.warp.interpolant import keys, sample, window_matched


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
        np.testing.assert_allclose(keys(t), expected, atol=1e-15)  # rounding


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


def test_what_is_drawn_has_the_nodes_values_in_the_mean_over_a_window():
    col, row = np.meshgrid(np.arange(40.0), np.arange(32.0))
    wave = np.stack([np.cos(0.4 * col + 0.7), np.cos(0.4 * row - 0.2)], axis=-1)
    drawn = np.empty_like(wave)
    window_matched(wave, drawn)
    offset = (np.arange(-15, 16)) / 8
    weights = np.outer(16 - 8 * np.abs(offset), 16 - 8 * np.abs(offset))
    weights /= weights.sum()
    y, x = np.meshgrid(16 + offset, 19 + offset, indexing="ij")

    def mean_loss(nodes):
        seen = np.einsum("rc,rck->k", weights, sample(nodes, x, y))
        exact = np.stack([np.cos(0.4 * x + 0.7), np.cos(0.4 * y - 0.2)], axis=-1)
        whole = np.einsum("rc,rck->k", weights, exact)
        return 1 - seen / whole

    # k^4 / 80 before, a sixth-order remainder of 5e-4 k^6 after
    np.testing.assert_allclose(mean_loss(wave), 0.4**4 / 80, rtol=0.05)
    assert np.abs(mean_loss(drawn)).max() < 5e-6


def test_matching_leaves_cubics_and_missing_nodes_alone():
    q = _nodes(lambda x, y: np.stack([x**3 - y, x * y * y], axis=-1))
    out = np.empty_like(q)
    window_matched(q, out)
    np.testing.assert_allclose(out, q, rtol=1e-12)
    q[5, 7] = np.nan
    window_matched(q, out)
    assert np.isnan(out[5, 7]).all()
    assert np.count_nonzero(np.isnan(out)) == 2
