"""How much light a camera pixel gathers, through the lens, from an LCD of separate lit apertures."""

from __future__ import annotations

from math import erf, exp, pi, sqrt

import numba
import numpy as np

from zeromethod.arrays import Float

LEAST_PX = 1e-2
"""Smallest side of a footprint, LCD px; keeps the mean over it defined where rays cross."""
TAIL_SIGMAS = 4.0
"""The lens's Gaussian is cut there."""
CUTS = 2
"""Without a lens a footprint is cut into CUTS x CUTS parts, each then a box along the LCD's axes."""
_STRAIGHT = 1e-3
"""Correlation of a footprint's two axes below which it lies along the LCD's axes."""


@numba.njit(cache=True, inline="always")
def _ramp(x: float, sigma: float) -> float:
    """Integral up to x of a Gaussian's cumulative: x Phi(x / sigma) + sigma phi(x / sigma)."""
    if sigma == 0.0:
        return max(x, 0.0)
    z = x / sigma
    if abs(z) > 6.0:
        return max(x, 0.0)
    return 0.5 * x * (1.0 + erf(z / sqrt(2.0))) + sigma * exp(-0.5 * z * z) / sqrt(2.0 * pi)


@numba.njit(cache=True)
def _cumulative(x: float, side: float, sigma: float) -> float:
    """Share of box (of width `side`) * Gaussian (sigma) that lies before x."""
    return (_ramp(x + 0.5 * side, sigma) - _ramp(x - 0.5 * side, sigma)) / side


@numba.njit(cache=True)
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
            share += _cumulative(centre + half, side, sigma) - _cumulative(centre - half, side, sigma)
        out[pixel - first] = share
    return first, end


@numba.njit(cache=True, inline="always")
def _bend(q: Float, row: int, col: int) -> tuple[float, float]:
    """Second differences of q along u and v, added up, LCD px; 0 at the border and next to what is lost."""
    if not (0 < row < q.shape[0] - 1 and 0 < col < q.shape[1] - 1):
        return 0.0, 0.0
    left, right, above, below, here = (
        q[row, col - 1],
        q[row, col + 1],
        q[row - 1, col],
        q[row + 1, col],
        q[row, col],
    )
    x = left[0] + right[0] + above[0] + below[0] - 4.0 * here[0]
    y = left[1] + right[1] + above[1] + below[1] - 4.0 * here[1]
    return (x, y) if np.isfinite(x + y) else (0.0, 0.0)


@numba.njit(cache=True)
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
    columns = np.empty(light.shape[1])
    rows = np.empty(light.shape[0])
    lens = psf_px > 0.0
    spread = sqrt(psf_px**2 + 1.0 / 12.0)
    for row in range(q.shape[0]):
        for col in range(q.shape[1]):
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
            bent_x, bent_y = _bend(q, row, col)
            middle_x = q[row, col, 0] + 0.5 * spread * spread * bent_x
            middle_y = q[row, col, 1] + 0.5 * spread * spread * bent_y
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
                    middle_x + x, side * w, psf_px * w, light.shape[1], fill[0], stripes, columns
                )
                top, bottom = _shares(middle_y + y, side * h, psf_px * h, light.shape[0], fill[1], 1, rows)
                for j in range(top, bottom):
                    line = 0.0
                    for i in range(left, right):
                        line += columns[i - left] * light[j, i]
                    total += rows[j - top] * line
            out[row, col] += gain[row, col] * total / (parts * fill[0] * fill[1])
