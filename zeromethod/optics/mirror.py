"""Shapes of the mirror as height fields, and their intersection with rays from inside the rubber."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.model import RestSurface, Rig

_ITERATIONS, _MISS_MM = 60, 1e-9
"""Most steps along a ray, and how far from the surface a point that lies on it may be."""


class HeightField(Protocol):
    """A surface z(x, y) in mm, positive out of the rubber; x, y in mm, all shapes equal."""

    def height(self, x: Float, y: Float) -> Float:
        """Height z (...) in mm; NaN where there is no surface."""
        ...

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dz/dx, dz/dy), each (...), dimensionless: the exact derivatives of `height`."""
        ...


class DepthField(Protocol):
    """A dent: depth d(x, y) in mm below the rest surface along z, positive into the rubber."""

    def depth(self, x: Float, y: Float) -> Float:
        """Depth (...) in mm."""
        ...

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dd/dx, dd/dy), each (...), rad: the exact derivatives of `depth`."""
        ...


@dataclass(frozen=True)
class Flat:
    """The plane z = 0."""

    def height(self, x: Float, y: Float) -> Float:  # noqa: ARG002 (a plane is the same everywhere)
        """Zero everywhere."""
        return np.zeros_like(x)

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Zero everywhere."""
        return np.zeros_like(x), np.zeros_like(y)


@dataclass(frozen=True)
class Sphere:
    """A spherical cap that touches z = 0 at its centre; NaN beyond its equator.

    Convention: `radius_mm` > 0 bulges out of the rubber (z < 0 away from the centre), < 0 is hollow.
    """

    radius_mm: float
    centre_mm: tuple[float, float] = (0.0, 0.0)

    def _root(self, x: Float, y: Float) -> tuple[Float, Float, Float]:
        x, y = x - self.centre_mm[0], y - self.centre_mm[1]
        with np.errstate(invalid="ignore"):
            root = np.copysign(np.sqrt(self.radius_mm**2 - x * x - y * y), self.radius_mm)
        return x, y, root

    def height(self, x: Float, y: Float) -> Float:
        """Height in mm, written so that a large radius loses no digits."""
        x, y, root = self._root(x, y)
        result: Float = -(x * x + y * y) / (self.radius_mm + root)
        return result

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dz/dx, dz/dy)."""
        x, y, root = self._root(x, y)
        return -x / root, -y / root


@dataclass(frozen=True)
class Cylinder:
    """A cylinder that touches z = 0 along a line through its centre; NaN beyond its equator.

    Convention: as `Sphere`; the line is turned by `axis_deg` from x towards y.
    """

    radius_mm: float
    centre_mm: tuple[float, float] = (0.0, 0.0)
    axis_deg: float = 0.0

    def _across(self, x: Float, y: Float) -> tuple[Float, Float, tuple[float, float]]:
        """Distance from the line, the root of what is left of the radius, and the way off the line."""
        turn = np.radians(self.axis_deg)
        off = -float(np.sin(turn)), float(np.cos(turn))
        away = off[0] * (x - self.centre_mm[0]) + off[1] * (y - self.centre_mm[1])
        with np.errstate(invalid="ignore"):
            root = np.copysign(np.sqrt(self.radius_mm**2 - away * away), self.radius_mm)
        return away, root, off

    def height(self, x: Float, y: Float) -> Float:
        """Height in mm, written so that a large radius loses no digits."""
        away, root, _ = self._across(x, y)
        result: Float = -(away * away) / (self.radius_mm + root)
        return result

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dz/dx, dz/dy)."""
        away, root, off = self._across(x, y)
        return -off[0] * away / root, -off[1] * away / root


