"""A residual that is not yet nulled: the mean over the sensing window is read for the value in its middle."""

import numpy as np
import pytest

from zeromethod.loop.unnulled import without_unnulled
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.window import curvature_bias_px2
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

GRID = NodeGrid((320, 400), 16)
LCD_PER_CAMERA = 0.8
SIGMA_PX = 0.01
BIAS_PX2 = curvature_bias_px2(16)


def dent(width_px: float, depth_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement along u of a Gaussian, and its mean over the triangle windows, sampled pixel by pixel."""
    u, v = GRID.mesh()
    k = np.arange(-15, 16)
    weight = (16 - np.abs(k)) / 256.0

    def gauss(x):
        return np.exp(-0.5 * (x / width_px) ** 2)

    along, down = (x - x.mean() for x in (u[0], v[:, 0]))
    true = depth_px * gauss(down)[:, None] * gauss(along)
    mean = depth_px * (gauss(down[:, None] + k) @ weight)[:, None] * (gauss(along[:, None] + k) @ weight)
    return true, mean


def measured(d_u: np.ndarray) -> tuple[Warp, Residual, np.ndarray]:
    residual = Residual.empty(GRID)
    residual.d[...] = np.stack([d_u, np.zeros_like(d_u)], axis=-1)
    residual.sigma[...] = SIGMA_PX
    shown = LCD_PER_CAMERA * np.stack(GRID.mesh(), axis=-1)
    flags = np.zeros(GRID.shape, np.uint16)
    sigma = np.full_like(shown, LCD_PER_CAMERA * SIGMA_PX)
    return Warp(shown + LCD_PER_CAMERA * residual.d, sigma, flags, 0), residual, shown


@pytest.mark.parametrize("width_px", [24.0, 40.0])
def test_a_bend_within_the_window_is_taken_out_and_into_sigma(width_px):
    true, mean = dent(width_px, 3.0)
    warp, residual, shown = measured(mean)
    found = without_unnulled(warp, residual, shown, GRID, BIAS_PX2)
    off, before = (np.abs(w.q[..., 0] - shown[..., 0] - LCD_PER_CAMERA * true) for w in (found, warp))
    # The first term of a series in (P / width)^2 / 6; what is left is of the next.
    assert off.max() < 0.35 * before.max()
    assert before.max() > 5 * LCD_PER_CAMERA * SIGMA_PX
    assert np.all(off <= 3.0 * found.sigma[..., 0])
    np.testing.assert_array_equal(found.q[..., 1], warp.q[..., 1])


def test_noise_alone_changes_nothing():
    # Of neighbours that share pixels as windows do: noise per pixel, under the window.
    draw = np.random.default_rng(3)
    pixels = draw.normal(size=(400, 480))
    weight = np.convolve(np.ones(16), np.ones(16))
    weight /= np.linalg.norm(weight)
    smooth = np.apply_along_axis(np.convolve, 1, pixels, weight, "valid")
    smooth = np.apply_along_axis(np.convolve, 0, smooth, weight, "valid")
    rows, cols = GRID.shape
    warp, residual, shown = measured(SIGMA_PX * smooth[: 8 * rows : 8, : 8 * cols : 8])
    found = without_unnulled(warp, residual, shown, GRID, BIAS_PX2)
    # Of 5000 numbers one lies beyond five sigma in 300 draws.
    assert found is warp


def test_a_sensor_without_a_window_hides_nothing():
    warp, residual, shown = measured(dent(24.0, 3.0)[1])
    assert without_unnulled(warp, residual, shown, GRID, 0.0) is warp
