"""A contact's border where steep rubber beside it is as dark as the object.

Rubber leaves a steep object along its flank. Where that turns the mirror below the critical angle it reflects
as little light as a black or grey object scatters, and the border looks too far out. But light inside a
contact is of one level, and from the border on rubber grows flatter, so that its reflectance rises from the
first pixel on. How steep it is at the border follows from the force, which the mirror far around says, and
from the contact's size: the border is moved to where the levels across it are likeliest for that.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.contact.flank import ALIKE_PX, STEP_PX, Around, Flank, across, lit, reflectances
from zeromethod.contact.moments import moments
from zeromethod.contact.outline import Outline
from zeromethod.contact.polygon import closed, evenly, normals, radius_of, signed_area, way_along
from zeromethod.contact.region import Region
from zeromethod.optics import Optics
from zeromethod.optics.fresnel import s_share
from zeromethod.optics.mirror import normal_of
from zeromethod.optics.vectors import reflect

_CONE = 2.0
"""Slope at the border of a cone's contact over (depth x distance far from it) / radius^2. A ball's is 2.36,
and flatter a little way off: as dark together. Source: Johnson 1985, 4.2 and 5.2."""
_DOUBT = 0.92, 1.09
"""What other shapes may have of it, and the law."""
_FOLLOWS = 2.0
"""What such doubt does at last over what it does in one pass: the slope follows the radius."""
_DARK = 0.15
"""Light over the mean from which an object is brighter than any shadow: its border is where light falls."""
_ROUND = 0.6
"""Shorter over longer axis of contacts that the law is for."""
_PASSES = 8
_SETTLED = 2e-3
"""Change of the radius, relative, that ends the passes."""
_REFLECTS = 0.9
"""Reflectance next to the border below which it has a shadow."""
_POINTS = 40
_SHAPE, _WAVES = 3, 4
"""Harmonics of the border that say which way it faces, and of what it is moved by."""
_IN_PX = 8, 24
"""Pixels that are looked at inside: half a radius, within these."""


class _Border(NamedTuple):
    """A contact's border, with the light across it.

    radius: of a disc of its area, mm. out: (n, 2) outwards, px; outward: on the mirror. mm_per_px: (n,) along
    these. levels, known: (n, positions) as `across` has them, from `inside` px inside on.
    """

    radius: float
    out: Float
    outward: Float
    mm_per_px: Float
    levels: Float
    known: Float
    inside: int

    @classmethod
    def of(cls, at: Float, place: Float, picture: Single, inside: int) -> _Border:
        """At points (n, 2) px. place: (3, 2) mm of a pixel's u, v and 1."""
        mm = at @ place[:2] + place[2]
        area = signed_area(mm)
        out, outward = normals(at), normals(_lowest(_SHAPE) @ mm) * np.sign(area)
        mm_per_px = ((out @ place[:2]) * outward).sum(axis=1)
        seen = across(at, out, picture, inside)
        return cls(math.sqrt(abs(area) / math.pi), out, outward, mm_per_px, *seen, inside)


