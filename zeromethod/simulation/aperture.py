"""How much light a camera pixel gathers from an LCD of separate lit apertures: exact area integrals."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

LEAST_PX = 1e-2
"""Smallest side of a footprint, LCD px; keeps the mean over it defined where rays cross."""
CUTS = 2
"""A footprint is cut into CUTS x CUTS parts, each then a box along the LCD's axes."""

Array = NDArray[np.float64]


def summed_light(light: Array) -> Array:
    """(rows + 1, cols + 1) light of all LCD pixels above and left of each pixel corner."""
    total = np.zeros((light.shape[0] + 1, light.shape[1] + 1))
    np.cumsum(light, axis=0, out=total[1:, 1:])
    np.cumsum(total[1:, 1:], axis=1, out=total[1:, 1:])
    return total


@numba.njit(cache=True, inline="always")
def _lit_until(place: float, fill: float, stripes: int) -> float:
    """Share of a pixel's lit length that lies before `place` (0..1 of the pitch), stripes centred."""
    stripe = min(int(place * stripes), stripes - 1)
    inner = (place * stripes - stripe - 0.5 * (1.0 - fill)) / fill
    return (stripe + min(max(inner, 0.0), 1.0)) / stripes


@numba.njit(cache=True, inline="always")
def _corner(edge: float, count: int, fill: float, stripes: int) -> tuple[int, float]:
    """LCD pixel under a coordinate (px, centres at integers), and the lit share of it before that."""
    edge += 0.5
    if edge <= 0.0:
        return 0, 0.0
    if edge >= count:
        return count - 1, 1.0
    pixel = int(edge)
    return pixel, _lit_until(edge - pixel, fill, stripes)


@numba.njit(cache=True)
def _box(
    summed: Array, x0: float, x1: float, y0: float, y1: float, fill_x: float, fill_y: float, stripes: int
) -> float:
    """Lit light inside a box along the LCD's axes, in whole-pixel units; exact."""
    rows, cols = summed.shape[0] - 1, summed.shape[1] - 1
    total = 0.0
    for side_y in range(2):
        j, b = _corner(y1 if side_y else y0, rows, fill_y, 1)
        for side_x in range(2):
            i, a = _corner(x1 if side_x else x0, cols, fill_x, stripes)
            upper = (1.0 - a) * summed[j, i] + a * summed[j, i + 1]
            lower = (1.0 - a) * summed[j + 1, i] + a * summed[j + 1, i + 1]
            value = (1.0 - b) * upper + b * lower
            total += value if side_x == side_y else -value
    return total


@numba.njit(cache=True)
def gather(
    summed: Array,
    q: Array,
    by_u: Array,
    by_v: Array,
    gain: Array,
    fill: tuple[float, float],
    stripes: int,
    out: Array,
) -> None:
    """Add gain x mean light under every camera pixel's footprint to `out`.

    summed: from `summed_light`, the LCD's (rows, cols) pixels. q, by_u, by_v: (rows, cols, 2) LCD px where
    the pixel's centre looks and how that changes by one camera pixel (the parallelogram's sides). gain:
    (rows, cols), 0 where no light arrives. fill: lit share of the pitch; stripes: apertures side by side
    per LCD pixel. Light is normalised by the fill: a uniform panel of light 1 gives 1 on average. Exact
    where the parallelogram lies along the LCD's axes; a turned or sheared one is CUTS x CUTS boxes with its
    own second moments. Outside the panel it is dark.
    """
    for row in range(q.shape[0]):
        for col in range(q.shape[1]):
            if gain[row, col] <= 0.0:
                continue
            ux, uy = by_u[row, col, 0], by_u[row, col, 1]
            vx, vy = by_v[row, col, 0], by_v[row, col, 1]
            wide = max(np.hypot(ux, vx) / CUTS, LEAST_PX)
            high = max(np.hypot(uy, vy) / CUTS, LEAST_PX)
            total = 0.0
            for k in range(CUTS * CUTS):
                s = (k % CUTS + 0.5) / CUTS - 0.5
                t = (k // CUTS + 0.5) / CUTS - 0.5
                x = q[row, col, 0] + s * ux + t * vx
                y = q[row, col, 1] + s * uy + t * vy
                total += _box(
                    summed, x - wide / 2, x + wide / 2, y - high / 2, y + high / 2, fill[0], fill[1], stripes
                )
            out[row, col] += gain[row, col] * total / (wide * high * CUTS * CUTS)
