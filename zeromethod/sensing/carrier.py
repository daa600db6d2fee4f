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

from zeromethod.arrays import Float, Image, Single
from zeromethod.kernels import kernel, piece, read
from zeromethod.rig.model import Noise
from zeromethod.sensing.demodulate import FAST, Demodulator, clipped_pixels
from zeromethod.sensing.residual import Limits, Residual, Scales, flags_of
from zeromethod.sensing.window import carrier_power
from zeromethod.warp.grid import INNER, PADDING, NodeGrid

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
        self._demodulator = Demodulator((rows, cols), period, diagonal=diagonal)
        self._half, self._ceiling, self._diagonal = period // 2, ceiling, diagonal
        odd = 1 - 2 * (np.arange(cols) & 1)
        odd_row = 1 - 2 * (np.arange(rows)[:, None] & 1)
        # the carriers advance by half a period from node to node
        signs = np.broadcast_arrays(
            odd * odd_row if diagonal else odd, odd * odd_row if diagonal else odd_row
        )
        origin = np.exp(1j * np.array(origin_rad))[:, None, None]
        self._turn = (np.stack(signs) * origin).astype(np.complex64)
        self._gain = carrier_power(period).astype(np.float32)
        self._px_per_rad = period / (2 * np.pi)
        self._scales = Scales.of(noise, limits, period)
        self._work, self._extremes = np.zeros((6, cols), np.float32), np.zeros((2, rows, cols), np.float32)

    def estimate(self, image: Image, reference_light: Single, out: Residual) -> None:
        """Fill the measurable nodes of `out`; its d receives the wrapped displacements.

        reference_light: (node rows, node cols) mean light at rest above black, 0 = unknown.
        """
        planes, scales = self._demodulator.planes(image), self._scales
        noise = scales.still, scales.per_grey, scales.black
        carriers = self._turn, self._diagonal, self._gain, self._px_per_rad
        work = self._work, self._extremes
        _read_planes(planes, *carriers, *noise, *work, out.d, out.sigma, out.modulation)
        mean = planes[0]
        out.mean[INNER] = mean
        over = clipped_pixels(image, self._ceiling, mean.shape, self._half)
        worst, least = self._extremes
        out.flags[INNER] = flags_of(worst, least, mean - scales.black, reference_light, over, scales)


@piece(fastmath=FAST, inline="always")
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


@kernel(
    read(numba.float32, 3),
    read(numba.complex64, 3),
    numba.boolean,
    read(numba.float32, 1),
    numba.float32,
    numba.float32,
    numba.float32,
    numba.float32,
    numba.float32[:, ::1],
    numba.float32[:, :, ::1],
    numba.float64[:, :, ::1],
    numba.float64[:, :, ::1],
    numba.float32[:, :, ::1],
    fastmath=FAST,
)
def _read_planes(
    planes: Single,
    turn: NDArray[np.complex64],
    diagonal: bool,
    gain: Single,
    scale: float,
    still: float,
    per_grey: float,
    black: float,
    work: Single,
    extremes: Single,
    d: Float,
    sigma: Float,
    modulation: Single,
) -> None:
    """Phase and its standard deviation (px) and amplitude of both carriers at the measurable nodes.

    planes: (5, rows, cols) of the demodulator. turn: (2, rows, cols) by which the carriers' phases are turned
    back. scale: px per rad. still, per_grey, black: `Scales`. work: (6, cols). extremes: (2, rows, cols)
    receives the larger standard deviation and the smaller amplitude. d, sigma and modulation have padding.
    """
    g0, g1, g2, g3 = gain[0], gain[1], gain[2], gain[3]
    half, quarter, two = np.float32(0.5), np.float32(0.25), np.float32(2)
    tiny, most = np.float32(1e-30), np.float32(np.inf)
    for r in range(planes.shape[1]):
        mean, cu, su, cv, sv = planes[0, r], planes[1, r], planes[2, r], planes[3, r], planes[4, r]
        turn_u, turn_v = turn[0, r], turn[1, r]
        for j in range(planes.shape[2]):
            za, zb, ya, yb = cu[j], -su[j], cv[j], -sv[j]
            o, p = turn_u[j].real, turn_u[j].imag
            work[0, j] = scale * _arctan2(za * p + zb * o, za * o - zb * p)
            o, p = turn_v[j].real, turn_v[j].imag
            work[1, j] = scale * _arctan2(ya * p + yb * o, ya * o - yb * p)
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
                vu, vv = quarter * (vp + vm + two * both), quarter * (vp + vm - two * both)
            else:
                c2, e2 = two * c * c - 1, two * e * e - 1
                c3, e3 = c * (two * c2 - 1), e * (two * e2 - 1)
                nu, nv = half * (g0 - g2 * c2), half * (g0 - g2 * e2)
                vu = pixel * nu * g0 + per_grey * (au * quarter * (g1 * c - g3 * c3) * g0 + av * nu * g1 * e)
                vv = pixel * nv * g0 + per_grey * (av * quarter * (g1 * e - g3 * e3) * g0 + au * nv * g1 * c)
                vu, vv = ku * ku * vu, kv * kv * vv
            du, dv = np.sqrt(vu) if au > 0 else most, np.sqrt(vv) if av > 0 else most
            work[2, j], work[3, j], work[4, j], work[5, j] = du, dv, au, av
            extremes[0, r, j], extremes[1, r, j] = max(du, dv), min(au, av)
        for k in range(2):
            for j in range(planes.shape[2]):
                d[r + PADDING, j + PADDING, k] = work[k, j]
                sigma[r + PADDING, j + PADDING, k] = work[2 + k, j]
                modulation[r + PADDING, j + PADDING, k] = work[4 + k, j]


def take_out(d: Float, target_rad: Float, period: float) -> None:
    """Take a target's known phase (rows, cols, 2) along its carriers out of wrapped displacements, px.

    They stay within +-P/2.
    """
    apart = d[INNER] - period / (2 * math.pi) * target_rad[INNER]
    d[INNER] = apart - period * np.rint(apart / period)
