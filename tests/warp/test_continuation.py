import numpy as np
import pytest

from zeromethod.warp.continuation import continue_smoothly


def _padded(shape, pad=4):
    valid = np.zeros(shape, dtype=bool)
    valid[pad:-pad, pad:-pad] = True
    return valid


def _spoilt(field, valid):
    return np.where(valid[..., None], field, np.nan)


def test_valid_nodes_keep_every_bit_and_nan_never_leaks():
    rng = np.random.default_rng(0)
    for share in (0.001, 0.02, 0.5, 0.98):
        valid = rng.random((61, 83)) < share
        field = rng.normal(size=(61, 83, 2))
        out = continue_smoothly(_spoilt(field, valid), valid)
        assert np.array_equal(out[valid], field[valid])
        assert np.isfinite(out).all()


def test_nothing_valid_gives_zeros_and_all_valid_gives_the_field():
    field = np.random.default_rng(1).normal(size=(20, 30, 2))
    nothing = np.zeros((20, 30), dtype=bool)
    assert np.array_equal(continue_smoothly(np.full_like(field, np.nan), nothing), np.zeros_like(field))
    assert np.array_equal(continue_smoothly(field, ~nothing), field)


def test_output_may_be_the_input():
    valid = _padded((30, 40))
    field = np.random.default_rng(2).normal(size=(30, 40, 2))
    expected = continue_smoothly(field, valid)
    assert continue_smoothly(field, valid, field) is field
    assert np.array_equal(field, expected)


def test_a_plane_goes_on_through_a_hole_and_into_the_padding():
    col, row = np.meshgrid(np.arange(60.0), np.arange(50.0))
    plane = np.stack([0.7 * col - 0.2 * row, 3 - 0.1 * col + 0.4 * row], axis=-1)
    valid = _padded(col.shape)
    valid[20:27, 30:37] = False
    error = np.abs(continue_smoothly(_spoilt(plane, valid), valid) - plane).max(axis=-1)
    # slopes of 0.7 per node; the fading over 40 nodes costs 2 % of what the plane rises beyond
    assert error[20:27, 30:37].max() < 0.02
    assert error[6:-6, :].max() < 0.06
    assert error.max() < 0.1


@pytest.mark.parametrize(("sigma_nodes", "tolerance"), [(6, 0.035), (8, 0.015), (16, 0.01)])
def test_a_dent_is_continued_through_a_hole_of_seven_nodes(sigma_nodes, tolerance):
    col, row = np.meshgrid(np.arange(60.0), np.arange(60.0))
    dent = np.exp(-((col - 30) ** 2 + (row - 30) ** 2) / (2 * sigma_nodes**2))
    for centre in (30, 30 + sigma_nodes):  # at the peak, on the steepest flank
        valid = np.ones(col.shape, dtype=bool)
        valid[27:34, centre - 3 : centre + 4] = False
        field = np.stack([dent, -dent], axis=-1)
        error = np.abs(continue_smoothly(_spoilt(field, valid), valid) - field)
        assert error.max() < tolerance  # share of the dent's height, as measured with a margin of 1.2


def test_noise_is_not_amplified_in_the_padding():
    rng = np.random.default_rng(3)
    valid = _padded((40, 40))
    runs = [continue_smoothly(rng.normal(size=(40, 40, 2)), valid) for _ in range(200)]
    spread = np.std(runs, axis=0).mean(axis=-1)
    # rims average 15 nodes for the slope and neighbours for the value; corners extrapolate both ways
    assert spread[0, 8:-8].mean() < 1.0
    assert spread.max() < 1.6


def test_a_small_island_does_not_run_away():
    rng = np.random.default_rng(4)
    valid = np.zeros((133, 165), dtype=bool)
    valid[60:65, 80:85] = True
    col, row = np.meshgrid(np.arange(165.0), np.arange(133.0))
    field = np.stack([col - 82, row - 62], axis=-1) + 0.1 * rng.normal(size=(133, 165, 2))
    out = continue_smoothly(_spoilt(field, valid), valid)
    assert np.abs(out).max() < 2 * 40  # slope 1 fades over 40 nodes; the far corner is 140 away
