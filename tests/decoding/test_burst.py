"""Places read from a burst's pictures, made here from planted warps: bent, folded, torn, out of reach."""

from __future__ import annotations

import numpy as np
import pytest

from zeromethod.decoding.burst import RADIUS_PX, node_places, pixel_places
from zeromethod.pattern.coded import PERIODS_LCD_PX, PICTURES, SHIFTS, Coded

BLACK, MEAN, CONTRAST, NOISE = 8.0, 100.0, 0.9, 2.0
V, U = np.mgrid[0:120, 0:160].astype(float)
RIM = np.ones(U.shape, bool)
RIM[20:-20, 20:-20] = False


def pictures(q: np.ndarray, seed: int = 0) -> np.ndarray:
    """(16, rows, cols) grey levels of pixels that look at `q` (rows, cols, 2) LCD px."""
    draw = np.random.default_rng(seed)
    out = np.empty((PICTURES, *U.shape), np.float32)
    for number in range(PICTURES):
        axis, period = number // (PICTURES // 2), PERIODS_LCD_PX[number // SHIFTS % 2]
        phase = 2 * np.pi * q[..., axis] / period - 2 * np.pi * (number % SHIFTS) / SHIFTS
        out[number] = BLACK + MEAN * (1 + CONTRAST * np.cos(phase))
    return np.rint(out + NOISE * draw.standard_normal(out.shape)).astype(np.float32)


def dent(depth_px: float, size_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Warp of rest, and displaced by a Gaussian's slopes; it folds from depth = size^2 / 1.4 on."""
    rest = np.stack([300 + 0.57 * U, 200 + 0.57 * V], axis=-1)
    x, y = (U - 80) / size_px, (V - 60) / size_px
    along = depth_px / size_px * np.exp(-0.5 * (x**2 + y**2))
    return rest, rest + np.stack([along * x, along * y], axis=-1)


def test_numbers_say_axis_period_and_shift() -> None:
    read = {
        (one.axis, one.period_px, round(one.shift_rad, 6))
        for one in (Coded(k, np.zeros((0, 4))) for k in range(PICTURES))
    }
    assert len(read) == PICTURES


@pytest.mark.parametrize("depth_px", [100.0, 700.0, -700.0])
def test_places_are_read_through_folds_without_a_wrong_order(depth_px: float) -> None:
    thought, q = dent(depth_px, 16.0)
    folds = np.diff(q[60, :, 0]).min() < 0 or np.diff(q[60, :, 0]).max() > 2
    assert folds == (abs(depth_px) > 500)
    places, known = pixel_places(pictures(q), BLACK, thought, RIM)
    off = np.abs(places - q).max(axis=-1)
    # phase noise of 2 grey levels in 90: 0.05 LCD px a pixel; a wrong order is 3 px off and more
    assert off[known].max() < 0.5
    assert known.mean() > 0.99


def test_what_is_out_of_reach_is_not_read() -> None:
    """Displaced by up to 90 LCD px at slopes that look right: no pixel is read wrong."""
    thought, q = dent(2400.0, 16.0)
    assert np.abs(q - thought).max() > 65.0
    places, known = pixel_places(pictures(q), BLACK, thought, RIM)
    assert np.abs(places - q)[known].max() < 0.5
    assert known[RIM].mean() > 0.99


def test_an_island_that_nothing_joins_to_what_is_known_is_not_read() -> None:
    rest, _ = dent(0.0, 16.0)
    q = rest.copy()
    q[40:80, 60:100] += 15.0
    _, known = pixel_places(pictures(q), BLACK, rest, RIM)
    assert not known[42:78, 62:98].any()
    assert known[RIM].all()


def test_without_fringes_nothing_is_read() -> None:
    rest, q = dent(100.0, 16.0)
    seen = pictures(q)
    seen[:, 30:60, 40:70] = 90.0
    _, known = pixel_places(seen, BLACK, rest, RIM)
    assert not known[31:59, 41:69].any()


def test_a_pixel_that_sees_past_the_lcds_pixels_is_not_read_and_a_shadow_is() -> None:
    """With half of its light gone a pixel sees beside its middle; a smooth shadow moves nothing."""
    rest, q = dent(100.0, 16.0)
    gaps = np.zeros(U.shape, bool)
    gaps[30:90:7, 40:120:5] = True
    q[gaps] += 1.5
    light = np.where(gaps, 0.5, 1.0) * (1 - 0.5 * U / U.max())
    seen = (BLACK + light * (pictures(q) - BLACK)).astype(np.float32)
    places, known = pixel_places(seen, BLACK, rest, RIM)
    # the next ones stay: phase noise of 2 grey levels in 45 is 0.1 LCD px a pixel
    assert not known[gaps].any()
    assert known[~gaps].mean() > 0.99
    assert np.abs(places - q).max(axis=-1)[known].max() < 0.5


def test_nodes_are_as_good_as_they_say() -> None:
    thought, q = dent(300.0, 24.0)
    nodes = [(j, i) for j in range(12, 110, 8) for i in range(12, 150, 8)]
    ratios = []
    for seed in range(8):
        places, known = pixel_places(pictures(q, seed), BLACK, thought, RIM)
        found, sigma = node_places(places, known, nodes)
        true = np.array([q[node] for node in nodes])
        ratios.append((found - true) / sigma)
    z = np.array(ratios)
    # on the careful side: sigma also has what a panel in whole px leaves, and these pictures have none
    assert np.mean(np.abs(z) > 3) < 0.01
    assert 0.2 < np.sqrt(np.mean(z**2)) < 1.1


def test_a_node_with_too_few_pixels_is_not_read() -> None:
    rest, _ = dent(0.0, 16.0)
    known = np.zeros(U.shape, bool)
    known[:, : 40 - RADIUS_PX // 2] = True
    found, sigma = node_places(rest, known, [(60, 20), (60, 40)])
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()
    assert np.isinf(sigma[1]).all()
