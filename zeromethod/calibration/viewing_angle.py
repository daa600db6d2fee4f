"""How the LCD's response differs over the panel, by the angle under which each part of it is seen.

Off its best viewing direction a panel's curve bends: light = whole(code)^p to good approximation, p near 1.
Each tile of the view gives a p of its own; over the panel they follow a bilinear form, which is what a rig
file's `response_exponent` holds at the four corners and what the drawing then undoes place by place.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.response import Curve, MeasuredResponse

BOUNDS = (0.3, 3.0)
"""What a corner out of view may be extrapolated to."""

NOTABLE_LIGHT = 2e-3
"""Departure in light over the view, of white's, below which one inverse serves the whole panel."""

NOTABLE_SPREAD = 0.02
"""Departure of a region's light that is worth a word."""

_SLOPE = 0.5
"""How much p may be expected to change from the panel's middle to its border, as a standard deviation."""
_STEEPEST = float(np.exp(-1.0))
"""Largest change of light per change of p: w |ln w| at w = 1/e."""
_FEWEST_TILES = 6
_ROUNDS = 4


def exponent_of(curve: Curve, whole: Curve) -> tuple[float, float]:
    """Exponent p of light = whole^p for one region, and its standard deviation.

    Weighted least squares, with the region's black and white levels free: their noise is common to all
    codes, and would else count as p.
    """
    inside = (whole.light > 0.01) & (whole.light < 0.99)
    base, light = whole.light[inside], curve.light[inside]
    sigma = np.sqrt(curve.sigma[inside] ** 2 + whole.sigma[inside] ** 2 + 1e-10)
    p = 1.0
    for _ in range(_ROUNDS):
        design = np.stack([base**p * np.log(base), 1.0 - base, base], axis=-1) / sigma[:, None]
        inverse = np.linalg.inv(design.T @ design)
        p += float((inverse @ (design.T @ ((light - base**p) / sigma)))[0])
        p = float(np.clip(p, *BOUNDS))
    return p, float(np.sqrt(inverse[0, 0]))


def panel_exponents(
    response: MeasuredResponse, places_px: Float, size: tuple[int, int]
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Exponents at the panel's corners: ((first row, first column; last column), (last row, ...)).

    places_px: (tile rows, tile cols, 2) LCD (column, row) that the tiles see, NaN where unknown. size:
    (columns, rows) of the panel. None where the regions agree, within noise or `NOTABLE_LIGHT`, or are too
    few.
    """
    far = 0.5 * (np.array(size, dtype=np.float64) - 1.0)
    rows, fits = [], []
    for index, curve in np.ndenumerate(response.tiles):
        place = places_px[index]
        if curve is None or not np.isfinite(place).all():
            continue
        x, y = place / far - 1.0
        rows.append((1.0, x, y, x * y))
        fits.append(exponent_of(curve, response.whole))
    if len(rows) < _FEWEST_TILES:
        return None
    basis, (p, sigma) = np.array(rows), np.array(fits).T
    prior = np.diag([0.0, *3 * [_SLOPE**-2]])
    terms, covariance = _fit(basis, p, sigma, prior)
    # what is left over counts as noise, too: tiles differ by more than their sigma where light is uneven
    left = float(np.sqrt(np.mean(((p - basis @ terms) / sigma) ** 2)))
    if left > 1.0:
        terms, covariance = _fit(basis, p, sigma * left, prior)
    away = basis @ terms - 1.0
    spread = np.sqrt(np.einsum("ni,ij,nj->n", basis, covariance, basis))
    worst = int(np.argmax(np.abs(away)))
    if _STEEPEST * abs(away[worst]) < max(NOTABLE_LIGHT, 3.0 * _STEEPEST * spread[worst]):
        return None
    corners = np.array([[(1.0, x, y, x * y) for x in (-1.0, 1.0)] for y in (-1.0, 1.0)]) @ terms
    (a, b), (c, d) = np.clip(corners, *BOUNDS).tolist()
    return (a, b), (c, d)


def spread_left(response: MeasuredResponse, exponents: Float | None) -> float:
    """Departure of a region's light, of the white's, that the drawing does not undo; 0 below what is notable.

    exponents: (tile rows, tile cols), those that are drawn with; None: one inverse for all.
    """
    left = float(np.max(response.spread(exponents)))
    return left if left > NOTABLE_SPREAD else 0.0


def at_places(
    corners: tuple[tuple[float, float], tuple[float, float]], places_px: Float, size: tuple[int, int]
) -> Float:
    """Exponents (...,) at LCD places (..., 2) px, bilinear between the panel's corners."""
    x, y = np.moveaxis(places_px / (np.array(size, dtype=np.float64) - 1.0), -1, 0)
    (a, b), (c, d) = corners
    return np.asarray((1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d))


def _fit(basis: Float, p: Float, sigma: Float, prior: Float) -> tuple[Float, Float]:
    scaled = basis / sigma[:, None]
    covariance = np.asarray(np.linalg.inv(scaled.T @ scaled + prior), dtype=np.float64)
    return covariance @ (scaled.T @ (p / sigma)), covariance
