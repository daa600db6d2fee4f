"""From pixels of a contact's border to mm on the mirror, and what light beyond the border adds to it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from zeromethod.arrays import Float, Mask
from zeromethod.contact.moments import moments
from zeromethod.contact.polygon import perimeter
from zeromethod.optics import Optics
from zeromethod.surface import Surface
from zeromethod.warp.grid import NodeGrid

WAVELENGTH_MM = 550e-6
MOST_LIGHT_MM = 0.03
"""Most that the border is taken to look too large."""
_RING_MM = 8.0
_FEWEST = 20
_AROUND = 6
"""Nodes around a border in which its depth is looked for."""
_KNOWN = 48
"""Points of a border at which the depth is looked up."""


_ROUND = 0.6
"""Shorter over longer axis from which a contact counts as round."""
_RIM = 1.16
"""Depth at the rim of a ball's or cone's contact over force / radius as the far field has it: 3 pi / 8 and
pi / 2 (pi / 2 - 1) 2 / pi = 1.14. Source: Johnson 1985, 4.2 and 5.2."""


class Seen(NamedTuple):
    """A border in mm, (n, 2), what its depth leaves open of its place, and the light lost beyond it, mm.

    at_1_mm: depth x distance far from it, mm^2; 0 where it is not known.
    """

    outline_mm: Float
    sigma_mm: tuple[float, float]
    beyond_mm: float
    at_1_mm: float = 0.0


class _Force(NamedTuple):
    """depth = depth_mm + at_1_mm / distance."""

    at_1_mm: float
    depth_mm: float


def _open(depth: Float, per_depth: Float) -> tuple[float, float]:
    """What a depth that is not known does to places, mm along x and y."""
    x, y = (float(np.sqrt(np.mean((depth * per_depth[:, k]) ** 2))) for k in (0, 1))
    return x, y


class MirrorPlaces:
    """Where on the mirror the pixels of a border lie, with the depth that was read around it."""

    def __init__(self, optics: Optics, grid: NodeGrid) -> None:
        u, v = grid.mesh()
        trace = optics.trace(u, v, optics.rest)
        _, direction = optics.rubber_rays(u, v)
        self._first = np.array([grid.u_px[0], grid.v_px[0]], dtype=np.float64)
        self._spacing = grid.spacing_px
        self._point = np.ascontiguousarray(np.nan_to_num(trace.point[..., :2]))
        self._per_depth = np.nan_to_num(direction[..., :2] / direction[..., 2:])
        beyond = optics.rig.prism.index**2 * (1 - np.nan_to_num(trace.cos_incidence) ** 2) - 1
        self._evanescent = (WAVELENGTH_MM / (2 * np.pi * np.sqrt(np.maximum(beyond, 0.01))))[..., None]

    def at_depth(self, nodes: Mask, depth_mm: Float) -> Float:
        """(n, 2) mm where the rays of n nodes (rows, cols) meet the mirror at these depths, mm."""
        return np.asarray(self._point[nodes] - depth_mm[:, None] * self._per_depth[nodes])

    def at_rest(self, points_px: Float) -> Float:
        """(n, 2) mm where pixels (n, 2) look at the mirror at rest."""
        return self._at(self._point, points_px)

    def per_depth(self, points_px: Float) -> Float:
        """(n, 2): how far a ray goes along x and y per mm of depth, at pixels (n, 2)."""
        return self._at(self._per_depth, points_px)

    def beside(self, px: Float, known_px: Float, known_mm: Float) -> tuple[float, float]:
        """Where a pixel (1, 2) next to one lies of which the place in mm is known."""
        here, there = self._at(self._point, px)[0], self._at(self._point, known_px[None])[0]
        x, y = here - there + known_mm
        return float(x), float(y)

    def seen(self, points_px: Float, surface: Surface) -> Seen:
        """Where the border points (n, 2) px lie, at the depth that the nodes around say.

        The gap beside a ball opens as distance^1.5, with a factor by Hertz from the contact's size and the
        depth far from it, which falls as force / distance; light is lost in it beyond the border.
        """
        at_rest, per_depth = self._at(self._point, points_px), self._at(self._per_depth, points_px)
        few = np.linspace(0, len(points_px), min(_KNOWN, len(points_px)), endpoint=False).astype(int)
        depth = self._depth(at_rest[few], points_px, surface)
        depth = np.interp(np.arange(len(points_px)), few, depth, period=len(points_px))
        shape = moments(at_rest)
        force = self._force(at_rest.mean(axis=0), shape.area_mm2, surface)
        if force is None:
            return Seen(at_rest - depth[:, None] * per_depth, _open(0.5 * depth, per_depth), MOST_LIGHT_MM)
        rim = force.depth_mm + _RIM * force.at_1_mm / np.sqrt(shape.area_mm2 / np.pi)
        doubt = 0.5 * (rim - depth)
        if shape.minor_mm > _ROUND * shape.major_mm:
            depth = np.full_like(depth, rim)
        opening = (
            2.83 * np.pi * force.at_1_mm / (shape.area_mm2 * np.sqrt(2 * shape.area_mm2 / perimeter(at_rest)))
        )
        evanescent = float(np.mean(self._at(self._evanescent, points_px)))
        beyond = min(0.9 * (evanescent / (2 * opening)) ** (2 / 3), MOST_LIGHT_MM)
        return Seen(
            at_rest - depth[:, None] * per_depth, _open(doubt, per_depth), float(beyond), force.at_1_mm
        )

    @staticmethod
    def _force(centre: Float, area_mm2: float, surface: Surface) -> _Force | None:
        """The far field of the contact; None where too little of it was read, or it does not press."""
        size = float(np.sqrt(area_mm2 / np.pi))
        few = np.s_[::2, ::2]
        away = np.hypot(surface.x_mm[few] - centre[0], surface.y_mm[few] - centre[1])
        ring = surface.valid[few] & (away > 1.3 * size + 0.5) & (away < 6 * size + _RING_MM)
        if np.count_nonzero(ring) < _FEWEST:
            return None
        # the best depth = at_1_mm / distance + depth_mm
        near, depth = 1 / away[ring], surface.depth_mm[few][ring]
        off = near - near.mean()
        at_1_mm = float((off * depth).sum() / (off * off).sum())
        return _Force(at_1_mm, float(depth.mean() - at_1_mm * near.mean())) if at_1_mm > 0 else None

    def _depth(self, at_mm: Float, points_px: Float, surface: Surface) -> Float:
        """Depth next to a hole: the nearest node's, continued by its slope; 0 where none was read."""
        low, high = points_px.min(axis=0), points_px.max(axis=0)
        first = ((low - self._first) // self._spacing).astype(int) - _AROUND
        last = ((high - self._first) // self._spacing).astype(int) + _AROUND + 2
        cols, rows = (slice(max(int(f), 0), max(int(e), 0)) for f, e in zip(first, last, strict=True))
        part = rows, cols
        near = surface.valid[part]
        if not near.any():
            return np.zeros(len(at_mm))
        x, y, depth = (one[part][near] for one in (surface.x_mm, surface.y_mm, surface.depth_mm))
        off2 = (at_mm[:, :1] - x) ** 2 + (at_mm[:, 1:] - y) ** 2
        nearest = off2.argmin(axis=1)
        off = at_mm - np.stack((x[nearest], y[nearest]), axis=-1)
        return np.asarray(depth[nearest] + (surface.slope[part][near][nearest] * off).sum(axis=1))

    def _at(self, values: Float, points_px: Float) -> Float:
        """Values (rows, cols, k) of the nodes at pixels (n, 2), linear between: (n, k)."""
        place = ((points_px - self._first) / self._spacing).T[::-1]
        parts = np.moveaxis(values, -1, 0)
        return np.stack([map_coordinates(one, place, order=1, mode="nearest") for one in parts], axis=-1)
