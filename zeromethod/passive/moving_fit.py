"""Displacement by moving least squares: a polynomial under a Gaussian window, at every cell.

With D(x) the displacement, g the gradient and r the grey difference left by the field d that warped the
image, sum w (r - g . (D - d))^2 is minimised over the coefficients of D about the cell. Everything is made
of windowed moments of the cells' sums, so a window costs the same at any number of pixels.
"""

from __future__ import annotations

import functools

import numba
import numpy as np

from zeromethod.arrays import Float, Ints
from zeromethod.passive.cells import XX, XY, YY, X, Y
from zeromethod.rounding import REORDERED

REACH = 3.0
"""The Gaussian window ends at this many standard deviations."""

_POWERS = {1: ((0, 0), (1, 0), (0, 1)), 2: ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))}
"""Monomials x^a y^b of the displacement per order."""

_WEAK = 1e-9


@numba.njit(cache=True, fastmath=True)
def _along_rows(field: Float, kernel: Float, out: Float) -> None:
    reach = kernel.size // 2
    cols = field.shape[1]
    for j in range(field.shape[0]):
        line, total = field[j], out[j]
        for i in range(cols):
            total[i] = 0.0
        for k in range(-min(reach, cols - 1), min(reach, cols - 1) + 1):
            weight = kernel[k + reach]
            for i in range(max(-k, 0), min(cols - k, cols)):
                total[i] += weight * line[i + k]


@numba.njit(cache=True, fastmath=True)
def _along_columns(field: Float, kernel: Float, out: Float) -> None:
    reach = kernel.size // 2
    rows, cols = field.shape
    for j in range(rows):
        total = out[j]
        for i in range(cols):
            total[i] = 0.0
        for k in range(max(-reach, -j), min(reach, rows - 1 - j) + 1):
            weight, line = kernel[k + reach], field[j + k]
            for i in range(cols):
                total[i] += weight * line[i]


@functools.cache
def window(sigma: float, power: int = 0) -> Float:
    """Weights x^power exp(-x^2 / 2 sigma^2) at whole cells x; sigma in cells. Not to be written to."""
    reach = max(int(np.ceil(REACH * sigma)), 1)
    x = np.arange(-reach, reach + 1, dtype=np.float64)
    return np.asarray(x**power * np.exp(-0.5 * (x / sigma) ** 2))


def blur(field: Float, sigma: tuple[float, float]) -> Float:
    """Windowed sum of a field (rows, cols); sigma (columns, rows) in cells. Outside the field counts 0."""
    first, out = np.empty_like(field), np.empty_like(field)
    _along_rows(field, window(sigma[0]), first)
    _along_columns(first, window(sigma[1]), out)
    return out


def moving_moments(field: Float, sigma: tuple[float, float], degree: int, out: Float) -> None:
    """Windowed sums (rows, cols) of x^a y^b field into out[a, b], a + b <= degree."""
    first = np.empty_like(field)
    for a in range(degree + 1):
        _along_rows(field, window(sigma[0], a), first)
        for b in range(degree + 1 - a):
            _along_columns(first, window(sigma[1], b), out[a, b])


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _factor(matrix: Float, size: int) -> bool:
    """Cholesky factor in the lower triangle, in place; False where the matrix is (nearly) singular."""
    for i in range(size):
        scale = matrix[i, i]
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                if not total > _WEAK * scale:
                    return False
                matrix[i, i] = np.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    return True


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _substitute(factor: Float, size: int, x: Float) -> None:
    """Solve for the right-hand side x in place."""
    for i in range(size):
        for k in range(i):
            x[i] -= factor[i, k] * x[k]
        x[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            x[i] -= factor[k, i] * x[k]
        x[i] /= factor[i, i]


@numba.njit(cache=True)
def _fill_matrix(moments: Float, powers: Ints, j: int, i: int, matrix: Float) -> None:
    """Lower triangle of the normal matrix from moments (3, n, n, rows, cols) of XX, XY, YY."""
    terms = powers.shape[0]
    for m in range(terms):
        for n in range(terms):
            a, b = powers[m, 0] + powers[n, 0], powers[m, 1] + powers[n, 1]
            matrix[m, n] = moments[0, a, b, j, i]
            matrix[terms + m, n] = moments[1, a, b, j, i]
            matrix[m, terms + n] = moments[1, a, b, j, i]
            matrix[terms + m, terms + n] = moments[2, a, b, j, i]


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _solve(moments: Float, squares: Float, right: Float, powers: Ints, out: Float, variance: Float) -> None:
    terms = powers.shape[0]
    size = 2 * terms
    matrix, spread = np.empty((size, size)), np.empty((size, size))
    x, row = np.empty(size), np.empty(size)
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            _fill_matrix(moments, powers, j, i, matrix)
            if not _factor(matrix, size):
                out[j, i] = np.nan
                variance[j, i] = np.nan
                continue
            for m in range(terms):
                x[m] = right[0, powers[m, 0], powers[m, 1], j, i]
                x[terms + m] = right[1, powers[m, 0], powers[m, 1], j, i]
            _substitute(matrix, size, x)
            _fill_matrix(squares, powers, j, i, spread)
            for k in range(2):
                out[j, i, k] = x[k * terms]
                row[:] = 0.0
                row[k * terms] = 1.0
                _substitute(matrix, size, row)
                total = 0.0
                for m in range(size):
                    part = 0.5 * spread[m, m] * row[m]
                    for n in range(m):
                        part += spread[m, n] * row[n]
                    total += 2.0 * row[m] * part
                variance[j, i, k] = total


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
    out, variance = np.empty((*plane, 2)), np.empty((*plane, 2))
    _solve(moments, squares, right, np.array(_POWERS[order]), out, variance)
    return out, variance
