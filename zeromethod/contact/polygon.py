"""Closed polygons: (n, 2) points, the last joined to the first."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float


def closed(points: Float) -> Float:
    """A polygon (n, 2) with its first point again at the end, (n + 1, 2)."""
    return np.concatenate((points, points[:1]))


def perimeter(points: Float) -> float:
    """Length of a closed polygon (n, 2)."""
    return float(compiled_perimeter(_own(points)))


def signed_area(points: Float) -> float:
    """Area of a closed polygon, > 0 where it runs from the first coordinate to the second."""
    return float(compiled_moments(_own(points))[0])


def radius_of(points: Float) -> float:
    """That of a disc of a closed polygon's area."""
    return math.sqrt(abs(signed_area(points)) / math.pi)


def second_moments(points: Float) -> tuple[float, float, float, float, float, float]:
    """(signed area, centroid x, y, mean x^2, y^2, x y about it) of a closed polygon, by Green's theorem."""
    area, x, y, xx, yy, xy = compiled_moments(_own(points))
    return area, x, y, xx, yy, xy


def evenly(points: Float, count: int) -> Float:
    """`count` points (count, 2) evenly along a closed polygon (n, 2), from its first on."""
    return np.asarray(compiled_evenly(_own(points), count))


def normals(points: Float) -> Float:
    """(n, 2) unit vectors out of a closed polygon of positive area."""
    return np.asarray(compiled_normals(_own(points)))


def smooth(values: Float, sigma: float) -> Float:
    """Values (n, k) at the points of a polygon, smoothed along it; sigma: in points."""
    return np.asarray(compiled_smooth(_own(values), sigma))


def _own(points: Float) -> Float:
    return np.ascontiguousarray(points, dtype=np.float64)


@numba.njit(cache=True, nogil=True)
def compiled_perimeter(points: Float) -> float:
    """As `perimeter`."""
    total, before = 0.0, points[-1]
    for point in points:
        total += math.hypot(point[0] - before[0], point[1] - before[1])
        before = point
    return total


@numba.njit(cache=True, nogil=True)
def compiled_moments(points: Float) -> tuple[float, float, float, float, float, float]:
    """As `second_moments`."""
    n = len(points)
    u, v = 0.0, 0.0
    for i in range(n):
        u += points[i, 0] / n
        v += points[i, 1] / n
    area = cx = cy = xx = yy = xy = 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x, y, x1, y1 = points[i, 0] - u, points[i, 1] - v, points[j, 0] - u, points[j, 1] - v
        cross = x * y1 - x1 * y
        area += cross / 2
        cx += (x + x1) * cross / 6
        cy += (y + y1) * cross / 6
        xx += (x * x + x * x1 + x1 * x1) * cross / 12
        yy += (y * y + y * y1 + y1 * y1) * cross / 12
        xy += (x * y1 + 2 * x * y + 2 * x1 * y1 + x1 * y) * cross / 24
    if area == 0:
        return 0.0, u, v, 0.0, 0.0, 0.0
    cx, cy = cx / area, cy / area
    return area, u + cx, v + cy, xx / area - cx * cx, yy / area - cy * cy, xy / area - cx * cy


@numba.njit(cache=True, nogil=True)
def compiled_evenly(points: Float, count: int) -> Float:
    """As `evenly`."""
    n = len(points)
    step = compiled_perimeter(points) / count
    result = np.empty((count, 2))
    i, begin = 0, 0.0
    side = math.hypot(points[1 % n, 0] - points[0, 0], points[1 % n, 1] - points[0, 1])
    for k in range(count):
        while k * step > begin + side and i < n - 1:
            begin += side
            i += 1
            j = i + 1 if i + 1 < n else 0
            side = math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
        j = i + 1 if i + 1 < n else 0
        part = min((k * step - begin) / side, 1.0) if side > 0 else 0.0
        for axis in range(2):
            result[k, axis] = points[i, axis] + part * (points[j, axis] - points[i, axis])
    return result


@numba.njit(cache=True, nogil=True)
def compiled_normals(points: Float) -> Float:
    """As `normals`."""
    n = len(points)
    result = np.empty((n, 2))
    for i in range(n):
        after, before = points[i + 1 if i + 1 < n else 0], points[i - 1]
        along_u, along_v = after[0] - before[0], after[1] - before[1]
        size = max(math.hypot(along_u, along_v), 1e-9)
        result[i, 0], result[i, 1] = along_v / size, -along_u / size
    return result


@numba.njit(cache=True, nogil=True)
def compiled_smooth(values: Float, sigma: float) -> Float:
    """As `smooth`."""
    n, width = values.shape
    reach = int(4 * sigma + 0.5)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-9)) ** 2)
    weight /= weight.sum()
    result = np.zeros((n, width))
    for i in range(n):
        for b in range(2 * reach + 1):
            j = (i + b - reach) % n
            for k in range(width):
                result[i, k] += weight[b] * values[j, k]
    return result


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for compiled in (perimeter, signed_area, normals):
        compiled(square)
    evenly(square, 4)
    smooth(square, 1.0)
