"""Grey levels between the pixels: the quintic B-spline through all of them.

Interpolation errors look like displacement (a bias that repeats every pixel); the quintic spline's are
below 0.001 px for textures of four pixels and more (doi:10.1109/79.799930).
"""

from __future__ import annotations

import math

import numba
import numpy as np
from scipy.ndimage import shift, spline_filter

from zeromethod.arrays import Float, Single
from zeromethod.kernels import kernel, read
from zeromethod.warp.interpolant import keys_weights

BORDER_PX = 2
"""Sampling stops this far from the image's border, where the spline leans on mirrored grey levels."""


def spline_coefficients(grey: Single) -> Single:
    """Quintic B-spline coefficients (rows, cols) of an image (rows, cols)."""
    return np.asarray(spline_filter(grey, order=5, output=np.float32, mode="mirror"))


@kernel(
    read(numba.float32, 2),
    read(numba.float64, 3),
    numba.int64,
    numba.int64,
    numba.float32[:, ::1],
    fastmath=True,
)
def warp_image(coefficients: Single, field: Float, padding: int, size: int, out: Single) -> None:
    """Draw the image as the reference should show it: out(u, v) = image(u + du, v + dv).

    coefficients: (rows, cols) of the image. field: (cell rows + 2 padding, cell cols + 2 padding, 2)
    displacement in px at the centres of cells of `size` px, interpolated by the system's cubic. out: (rows,
    cols) of the reference, NaN where the image does not reach or the field is NaN.
    """
    rows, cols = out.shape
    image_rows, image_cols = coefficients.shape
    edge = padding - 0.5 * (size - 1) / size
    low = float(BORDER_PX)
    line, weights = np.empty((field.shape[1], 2)), np.empty((2, 6))
    for v in range(rows):
        y = v / size + edge
        j = int(y)
        b0, b1, b2, b3 = keys_weights(y - j)
        for i in range(field.shape[1]):
            for k in range(2):
                line[i, k] = (
                    b0 * field[j - 1, i, k]
                    + b1 * field[j, i, k]
                    + b2 * field[j + 1, i, k]
                    + b3 * field[j + 2, i, k]
                )
        for u in range(cols):
            x = u / size + edge
            i = int(x)
            a0, a1, a2, a3 = keys_weights(x - i)
            px = u + a0 * line[i - 1, 0] + a1 * line[i, 0] + a2 * line[i + 1, 0] + a3 * line[i + 2, 0]
            py = v + a0 * line[i - 1, 1] + a1 * line[i, 1] + a2 * line[i + 1, 1] + a3 * line[i + 2, 1]
            if not (low <= px <= image_cols - 1 - low and low <= py <= image_rows - 1 - low):
                out[v, u] = np.float32(math.nan)
                continue
            m, n = min(int(px), image_cols - 4), min(int(py), image_rows - 4)
            for axis in range(2):
                # quintic B-spline at pixels -2 to 3 from one before the place; they sum to 1
                t = py - n if axis else px - m
                s, a, w = 1.0 - t, 1.0 + t, weights[axis]
                t2, s2 = t * t, s * s
                t4, s4 = t2 * t2, s2 * s2
                w[0], w[5] = s4 * s / 120.0, t4 * t / 120.0
                w[1] = (51.0 + 75.0 * a - 210.0 * a * a + 150.0 * a**3 - 45.0 * a**4 + 5.0 * a**5) / 120.0
                w[2] = (66.0 - 60.0 * t2 + 30.0 * t4 - 10.0 * t4 * t) / 120.0
                w[3] = (66.0 - 60.0 * s2 + 30.0 * s4 - 10.0 * s4 * s) / 120.0
                w[4] = 1.0 - w[0] - w[1] - w[2] - w[3] - w[5]
            total = 0.0
            for k in range(6):
                row = 0.0
                for i in range(6):
                    row += weights[0, i] * coefficients[n - 2 + k, m - 2 + i]
                total += weights[1, k] * row
            out[v, u] = np.float32(total)


def _noise_gains(count: int) -> Float:
    """Variance of interpolated white noise of variance 1 along one axis, at count + 1 positions 0 .. 1."""
    impulse = np.zeros(64)
    impulse[32] = 1.0
    at = np.linspace(0.0, 1.0, count + 1)
    return np.array([np.sum(shift(impulse, t, order=5, mode="mirror") ** 2) for t in at])


_GAINS = _noise_gains(32)


def noise_gain(field: Float) -> Float:
    """Share (rows, cols) of white noise that interpolation leaves at displacements (rows, cols, 2) in px.

    1 at whole pixels, about 0.7 half way between them on both axes. What is lost is fine-grained noise.
    """
    part = np.nan_to_num(field - np.floor(field)) * (_GAINS.size - 1)
    gains = np.interp(part, np.arange(_GAINS.size), _GAINS)
    return np.asarray(gains[..., 0] * gains[..., 1])
