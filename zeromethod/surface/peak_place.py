"""How well the place of a peak is known: noise moves the point where the slopes vanish."""

from __future__ import annotations

import math

import numpy as np

from zeromethod.surface.surface import Surface

_REACH, _LEAST_NODES = 3, 12
"""Half width, in nodes, of the window whose slopes place a peak, and valid nodes that it needs."""
_ALIKE = 10.0
"""Nodes whose noise counts as one: 4 as their windows overlap, and 2.5 for a quartic's steep middle (draws of
noise on dents of sigma 4 to 10 mm scatter by 0.6 to 1.2 of what is stated so)."""


def place_sigma_mm(surface: Surface, row: int, col: int) -> tuple[float, float]:
    """Standard deviation of x and y, mm, of a summit near a node.

    Slopes around a summit are H (p - p0); their noise, averaged over the window, moves p0 by H^-1 times as
    much: far along a ridge, and without end where nothing is pressed. What the geometry leaves open comes on
    top.
    """
    rows = slice(max(row - _REACH, 0), row + _REACH + 1)
    cols = slice(max(col - _REACH, 0), col + _REACH + 1)
    known = surface.valid[rows, cols]
    count = int(np.count_nonzero(known))
    geometry = (float(one[row, col]) for one in (surface.sigma_x_mm, surface.sigma_y_mm))
    if count < _LEAST_NODES:
        return math.nan, math.nan
    x, y = (one[rows, cols][known] for one in (surface.x_mm, surface.y_mm))
    away = np.stack([x - x.sum() / count, y - y.sum() / count])
    spread, bent = away @ away.T, away @ surface.slope[rows, cols][known]
    # slopes = away @ bend; the place moves by the inverse
    (a, b), (c, d) = bent.T.tolist()
    area = a * d - b * c
    if area == 0.0:
        return math.inf, math.inf
    noise = (surface.sigma_slope[rows, cols][known] ** 2).sum(axis=0) / count * min(_ALIKE / count, 1.0)
    own = np.sqrt(((spread @ np.array([[d, -b], [-c, a]]) / area) ** 2) @ noise)
    sigma_x, sigma_y = (math.hypot(*pair) for pair in zip(own, geometry, strict=True))
    return sigma_x, sigma_y
