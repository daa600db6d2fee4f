"""Sums over square cells of pixels: all that the fit needs to know of the images."""

from __future__ import annotations

import numba

from zeromethod.arrays import Float, Single

XX, XY, YY, X, Y = range(5)
"""Channels of `normal_sums`: sums of gx gx, gx gy, gy gy, gx r, gy r."""

N, RR, GX, GY, R, A, AA, AX, AY, AR = range(10)
"""Further channels of `normal_sums`: pixel count, sums of r r, gx, gy, r, a, a a, a gx, a gy, a r."""

GRADIENT_NOISE = 130.0 / 144.0 / 4.0
"""Variance that white noise adds to a gradient of `normal_sums`, per variance of the images' difference."""


@numba.njit(cache=True, fastmath=False)
def grey_sums(reference: Single, warped: Single, size: int, out: Float) -> None:
    """Per cell: pixel count and sums of a, b, a a, a b, b b for reference a and warped image b.

    out: (cell rows, cell cols, 6). Pixels that are NaN in either image do not count.
    """
    out[:] = 0.0
    for v in range(reference.shape[0]):
        for u in range(reference.shape[1]):
            a, b = float(reference[v, u]), float(warped[v, u])
            if a == a and b == b:  # noqa: PLR0124 - false for NaN only
                cell = out[v // size, u // size]
                cell[0] += 1.0
                cell[1] += a
                cell[2] += b
                cell[3] += a * a
                cell[4] += a * b
                cell[5] += b * b


@numba.njit(cache=True, inline="always")
def _slope(a: Single, b: Single, v: int, u: int, dv: int, du: int, gain: float) -> float:
    """Fourth-order central difference of (a + gain b) / 2 along (dv, du); NaN next to a NaN."""
    v1, v2, v3, v4 = v - 2 * dv, v - dv, v + dv, v + 2 * dv
    u1, u2, u3, u4 = u - 2 * du, u - du, u + du, u + 2 * du
    of_a = 8.0 * (a[v3, u3] - a[v2, u2]) - (a[v4, u4] - a[v1, u1])
    of_b = 8.0 * (b[v3, u3] - b[v2, u2]) - (b[v4, u4] - b[v1, u1])
    slope: float = (of_a + gain * of_b) / 24.0
    return slope


@numba.njit(cache=True)
def normal_sums(reference: Single, warped: Single, light: Float, size: int, sums: Float, more: Float) -> None:
    """Normal equations of the displacement left between reference and warped image, per cell.

    light: (cell rows, cell cols, 2) gain and offset that bring the warped image to the reference's grey.
    sums: (cell rows, cell cols, 5), channels as named above, with the gradient g of the two images' mean
    (half the noise of one, and no bias from which image is noisier) and the difference r = reference -
    warped = g . (displacement still missing). more: (cell rows, cell cols, 10), a being the reference.
    """
    sums[:] = 0.0
    more[:] = 0.0
    rows, cols = reference.shape
    for v in range(2, rows - 2):
        for u in range(2, cols - 2):
            j, i = v // size, u // size
            gain = light[j, i, 0]
            r = reference[v, u] - gain * warped[v, u] - light[j, i, 1]
            gx = _slope(reference, warped, v, u, 0, 1, gain)
            gy = _slope(reference, warped, v, u, 1, 0, gain)
            if gx + gy + r != gx + gy + r:  # true for NaN only
                continue
            cell = sums[j, i]
            cell[XX] += gx * gx
            cell[XY] += gx * gy
            cell[YY] += gy * gy
            cell[X] += gx * r
            cell[Y] += gy * r
            a = float(reference[v, u])
            other = more[j, i]
            other[N] += 1.0
            other[RR] += r * r
            other[GX] += gx
            other[GY] += gy
            other[R] += r
            other[A] += a
            other[AA] += a * a
            other[AX] += a * gx
            other[AY] += a * gy
            other[AR] += a * r
