"""From displacement to the bench's nodes: what single points that are not sure, and holes, leave of them."""

from dataclasses import replace

import numpy as np

from zeromethod.passive import Displacement, PointFlag
from zeromethod.passive.passive_warp import rest_pixels


def displaced() -> Displacement:
    """Every point moved by (2, 1) px, all valid."""
    u, v = np.meshgrid(2.0 + 5.0 * np.arange(40), 2.0 + 5.0 * np.arange(30))
    same = np.ones_like(u)
    sigma, doubts = 0.01 * same, np.zeros(u.shape, np.uint8)
    return Displacement(u, v, 2.0 * same, same, sigma, sigma, doubts, same, 500.0 * same, 1.0)


def nodes() -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.arange(20.0, 180.0, 8.0), np.arange(20.0, 130.0, 8.0))


def with_doubt(doubt: PointFlag, rows: slice, cols: slice) -> Displacement:
    found = displaced()
    doubts = found.doubts.copy()
    doubts[rows, cols] = np.uint8(doubt)
    return replace(found, doubts=doubts)


def test_a_single_point_that_is_less_sure_takes_no_node_away():
    u, v = nodes()
    for doubt in (PointFlag.TEXTURE, PointFlag.UNSETTLED):
        found = rest_pixels(with_doubt(doubt, slice(14, 15), slice(20, 22)), u, v)
        np.testing.assert_allclose(found, np.stack([u - 2.0, v - 1.0], axis=-1), atol=1e-6)


def test_what_does_not_match_and_larger_holes_are_not_bridged():
    u, v = nodes()
    for doubt, size in ((PointFlag.MISMATCH, 1), (PointFlag.ORDER, 1), (PointFlag.TEXTURE, 3)):
        found = rest_pixels(with_doubt(doubt, slice(14, 14 + size), slice(20, 20 + size)), u, v)
        assert np.isnan(found).any()
