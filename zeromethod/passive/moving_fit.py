"""Displacement by moving least squares: a polynomial under a Gaussian window, at every cell.

With D(x) the displacement, g the gradient and r the grey difference left by the field d that warped the
image, sum w (r - g . (D - d))^2 is minimised over the coefficients of D about the cell. Everything is made
of windowed moments of the cells' sums, so a window costs the same at any number of pixels.
"""

from __future__ import annotations

import functools

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float, Ints
from zeromethod.kernels import kernel, read
from zeromethod.passive.cells import XX, XY, YY, X, Y
from zeromethod.rounding import REORDERED

REACH = 3.0
"""The Gaussian window ends at this many standard deviations."""

_POWERS = {1: ((0, 0), (1, 0), (0, 1)), 2: ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))}
"""Monomials x^a y^b of the displacement per order."""

_WEAK = 1e-9


@functools.cache
def window(sigma: float, power: int = 0) -> Float:
    """Weights x^power exp(-x^2 / 2 sigma^2) at whole cells x; sigma in cells. Not to be written to."""
    reach = max(int(np.ceil(REACH * sigma)), 1)
    x = np.arange(-reach, reach + 1, dtype=np.float64)
    return np.asarray(x**power * np.exp(-0.5 * (x / sigma) ** 2))


def blur(field: Float, sigma: tuple[float, float]) -> Float:
    """Windowed sum of a field (rows, cols); sigma (columns, rows) in cells. Outside the field counts 0."""
    return _filtered(field, window(sigma[0]), window(sigma[1]))


def moving_moments(field: Float, sigma: tuple[float, float], degree: int, out: Float) -> None:
    """Windowed sums (rows, cols) of x^a y^b field into out[a, b], a + b <= degree."""
    one = np.ones(1)
    for a in range(degree + 1):
        first = _filtered(field, window(sigma[0], a), one)
        for b in range(degree + 1 - a):
            out[a, b] = _filtered(first, one, window(sigma[1], b))


def _filtered(field: Float, along_row: Float, along_column: Float) -> Float:
    """Field (rows, cols) with windows along rows and columns; outside it counts 0."""
    found = cv2.sepFilter2D(field, cv2.CV_64F, along_row, along_column, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(found)


@kernel(
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.int64, 2),
    numba.float64[:, ::1],
    numba.float64[:, ::1],
    fastmath=REORDERED,
)
def _solve(moments: Float, squares: Float, right: Float, plane: Ints, out: Float, variance: Float) -> None:
    """Displacements (cells, 2) and their variances, by Cholesky factors; NaN where one is nearly singular.

    moments, squares: (planes, cells) of the normal matrix and of its variance. plane: (unknowns, unknowns)
    which of them each element is; half of the unknowns are du's, half dv's. right: (unknowns, cells).
    """
    size = len(plane)
    factor, row = np.empty((size, size)), np.empty(size)
    for cell in range(len(out)):
        sound = True
        for m in range(size):
            for n in range(m):
                total = moments[plane[m, n], cell]
                for k in range(n):
                    total -= factor[m, k] * factor[n, k]
                factor[m, n] = total / factor[n, n]
            scale = total = moments[plane[m, m], cell]
            for k in range(m):
                total -= factor[m, k] * factor[m, k]
            sound &= total > _WEAK * scale
            factor[m, m] = np.sqrt(total)
        for axis in range(2):
            # the inverse's row of the displacement at the cell itself
            one = axis * size // 2
            for m in range(size):
                total = 1.0 if m == one else 0.0
                for k in range(m):
                    total -= factor[m, k] * row[k]
                row[m] = total / factor[m, m]
            for m in range(size - 1, -1, -1):
                for k in range(m + 1, size):
                    row[m] -= factor[k, m] * row[k]
                row[m] /= factor[m, m]
            value = spread = 0.0
            for m in range(size):
                value += row[m] * right[m, cell]
                part = 0.5 * squares[plane[m, m], cell] * row[m]
                for n in range(m):
                    part += squares[plane[m, n], cell] * row[n]
                spread += 2.0 * row[m] * part
            out[cell, axis] = value if sound else np.nan
            variance[cell, axis] = spread if sound else np.nan


def moving_fit(
    sums: Float, noise: Float, grey_variance: Float, field: Float, sigma: tuple[float, float], order: int
) -> tuple[Float, Float]:
    """Displacement and its variance, at every cell.

    sums: (rows, cols, 5) as `cells.normal_sums` gives them; cells to be left out hold zeros. noise: (rows,
    cols) the part of XX and of YY that is the images' noise: it does not move with the texture, so it
    determines nothing, but adds to the variance. field: (rows, cols, 2) px, what warped the image.
    grey_variance: (rows, cols) of the images' difference. sigma: window (columns, rows) in cells. order: of
    the polynomial, 1 or 2. Returns (rows, cols, 2) px and (rows, cols, 2) px^2; NaN where the
    texture does not determine the polynomial.
    """
    n = 2 * order + 1
    plane = field.shape[:2]
    moments, squares = np.empty((3, n, n, *plane)), np.empty((3, n, n, *plane))
    right = np.empty((2, order + 1, order + 1, *plane))
    halved = (sigma[0] / np.sqrt(2.0), sigma[1] / np.sqrt(2.0))
    for k, channel in enumerate((XX, XY, YY)):
        part = np.ascontiguousarray(sums[..., channel])
        moving_moments(part * grey_variance, halved, 2 * order, squares[k])
        moving_moments(part if channel == XY else part - noise, sigma, 2 * order, moments[k])
    x, y = field[..., 0], field[..., 1]
    xx, xy, yy = sums[..., XX] - noise, sums[..., XY], sums[..., YY] - noise
    moving_moments(sums[..., X] + xx * x + xy * y, sigma, order, right[0])
    moving_moments(sums[..., Y] + xy * x + yy * y, sigma, order, right[1])
    powers = np.array([*_POWERS[order], *_POWERS[order]])
    a, b = powers.T
    of_v = np.arange(len(powers)) // len(_POWERS[order])
    at = (np.add.outer(of_v, of_v) * n + np.add.outer(a, a)) * n + np.add.outer(b, b)
    out, variance = np.empty((*plane, 2)), np.empty((*plane, 2))
    _solve(
        moments.reshape(3 * n * n, -1),
        squares.reshape(3 * n * n, -1),
        right[of_v, a, b].reshape(len(powers), -1),
        at,
        out.reshape(-1, 2),
        variance.reshape(-1, 2),
    )
    return out, variance
