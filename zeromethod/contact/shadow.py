"""A contact's border where steep rubber beside it is as dark as the object.

Rubber leaves a steep object along its flank. Where that turns the mirror below the critical angle it reflects
as little light as a black or grey object scatters, and the border looks too far out. But light inside a
contact is of one level, and from the border on rubber grows flatter, so that its reflectance rises from the
first pixel on. How steep it is at the border follows from the force, which the mirror far around says, and
from the contact's size: the border is moved to where the levels across it are likeliest for that.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.contact.flank import (
    ALIKE_PX,
    STEP_PX,
    Around,
    across,
    likeliest,
    profile,
    reflectance,
    reflectances,
)
from zeromethod.contact.likelihood import LEVELS
from zeromethod.contact.moments import moments
from zeromethod.contact.outline import Outline
from zeromethod.contact.polygon import (
    closed,
    compiled_moments,
    compiled_normals,
    evenly,
    normals,
    radius_of,
    signed_area,
)
from zeromethod.contact.region import Region
from zeromethod.optics import Optics
from zeromethod.optics.fresnel import s_share
from zeromethod.optics.mirror import normal_of
from zeromethod.optics.vectors import reflect

_CONE = 2.0
"""Slope at the border of a cone's contact over (depth x distance far from it) / radius^2. A ball's is 2.36,
and flatter a little way off: as dark together. Source: Johnson 1985, 4.2 and 5.2."""
_DOUBT = np.array([0.92, 1.0, 1.09])
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
        if not reflectances(steepest, outward, *around).min() < _REFLECTS:
            return None
        seen = np.column_stack((points_px, np.ones(len(points_px))))
        place = np.ascontiguousarray(np.linalg.lstsq(seen, mm, rcond=None)[0])
        grey = region.model.mirrored
        noise = (self._noise[0] + self._noise[1] * region.scattered * grey) / grey**2
        inside = int(np.clip(round(0.5 * radius_of(points_px)), *_IN_PX))
        at, open_px = _trimmed(
            start, place, *around, _CONE * at_1_mm, region.columns, region.model.light, region.scattered,
            noise / ALIKE_PX, self._blur, inside,
        )  # fmt: skip
        return Outline(_carried(points_px, start, at - start), _FOLLOWS * open_px)

    def _share(self, ray: Float, rest: Float) -> Float:
        """(n,) share of s-polarised light; a flank hardly turns the plane of incidence."""
        field = self._optics.panel.field
        if field is None:
            return np.full(len(ray), 0.5)
        normal = normal_of((rest[:, 0], rest[:, 1]))
        return s_share(-reflect(ray, normal), normal, field)


def _carried(points: Float, start: Float, moved: Float) -> Float:
    """Points (n, 2) of a closed polygon moved as `start`, evenly on it from its first, was."""
    line = closed(points)
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    place = np.arange(len(start) + 1) * (way[-1] / len(start))
    return points + np.stack([np.interp(way[:-1], place, closed(moved)[:, k]) for k in (0, 1)], axis=-1)


@numba.njit(cache=True, nogil=True)
def _trimmed(
    start: Float,
    place: Float,
    ray: Float,
    rest: Float,
    share: Float,
    index: float,
    push: float,
    columns: Bytes,
    light_of: Single,
    own: float,
    noise: float,
    blur: Float,
    inside: int,
) -> tuple[Float, float]:
    """(points (n, 2), rms px by which doubt of the slope moves them). push: slope x radius^2."""
    at, n = start.copy(), len(start)
    open_px, before = 0.0, 0.0
    for _ in range(_PASSES):
        mm = _on_mirror(at, place)
        area = compiled_moments(mm)[0]
        radius = math.sqrt(abs(area) / math.pi)
        if abs(radius - before) < _SETTLED * before:
            break
        before = radius
        out, outward = compiled_normals(at), compiled_normals(_waves(mm, _SHAPE))
        if area < 0:
            outward = -outward
        levels, known = across(at, out, columns, light_of, inside)
        moved = np.zeros((n, 3))
        for i in range(n):
            way = 0.0
            for k in range(2):
                way += (out[i, 0] * place[0, k] + out[i, 1] * place[1, k]) * outward[i, k]
            for h in range(3):
                slope = _DOUBT[h] * push / radius**2
                if reflectance(slope, outward[i], ray[i], rest[i], share[i], index) < _REFLECTS:
                    should = profile(
                        slope, radius, way, outward[i], ray[i], rest[i], share[i], index, own, noise, blur,
                        inside,
                    )  # fmt: skip
                    moved[i, h] = likeliest(levels[i], known[i], *should, inside)
        moved = _waves(moved, _WAVES)
        total = 0.0
        for i in range(n):
            total += (0.5 * (moved[i, 0] - moved[i, 2])) ** 2 / n
            for k in range(2):
                at[i, k] += moved[i, 1] * out[i, k]
        open_px = math.sqrt(total)
    return at, open_px


@numba.njit(cache=True, nogil=True)
def _on_mirror(points: Float, place: Float) -> Float:
    result = np.empty((len(points), 2))
    for i in range(len(points)):
        for k in range(2):
            result[i, k] = points[i, 0] * place[0, k] + points[i, 1] * place[1, k] + place[2, k]
    return result


@numba.njit(cache=True, nogil=True)
def _waves(values: Float, most: int) -> Float:
    """Values (n, k) round a border with only their lowest harmonics."""
    n, width = values.shape
    result = np.zeros((n, width))
    for k in range(width):
        for wave in range(most + 1):
            even = odd = 0.0
            for i in range(n):
                turn = 2 * math.pi * wave * i / n
                even += values[i, k] * math.cos(turn)
                odd += values[i, k] * math.sin(turn)
            scale = (1.0 if wave == 0 else 2.0) / n
            for i in range(n):
                turn = 2 * math.pi * wave * i / n
                result[i, k] += scale * (even * math.cos(turn) + odd * math.sin(turn))
    return result


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    square = np.array([[4.0, 4.0], [5.0, 4.0], [5.0, 5.0], [4.0, 5.0]])
    around = Around(np.ones((4, 3)), np.zeros((4, 2)), np.ones(4), 1.4)
    reflectances(0.1, square, *around)
    dark = np.zeros((9, 9), np.uint8)
    _trimmed(
        square,
        np.eye(3)[:, :2].copy(),
        *around,
        0.1,
        dark,
        np.zeros(LEVELS + 1, np.float32),
        0.1,
        1.0,
        np.ones(3),
        1,
    )