class GridHeight:
    """Interpolating bicubic spline (twice continuously differentiable) through a map of heights.

    Convention: `heights_mm` (rows along y, cols along x), first point at `origin_mm` = (x, y), equal
    pitch on both axes. Outside the map its border's heights are continued unchanged.
    """

    def __init__(self, heights_mm: Float, pitch_mm: float, origin_mm: tuple[float, float]) -> None:
        rows, cols = heights_mm.shape
        x = origin_mm[0] + pitch_mm * np.arange(cols)
        y = origin_mm[1] + pitch_mm * np.arange(rows)
        self.x_range_mm = float(x[0]), float(x[-1])
        self.y_range_mm = float(y[0]), float(y[-1])
        self._spline = scipy.interpolate.RectBivariateSpline(y, x, heights_mm, kx=3, ky=3, s=0)

    def _clamped(self, x: Float, y: Float) -> tuple[Float, Float]:
        return np.clip(x, *self.x_range_mm), np.clip(y, *self.y_range_mm)

    def _evaluate(self, x: Float, y: Float, dx: int, dy: int) -> Float:
        known = np.isfinite(x) & np.isfinite(y)
        values = self._spline.ev(np.where(known, y, 0.0), np.where(known, x, 0.0), dx=dy, dy=dx)
        return np.where(known, values, np.nan)

    def height(self, x: Float, y: Float) -> Float:
        """Height in mm."""
        return self._evaluate(*self._clamped(x, y), 0, 0)

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dz/dx, dz/dy); 0 across the border outside the map."""
        x_in, y_in = self._clamped(x, y)
        along_x, along_y = self._evaluate(x_in, y_in, 1, 0), self._evaluate(x_in, y_in, 0, 1)
        return np.where(x == x_in, along_x, 0.0 * along_x), np.where(y == y_in, along_y, 0.0 * along_y)


@dataclass(frozen=True)
class Dented:
    """A rest surface with a dent pressed into it: z = rest - depth."""

    rest: HeightField
    dent: DepthField

    def height(self, x: Float, y: Float) -> Float:
        """Height in mm."""
        result: Float = self.rest.height(x, y) - self.dent.depth(x, y)
        return result

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dz/dx, dz/dy)."""
        (zx, zy), (dx, dy) = self.rest.gradient(x, y), self.dent.slope(x, y)
        return zx - dx, zy - dy


def rest_surface(rig: Rig) -> HeightField:
    """Undeformed mirror of a rig. Raises InputError where its height map cannot be used."""
    return height_field(rig.prism.rest)


def height_field(rest: RestSurface) -> HeightField:
    """Heights of a mirror at rest. Raises InputError where its map cannot be used."""
    if rest.shape == "sphere":
        assert rest.radius_mm is not None
        return Sphere(rest.radius_mm, rest.centre_mm)
    if rest.shape == "cylinder":
        assert rest.radius_mm is not None
        return Cylinder(rest.radius_mm, rest.centre_mm, rest.axis_deg)
    if rest.shape == "map":
        assert rest.pitch_mm is not None
        return GridHeight(rest_heights(rest), rest.pitch_mm, rest.origin_mm)
    return Flat()


def rest_heights(rest: RestSurface) -> Float:
    """Heights (rows along y, cols along x) of a rest surface given as a map, mm.

    Raises InputError where they cannot be used.
    """
    assert rest.file is not None
    try:
        heights = np.load(rest.file).astype(np.float64)
        if heights.ndim != 2 or min(heights.shape) < 4 or not np.isfinite(heights).all():
            raise ValueError(f"shape {heights.shape}: a map needs at least 4 x 4 finite heights")
    except (OSError, ValueError) as error:
        raise InputError(f"prism.rest.file: {rest.file}: {' '.join(str(error).split())}") from error
    return np.asarray(heights)


def normal_of(gradient: tuple[Float, Float]) -> Float:
    """Unit normal (..., 3), out of the rubber, of a surface with (dz/dx, dz/dy)."""
    zx, zy = gradient
    length = np.sqrt(1.0 + zx * zx + zy * zy)
    return np.stack([-zx / length, -zy / length, 1.0 / length], axis=-1)


def distance_to(mirror: HeightField, origin: Float, direction: Float) -> Float:
    """Distance (...) in mm along rays from inside the rubber to the mirror.

    origin, direction: (..., 3), directions unit. Newton from the plane z = 0, kept in its bracket by
    bisection. NaN where a ray does not rise, or meets no surface. A surface steeper than the ray
    (some 40 deg, far beyond total reflection) can be met several times; not always the first is found.
    """
    x0, y0, z0 = (origin[..., i] for i in range(3))
    dx, dy, dz = (direction[..., i] for i in range(3))
    with np.errstate(all="ignore"):
        t = np.where(dz > 0.0, -z0 / dz, np.nan)
        low, high = np.zeros_like(t), np.full_like(t, np.inf)
        for _ in range(_ITERATIONS):
            x, y = x0 + t * dx, y0 + t * dy
            above = z0 + t * dz - mirror.height(x, y)
            zx, zy = mirror.gradient(x, y)
            low, high = np.where(above < 0.0, t, low), np.where(above > 0.0, t, high)
            step = above / (dz - zx * dx - zy * dy)
            unsettled = np.abs(step) > 1e-14 * (1.0 + np.abs(t))
            stepped = t - step
            strayed = unsettled & ~((stepped > low) & (stepped < high))
            halved = np.where(np.isfinite(high), 0.5 * (low + high), 2.0 * t + 1.0)
            t = np.where(strayed & ~np.isnan(t), halved, stepped)
            if not unsettled.any():
                break
    return np.where(np.abs(above) < _MISS_MM, t, np.nan)
