"""Closed polygons: (n, 2) points, the last joined to the first."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d

from zeromethod.arrays import Float


def closed(points: Float) -> Float:
    """A polygon (n, 2) with its first point again at the end, (n + 1, 2)."""
    return np.concatenate((points, points[:1]))


def way_along(points: Float) -> Float:
    """(n + 1,) length of a closed polygon (n, 2) up to each point, and that of all of it."""
    sides = np.diff(closed(points), axis=0)
    way = np.zeros(len(points) + 1)
    np.cumsum(np.hypot(sides[:, 0], sides[:, 1]), out=way[1:])
    return way


def perimeter(points: Float) -> float:
    """Length of a closed polygon (n, 2)."""
    return float(way_along(points)[-1])


def signed_area(points: Float) -> float:
    """Area of a closed polygon, > 0 where it runs from the first coordinate to the second."""
    x, y = (closed(points) - points.mean(axis=0)).T
    return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2


def radius_of(points: Float) -> float:
    """That of a disc of a closed polygon's area."""
    return math.sqrt(abs(signed_area(points)) / math.pi)


def second_moments(points: Float) -> tuple[float, float, float, float, float, float]:
    """(signed area, centroid x, y, mean x^2, y^2, x y about it) of a closed polygon, by Green's theorem."""
    u, v = points.mean(axis=0)
    x, y = (closed(points) - (u, v)).T
    x, y, x1, y1 = x[:-1], y[:-1], x[1:], y[1:]
    cross = x * y1 - x1 * y
    area = cross.sum() / 2
    if area == 0:
        return 0.0, float(u), float(v), 0.0, 0.0, 0.0
    terms = np.stack(
        [
            (x + x1) / 6,
            (y + y1) / 6,
            (x * x + x * x1 + x1 * x1) / 12,
            (y * y + y * y1 + y1 * y1) / 12,
            (x * y1 + 2 * x * y + 2 * x1 * y1 + x1 * y) / 24,
        ]
    )
    cx, cy, xx, yy, xy = (float(one) for one in (terms * cross).sum(axis=1) / area)
    return float(area), float(u + cx), float(v + cy), xx - cx * cx, yy - cy * cy, xy - cx * cy


def evenly(points: Float, count: int) -> Float:
    """`count` points (count, 2) evenly along a closed polygon (n, 2), from its first on."""
    way, line = way_along(points), closed(points)
    at = way[-1] / count * np.arange(count)
    return np.stack([np.interp(at, way, line[:, k]) for k in (0, 1)], axis=-1)


def normals(points: Float) -> Float:
    """(n, 2) unit vectors out of a closed polygon of positive area."""
    along = np.concatenate((points[1:], points[:1])) - np.concatenate((points[-1:], points[:-1]))
    size = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    return np.stack((along[:, 1] / size, -along[:, 0] / size), axis=-1)


def smooth(values: Float, sigma: float) -> Float:
    """Values (n, k) at the points of a polygon, smoothed along it; sigma: in points."""
    return np.asarray(gaussian_filter1d(values, sigma, axis=0, mode="wrap"))
