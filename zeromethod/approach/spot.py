"""An object seen in both views: its place and size, once as a flat body and once as a round one."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.approach.body import Body, Pixels, fitted
from zeromethod.approach.exits import Exits
from zeromethod.approach.silhouettes import Silhouette
from zeromethod.arrays import Float

_PASSES = 4
LONG = 1.35
"""Longer axis over the shorter one, from which an object is taken for a rod."""
HIGHEST_MM = 200.0
MISS_MM, MISS_SHARE = 6.0, 0.01
"""How far apart the object may lie in the two views, across the direction in which its height moves them
apart: mm, and a share of the height."""
ALIKE = 2.5
"""Greatest ratio of the areas in the two views."""
ROUGHEST = 0.2
"""Where a body leaves more than this share of its light unexplained (`Body.rough`), the two silhouettes are
not of one object."""
VAGUE_MM = 5.0
"""Standard deviation of the height above which a fit is not used."""
SPARSE, EDGE_MM = 5, 2.0
"""Every so many-th ray is used to find how far a view reaches; so much at its sides is left out."""


@dataclass(frozen=True, slots=True)
class Spot:
    """An object fitted as a flat body and as a round one. cut: a view shows only a part of it."""

    flat: Body
    round_: Body
    cut: bool


def spot_of(
    exits: tuple[Exits, Exits], pair: tuple[Silhouette, Silhouette], known: Spot | None = None
) -> Spot | None:
    """The object that two silhouettes show; None where they do not belong together.

    known: the same object in an earlier frame. The fit starts from it where the two silhouettes do not match:
    one view may show only a little of it, cut by the border or as light as the room behind it.
    """
    start = _start(exits, pair)
    if start is not None:
        starts = start, start
    elif known is not None:
        starts = known.flat.fit, known.round_.fit
    else:
        return None
    pixels = _pixels(exits, pair)
    flat, round_ = (fitted(pixels, one, round_=kind) for one, kind in zip(starts, (False, True), strict=True))
    if flat is None or round_ is None or min(flat.rough, round_.rough) > ROUGHEST:
        return None
    if min(flat.sigma_mm[2], round_.sigma_mm[2]) > VAGUE_MM:
        return None
    return Spot(flat, round_, pair[0].cut or pair[1].cut)


def _start(exits: tuple[Exits, Exits], pair: tuple[Silhouette, Silhouette]) -> Float | None:
    """(6,) a rough body (`Body.fit`) by areas and moments; None where the two silhouettes do not match."""
    z = 30.0
    for _ in range(_PASSES):
        common = _common(exits, z) if pair[0].aside or pair[1].aside else None
        left, right = (_Planar(e, s, z, common) for e, s in zip(exits, pair, strict=True))
        if min(left.area_mm2, right.area_mm2) <= 0.0:
            return None
        between = left.tangent - right.tangent
        apart = left.place - right.place
        z -= float(apart @ between / (between @ between))
        if not -5.0 < z < HIGHEST_MM:
            return None
    ratio = left.area_mm2 / right.area_mm2
    miss = abs(float(apart @ [between[1], -between[0]])) / float(np.hypot(*between))
    if miss > MISS_MM + MISS_SHARE * abs(z) or not 1 / ALIKE < ratio < ALIKE:
        return None
    least, most = np.linalg.eigh(0.5 * (left.shape + right.shape))
    half = np.zeros(2)
    if pair[0].cut or pair[1].cut or least[1] > LONG**2 * least[0]:
        radius = float(np.sqrt(max(3.0 * least[0], 0.1)))
        half = max(float(np.sqrt(max(3.0 * least[1], 0.0))) - radius, 0.5) * most[:, 1]
    else:
        radius = float(np.sqrt(0.5 * (left.area_mm2 + right.area_mm2) / np.pi))
    return np.array([*(0.5 * (left.place + right.place)), z, *half, radius])


def _pixels(exits: tuple[Exits, Exits], pair: tuple[Silhouette, Silhouette]) -> Pixels:
    """The pixels of both windows, without those next to the end of a view."""
    parts: list[list[Float]] = []
    for number, (view, one) in enumerate(zip(exits, pair, strict=True)):
        window = one.rows, one.cols
        inner = cv2.erode(view.valid[window].astype(np.uint8), np.ones((3, 3))) > 0
        rays = [whole[window][inner] for whole in (view.foot, view.tangent, view.areas)]
        parts.append([*rays, one.seen_grey[inner], one.behind_grey[inner], np.full(inner.sum(), number)])
    foot, tangent, areas, seen, behind, number_of = (
        np.concatenate(both) for both in zip(*parts, strict=True)
    )
    noise_grey = max(one.noise_grey for one in pair)
    return Pixels(foot, tangent, areas, seen, behind, number_of > 0, noise_grey)


def _common(exits: tuple[Exits, Exits], z: float) -> tuple[Float, float, float]:
    """Direction (2,) from view to view; range along it, mm, in which both see the plane at height z."""
    middles = [one.tangent[one.valid].mean(axis=0) for one in exits]
    direction = (middles[0] - middles[1]) / np.linalg.norm(middles[0] - middles[1])
    seen = [(one.foot + z * one.tangent)[one.valid][::SPARSE] @ direction for one in exits]
    least, most = max(float(one.min()) for one in seen), min(float(one.max()) for one in seen)
    return direction, least + EDGE_MM, most - EDGE_MM


class _Planar:
    """A silhouette projected on the plane at height z: area, centroid, second moments (2, 2) mm^2."""

    def __init__(
        self, exits: Exits, silhouette: Silhouette, z: float, common: tuple[Float, float, float] | None
    ) -> None:
        """common: see `_common`; where given, only what lies in that range counts."""
        window = silhouette.rows, silhouette.cols
        tangent = exits.tangent[window]
        place: Float = exits.foot[window] + z * tangent
        weight = silhouette.cover * np.abs(exits.areas[window] @ [1.0, z, z * z]) * exits.valid[window]
        if common is not None:
            aside = place @ common[0]
            weight = weight * ((aside > common[1]) & (aside < common[2]))
        self.area_mm2 = float(weight.sum())
        if self.area_mm2 <= 0.0:
            return
        share: Float = weight / self.area_mm2
        self.place: Float = np.einsum("ij,ijk->k", share, place)
        self.tangent: Float = np.einsum("ij,ijk->k", share, tangent)
        off: Float = place - self.place
        self.shape = np.einsum("ij,ijk,ijl->kl", share, off, off)
