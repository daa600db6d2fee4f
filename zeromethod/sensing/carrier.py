"""Displacement from window sums: the carrier's phase, its standard deviation, the node's validity.

With Z the window sum of grey x exp(-i carrier), d = P / (2 pi) arg Z and the carrier's amplitude is
2 |Z|. Its variance follows from the pixels' own, s^2 = read^2 + light / electrons + 1/12, and the weights
w: var d = (P / pi)^2 / A^2 x sum w^2 sin^2(phase) s^2, carrier-dependent light included. For constant w
it is the Cramer-Rao bound of a cosine in that window.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Flags, Float, Single
from zeromethod.rig.model import Noise
from zeromethod.sensing.demodulate import FAST, Buffers, Image, demodulate
from zeromethod.sensing.residual import Limits, Residual, Scales, flags_of
from zeromethod.sensing.window import carrier_power
from zeromethod.warp.grid import PADDING, NodeGrid

PI = np.float32(np.pi)
HALF_PI = np.float32(np.pi / 2)


class CarrierEstimator:
    """Estimator of the wrapped displacement along the two carriers, +-P/2, of an image (rows, cols).

    Carriers along u and v; where `diagonal`, along u + v and u - v, whose displacements are du + dv and
    du - dv. origin_rad: phases of the two carriers of the target itself at pixel (0, 0).
    """

    def __init__(
        self,
        grid: NodeGrid,
        noise: Noise,
        ceiling: int,
        limits: Limits,
        *,
        diagonal: bool,
        origin_rad: tuple[float, float],
    ) -> None:
        rows, cols = (n - 2 * PADDING for n in grid.shape)
        period = grid.period_px
        self._buffers = Buffers.of((rows, cols), period, signs=(1, -1, -1), planes=5)
        self._ceiling, self._diagonal = ceiling, diagonal
        self._origin = np.exp(-1j * np.array(origin_rad)).astype(np.complex64)
        self._gain = carrier_power(period).astype(np.float32)
        self._px_per_rad = np.float32(period / (2 * np.pi))
        self._scales = Scales(*np.array(Scales.of(noise, limits, period), np.float32))
        self._work = np.zeros((6, cols), np.float32)

    def estimate(self, image: Image, reference_light: Single, out: Residual) -> None:
        """Fill the measurable nodes of `out`; its d receives the wrapped displacements.

        reference_light: (node rows, node cols) mean light at rest above black, 0 = unknown.
        """
        buffers, carriers = self._buffers, (self._diagonal, self._origin, self._gain, self._px_per_rad)
        demodulate(image, self._ceiling, self._diagonal, buffers)
        light, work = reference_light, self._work
        _read_phases(buffers.planes, buffers.clipped, *carriers, self._scales, light, work, out.arrays)


@numba.njit(cache=True, fastmath=FAST, inline="always")
def _arctan2(y: np.float32, x: np.float32) -> np.float32:
    """Arc tangent without branches, for vector code; minimax polynomial within 4e-8 rad before rounding."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(max(ax, ay), np.float32(1e-30))  # noqa: PLW3301 - pairs vectorise
    q = t * t
    p = np.float32(-0.00405455906)
    p = p * q + np.float32(0.0218629301)
    p = p * q + np.float32(-0.0559122894)
    p = p * q + np.float32(0.0964219482)
    p = p * q + np.float32(-0.139086287)
    p = p * q + np.float32(0.199465655)
    p = p * q + np.float32(-0.333298608)
    p = (p * q + np.float32(0.999999336)) * t
    p = HALF_PI - p if ay > ax else p
    p = PI - p if x < 0 else p
    return -p if y < 0 else p