class Shadows:
    """Takes the shadows of steep flanks off contacts' borders."""

    def __init__(self, optics: Optics, blur_px: float, noise: tuple[float, float]) -> None:
        self._optics, self._noise = optics, noise
        reach = np.arange(-round(3 * blur_px / STEP_PX), round(3 * blur_px / STEP_PX) + 1) * STEP_PX
        blur = np.exp(-0.5 * (reach / blur_px) ** 2)
        self._blur: Float = blur / blur.sum()

    def without(
        self, points_px: Float, region: Region, mm: Float, per_depth: Float, at_1_mm: float
    ) -> Outline | None:
        """The border without its shadow; None where it has none.

        Parameters
        ----------
        points_px : (n, 2) array
            The border as it looks, in the region's pixels, anticlockwise as x runs to y.
        region : Region
            Its light.
        mm, per_depth : (n, 2) array
            The same points on the mirror, and what a ray goes along x and y per depth.
        at_1_mm : float
            Depth x distance far from the contact, mm^2.

        Returns
        -------
        Outline or None
            Where the levels begin to rise; its sigma is what shapes leave open of that.
        """
        if region.parted or region.scattered > _DARK or not at_1_mm > 0:
            return None
        shape = moments(mm)
        if shape.minor_mm < _ROUND * shape.major_mm:
            return None
        start, at_mm = evenly(points_px, _POINTS), evenly(mm, _POINTS)
        ray = np.concatenate((evenly(per_depth, _POINTS), np.ones((_POINTS, 1))), axis=1)
        ray /= np.sqrt((ray * ray).sum(axis=1, keepdims=True))
        rest = np.stack(self._optics.rest.gradient(*at_mm.T), axis=-1)
        around = Around(ray, rest, self._share(ray, rest), self._optics.rig.prism.index)
        outward = normals(at_mm) * np.sign(signed_area(mm))
        steepest = _DOUBT[-1] * _CONE * at_1_mm / radius_of(mm) ** 2
        if not reflectances(np.array([steepest]), outward, around).min() < _REFLECTS:
            return None
        seen = np.column_stack((points_px, np.ones(len(points_px))))
        place = np.asarray(np.linalg.lstsq(seen, mm, rcond=None)[0], np.float64)
        inside = int(np.clip(round(0.5 * radius_of(points_px)), *_IN_PX))
        at, open_px = self._trimmed(start, place, around, _CONE * at_1_mm, region, inside)
        return Outline(_carried(points_px, start, at - start), _FOLLOWS * open_px)

    def _trimmed(
        self, at: Float, place: Float, around: Around, push: float, region: Region, inside: int
    ) -> tuple[Float, float]:
        """(points (n, 2), rms px by which doubt of the slope moves them). push: slope x radius^2.

        place: (3, 2) mm of a pixel's u, v and 1. inside: px that are looked at.
        """
        picture, radius = lit(region.columns, region.model.light), 0.0
        for _ in range(_PASSES):
            seen = _Border.of(at, place, picture, inside)
            if abs(seen.radius - radius) < _SETTLED * radius:
                break
            border, radius = seen, seen.radius
            slope = push / radius**2
            at = at + self._moved(border, slope, around, region)[:, None] * border.out
        less, more = (self._moved(border, share * slope, around, region) for share in _DOUBT)
        return at, float(np.sqrt(np.mean((0.5 * (less - more)) ** 2)))

    def _moved(self, border: _Border, slope: float, around: Around, region: Region) -> Float:
        """(n,) px to where the levels are likeliest; 0 where there is no shadow."""
        grey = region.model.mirrored
        noise = (self._noise[0] + self._noise[1] * region.scattered * grey) / grey**2 / ALIKE_PX
        flank = Flank.of(slope, border.radius, border.mm_per_px, border.outward, around)
        off = flank.likeliest(border.levels, border.known, self._blur, region.scattered, noise, border.inside)
        return _lowest(_WAVES) @ np.where(flank.light[:, 0] < _REFLECTS, off, 0.0)

    def _share(self, ray: Float, rest: Float) -> Float:
        """(n,) share of s-polarised light; a flank hardly turns the plane of incidence."""
        field = self._optics.panel.field
        if field is None:
            return np.full(len(ray), 0.5)
        normal = normal_of((rest[:, 0], rest[:, 1]))
        return s_share(-reflect(ray, normal), normal, field)


def _carried(points: Float, start: Float, moved: Float) -> Float:
    """Points (n, 2) of a closed polygon moved as `start`, evenly on it from its first, was."""
    way = way_along(points)
    place = np.arange(len(start) + 1) * (way[-1] / len(start))
    return points + np.stack([np.interp(way[:-1], place, closed(moved)[:, k]) for k in (0, 1)], axis=-1)


@lru_cache
def _lowest(most: int) -> Float:
    """(_POINTS, _POINTS) that leaves of values round a border only their lowest harmonics."""
    waves = np.exp(2j * np.pi / _POINTS * np.outer(np.arange(_POINTS), np.arange(-most, most + 1)))
    return np.asarray((waves @ waves.conj().T).real / _POINTS)
