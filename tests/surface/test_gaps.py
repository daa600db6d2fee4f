import numpy as np
import pytest

from zeromethod.surface.gaps import gaps_between


def dish(shape=(12, 14), bend=(0.003, -0.002), tilt=(0.01, 0.02)):
    """Depth, slope and points of a quadratic: slopes linear, so that steps are exact."""
    j, i = np.meshgrid(np.arange(float(shape[1])), np.arange(float(shape[0])))
    x, y = 0.4 * j + 0.02 * i, 0.5 * i
    depth = tilt[0] * x + tilt[1] * y + 0.5 * (bend[0] * x**2 + bend[1] * y**2)
    slope = np.stack([tilt[0] + bend[0] * x, tilt[1] + bend[1] * y], axis=-1)
    return depth, slope, np.stack([x, y], axis=-1)


@pytest.mark.parametrize("width", [1, 2, 4])
def test_steps_over_a_gap_are_exact_for_a_quadratic(width):
    depth, slope, point = dish()
    near, far = np.zeros(depth.shape, bool), np.zeros(depth.shape, bool)
    near[:, :5] = True
    far[:, 5 + width :] = True
    gaps = gaps_between(near, far)
    assert len(gaps) == depth.shape[0]
    assert near[gaps.near].all()
    assert far[gaps.far].all()
    step, sigma = gaps.steps(slope, point)
    np.testing.assert_allclose(step, depth[gaps.far] - depth[gaps.near], rtol=1e-12)
    assert (sigma > 0).all()


def test_columns_and_both_directions_are_found():
    mask = np.ones((9, 9), bool)
    mask[4] = False
    depth, slope, point = dish((9, 9))
    gaps = gaps_between(mask, mask)
    assert np.array_equal(np.unique(gaps.near[0]), [3, 5])
    np.testing.assert_allclose(gaps.steps(slope, point)[0], depth[gaps.far] - depth[gaps.near], rtol=1e-12)


def test_no_gap_is_seen_through_measured_nodes_or_over_a_wide_one():
    near, far = np.zeros((8, 12), bool), np.zeros((8, 12), bool)
    near[:, :3], far[:, 8:] = True, True
    assert len(gaps_between(near, far)) == 0
    far[:, 4] = True
    # the near side of far's first column alone: what lies behind it is hidden by it
    assert np.array_equal(np.unique(gaps_between(near, far).far[1]), [4])
