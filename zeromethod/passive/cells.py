"""Sums over square cells of pixels: all that the fit needs to know of the images."""

from __future__ import annotations

import numba

from zeromethod.arrays import Float, Single
from zeromethod.kernels import kernel, read

XX, XY, YY, X, Y = range(5)
"""Channels of `normal_sums`: sums of gx gx, gx gy, gy gy, gx r, gy r."""

N, RR, GX, GY, R, A, AA, AX, AY, AR = range(10)
"""Further channels of `normal_sums`: pixel count, sums of r r, gx, gy, r, a, a a, a gx, a gy, a r."""

GRADIENT_NOISE = 130.0 / 144.0 / 4.0
"""Variance that white noise adds to a gradient of `normal_sums`, per variance of the images' difference."""


@kernel(read(numba.float32, 2), read(numba.float32, 2), numba.int64, numba.float64[:, :, ::1])
def grey_sums(reference: Single, warped: Single, size: int, out: Float) -> None:
    """Per cell: pixel count and sums of a, b, a a, a b, b b for reference a and warped image b.

    out: (cell rows, cell cols, 6). Pixels that are NaN in either image do not count.
    """
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[j, i, k] = 0.0
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


@kernel(
    read(numba.float32, 2),
    read(numba.float32, 2),
    read(numba.float64, 3),
    numba.int64,
    numba.float64[:, :, ::1],
    numba.float64[:, :, ::1],
)
def normal_sums(reference: Single, warped: Single, light: Float, size: int, sums: Float, more: Float) -> None:
    """Normal equations of the displacement left between reference and warped image, per cell.

    light: (cell rows, cell cols, 2) gain and offset that bring the warped image to the reference's grey.
    sums: (cell rows, cell cols, 5), channels as named above, with the gradient g of the two images' mean
    (half the noise of one, and no bias from which image is noisier) and the difference r = reference -
    warped = g . (displacement still missing). more: (cell rows, cell cols, 10), a being the reference.
    """
    rows, cols = reference.shape
    for j in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            for k in range(sums.shape[2]):
                sums[j, i, k] = 0.0
            for k in range(more.shape[2]):
                more[j, i, k] = 0.0
    for v in range(2, rows - 2):
        for u in range(2, cols - 2):
            j, i = v // size, u // size
            gain = light[j, i, 0]
            r = reference[v, u] - gain * warped[v, u] - light[j, i, 1]
            # fourth-order central differences, NaN next to a NaN
            gx = 8.0 * (reference[v, u + 1] - reference[v, u - 1])
            gx -= reference[v, u + 2] - reference[v, u - 2]
            gy = 8.0 * (reference[v + 1, u] - reference[v - 1, u])
            gy -= reference[v + 2, u] - reference[v - 2, u]
            wx = 8.0 * (warped[v, u + 1] - warped[v, u - 1]) - (warped[v, u + 2] - warped[v, u - 2])
            wy = 8.0 * (warped[v + 1, u] - warped[v - 1, u]) - (warped[v + 2, u] - warped[v - 2, u])
            gx, gy = (gx + gain * wx) / 24.0, (gy + gain * wy) / 24.0
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
