"""How much light a camera pixel gathers, through the lens, from an LCD of separate lit apertures."""

from __future__ import annotations

from math import erf, exp, pi, sqrt

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.kernels import kernel, piece, read

LEAST_PX = 1e-2
"""Smallest side of a footprint, LCD px; keeps the mean over it defined where rays cross."""
TAIL_SIGMAS = 4.0
"""The lens's Gaussian is cut there."""
CUTS = 2
"""Without a lens a footprint is cut into CUTS x CUTS parts, each then a box along the LCD's axes."""
_STRAIGHT = 1e-3
"""Correlation of a footprint's two axes below which it lies along the LCD's axes."""


@piece
def _ramp(x: float, sigma: float) -> float:
    """Integral up to x of a Gaussian's cumulative: x Phi(x / sigma) + sigma phi(x / sigma)."""
    if sigma == 0.0 or abs(x) > 6.0 * sigma:
        return max(x, 0.0)
    z = x / sigma
    return 0.5 * x * (1.0 + erf(z / sqrt(2.0))) + sigma * exp(-0.5 * z * z) / sqrt(2.0 * pi)


@piece
def _shares(
    middle: float, side: float, sigma: float, count: int, fill: float, stripes: int, out: Float
) -> tuple[int, int]:
    """Share of the response, from `middle` on, that falls on each pixel's apertures: pixels [first, end).

    One axis: side, sigma and middle in LCD px, `count` LCD pixels; shares are left in `out` from its start.
    """
    reach = 0.5 * side + TAIL_SIGMAS * sigma
    first = max(int(np.floor(middle - reach + 0.5)), 0)
    end = min(int(np.floor(middle + reach + 0.5)) + 1, count, first + len(out))
    half = 0.5 * fill / stripes
    for pixel in range(first, end):
        share = 0.0
        for stripe in range(stripes):
            centre = pixel + (stripe + 0.5) / stripes - 0.5 - middle
            after, before = centre + half, centre - half
            share += _ramp(after + 0.5 * side, sigma) - _ramp(after - 0.5 * side, sigma)
            share -= _ramp(before + 0.5 * side, sigma) - _ramp(before - 0.5 * side, sigma)
        out[pixel - first] = share / side
    return first, end


@kernel(
    read(numba.float64, 2),
    read(numba.float64, 3),
    read(numba.float64, 3),
    read(numba.float64, 3),
    read(numba.float64, 2),
    numba.float64,
    numba.float64,
    numba.int64,
    numba.float64,
    numba.float64[::1],
    numba.float64[::1],
    numba.float64[:, ::1],
)
def _gather(
    light: Float,
    middle: Float,
    by_u: Float,
    by_v: Float,
    gain: Float,
    fill_x: float,
    fill_y: float,
    stripes: int,
    psf_px: float,
    columns: Float,
    rows: Float,
    out: Float,
) -> None:
    """Do what `gather` does. middle: (rows, cols, 2) of the footprints. columns, rows: room for the LCD's."""
    lens = psf_px > 0.0
    spread = sqrt(psf_px**2 + 1.0 / 12.0)
    for row in range(middle.shape[0]):
        for col in range(middle.shape[1]):
            if gain[row, col] <= 0.0:
                continue
            ux, uy = by_u[row, col, 0], by_u[row, col, 1]
            vx, vy = by_v[row, col, 0], by_v[row, col, 1]
            wide, high = max(np.hypot(ux, vx), LEAST_PX), max(np.hypot(uy, vy), LEAST_PX)
            shear = (ux * uy + vx * vy) / (wide * high)
            parts, narrowed, side = CUTS * CUTS, 1.0, 1.0 / CUTS
            if lens:
                straight = abs(shear) < _STRAIGHT
                parts, narrowed, side = (
                    (1, 1.0, 1.0) if straight else (2, sqrt(max(1.0 - abs(shear), 0.01)), 1.0)
                )
            middle_x, middle_y = middle[row, col, 0], middle[row, col, 1]
            total = 0.0
            for k in range(parts):
                if lens:
                    step = (2 * k + 1 - parts) * spread * sqrt(abs(shear))
                    x, y = step * wide, step * high * np.sign(shear)
                else:
                    s, t = (k % CUTS + 0.5) / CUTS - 0.5, (k // CUTS + 0.5) / CUTS - 0.5
                    x, y = s * ux + t * vx, s * uy + t * vy
                w, h = narrowed * wide, narrowed * high
                left, right = _shares(
                    middle_x + x, side * w, psf_px * w, light.shape[1], fill_x, stripes, columns
                )
                top, bottom = _shares(middle_y + y, side * h, psf_px * h, light.shape[0], fill_y, 1, rows)
                for j in range(top, bottom):
                    line = 0.0
                    for i in range(left, right):
                        line += columns[i - left] * light[j, i]
                    total += rows[j - top] * line
            out[row, col] += gain[row, col] * total / (parts * fill_x * fill_y)


def _bend(q: Float) -> Float:
    """(rows, cols, 2) second differences of q along u and v, added up; 0 at the border and next to NaN."""
    bend = np.zeros_like(q)
    here = q[1:-1, 1:-1]
    inner = q[1:-1, :-2] + q[1:-1, 2:] + q[:-2, 1:-1] + q[2:, 1:-1] - 4.0 * here
    bend[1:-1, 1:-1] = np.where(np.isfinite(inner.sum(axis=-1, keepdims=True)), inner, 0.0)
    return bend


def gather(
    light: Float,
    q: Float,
    by_u: Float,
    by_v: Float,
    gain: Float,
    fill: tuple[float, float],
    stripes: int,
    psf_px: float,
    out: Float,
) -> None:
    """Add gain x mean light that every camera pixel gathers to `out`.

    light: of the LCD's (rows, cols) pixels. q, by_u, by_v: (rows, cols, 2) LCD px where the pixel's centre
    looks and how that changes by one camera pixel (the parallelogram's sides). gain: (rows, cols), 0 where
    no light arrives. fill: lit share of the pitch; stripes: apertures side by side per LCD pixel. psf_px:
    sigma of the lens's Gaussian, camera px. Light is normalised by the fill: a uniform panel of light 1 gives
    1 on average. Outside the panel it is dark.

    A pixel's response is box (1 px) * Gaussian (psf_px) along u and along v: the lens blurs what the pixel
    then samples. Where the map is bent it is centred where the footprint's mean lies, which is not where the
    pixel's centre looks. Exact for a map that is linear over the footprint and lies along the LCD's axes.
    Turned or sheared, products along the axes with the same second moments stand in: with a lens two, set
    apart along the shear's long diagonal (rms error on a panel of white noise, contrast 0.29, for 0.7 px:
    turned by 30 deg 2e-4, sheared by 0.1: 3e-3); without one CUTS x CUTS boxes.
    """
    middle = q + 0.5 * (psf_px**2 + 1.0 / 12.0) * _bend(q)
    columns, rows = np.empty(light.shape[1]), np.empty(light.shape[0])
    _gather(light, middle, by_u, by_v, gain, *fill, stripes, psf_px, columns, rows, out)