@numba.njit(cache=True, fastmath=FAST)
def _read_row(
    planes: Single,
    r: int,
    diagonal: bool,
    origin: NDArray[np.complex64],
    gain: Single,
    scale: np.float32,
    scales: Scales,
    work: Single,
) -> None:
    """Phase (px), variance (px^2) and amplitude of both carriers of one node row: six rows of `work`."""
    still, per_grey, black = scales.still, scales.per_grey, scales.black
    g0, g1, g2, g3 = gain[0], gain[1], gain[2], gain[3]
    half, quarter, two = np.float32(0.5), np.float32(0.25), np.float32(2)
    tiny = np.float32(1e-30)
    cu, su, cv, sv, mean = planes[0, r], planes[1, r], planes[2, r], planes[3, r], planes[4, r]
    o0, p0, o1, p1 = origin[0].real, origin[0].imag, origin[1].real, origin[1].imag
    row_sign = np.float32(1 - 2 * (r & 1))
    for j in range(work.shape[1]):
        # the carrier advances by half a period from node to node
        odd = np.float32(1 - 2 * (j & 1))
        f0 = odd * row_sign if diagonal else odd
        f1 = odd * row_sign if diagonal else row_sign
        za, zb = cu[j], -su[j]
        ya, yb = cv[j], -sv[j]
        work[0, j] = scale * _arctan2(f0 * (za * p0 + zb * o0), f0 * (za * o0 - zb * p0))
        work[1, j] = scale * _arctan2(f1 * (ya * p1 + yb * o1), f1 * (ya * o1 - yb * p1))
        au, av = two * np.sqrt(za * za + zb * zb), two * np.sqrt(ya * ya + yb * yb)
        pixel = still + per_grey * max(mean[j] - black, np.float32(0))
        ku, kv = two * scale / max(au, tiny), two * scale / max(av, tiny)
        # cosines of the carriers' phases at the node, and of their double and triple
        c, e = two * za / max(au, tiny), two * ya / max(av, tiny)
        s, t = two * zb / max(au, tiny), two * yb / max(av, tiny)
        if diagonal:
            vp = half * g0 * g0 * pixel * ku * ku
            vm = half * g0 * g0 * pixel * kv * kv
            both = g0 * g2 * s * t * pixel * ku * kv
            work[2, j] = quarter * (vp + vm + two * both)
            work[3, j] = quarter * (vp + vm - two * both)
        else:
            c2, e2 = two * c * c - 1, two * e * e - 1
            c3, e3 = c * (two * c2 - 1), e * (two * e2 - 1)
            nu, nv = half * (g0 - g2 * c2), half * (g0 - g2 * e2)
            vu = pixel * nu * g0 + per_grey * (au * quarter * (g1 * c - g3 * c3) * g0 + av * nu * g1 * e)
            vv = pixel * nv * g0 + per_grey * (av * quarter * (g1 * e - g3 * e3) * g0 + au * nv * g1 * c)
            work[2, j] = ku * ku * vu
            work[3, j] = kv * kv * vv
        work[4, j], work[5, j] = au, av


@numba.njit(cache=True)
def _read_phases(
    planes: Single,
    clipped: NDArray[np.int32],
    diagonal: bool,
    origin: NDArray[np.complex64],
    gain: Single,
    px_per_rad: np.float32,
    scales: Scales,
    reference_light: Single,
    work: Single,
    out: tuple[Float, Float, Flags, Single, Single],
) -> None:
    d, sigma, flags, modulation, mean = out
    any_clipped = clipped.max() > 0
    for r in range(planes.shape[1]):
        _read_row(planes, r, diagonal, origin, gain, px_per_rad, scales, work)
        for j in range(planes.shape[2]):
            row, col = r + PADDING, j + PADDING
            au, av, grey = work[4, j], work[5, j], planes[4, r, j]
            su = np.sqrt(work[2, j]) if au > 0 else np.inf
            sv = np.sqrt(work[3, j]) if av > 0 else np.inf
            light, rest = grey - scales.black, reference_light[r, j]
            over = clipped[r : r + 4, j : j + 4].sum() if any_clipped else 0
            d[row, col, 0], d[row, col, 1] = work[0, j], work[1, j]
            sigma[row, col, 0], sigma[row, col, 1] = su, sv
            modulation[row, col, 0], modulation[row, col, 1] = au, av
            mean[row, col] = grey
            flags[row, col] = flags_of(max(su, sv), min(au, av), light, rest, over, scales)


@numba.njit(cache=True, fastmath=FAST)
def take_out(d: Float, target_rad: Float, period: float) -> None:
    """Take a target's known phase (rows, cols, 2) along its carriers out of wrapped displacements, px.

    They stay within +-P/2.
    """
    px_per_rad, per_px = period / (2 * math.pi), 1 / period
    for row in range(PADDING, d.shape[0] - PADDING):
        for col in range(PADDING, d.shape[1] - PADDING):
            for k in range(2):
                apart = d[row, col, k] - px_per_rad * target_rad[row, col, k]
                d[row, col, k] = apart - period * np.rint(per_px * apart)
