"""A thing seen in both views: where it is, how large, and whether it is round or flat underneath."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.approach.exits import Exits
from zeromethod.approach.silhouettes import Silhouette
from zeromethod.arrays import Float

_PASSES = 4
LONG = 1.35
"""Longer axis over the shorter one, from which a thing is a rod, taken as round across."""
HIGHEST_MM = 200.0
MISS_MM, MISS_SHARE = 1.0, 0.01
"""By how much the two views may disagree across the direction that says how high a thing is: mm and a share
of the height."""
ALIKE = 1.6
SPARSE, EDGE_MM = 5, 2.0
"""One ray in so many says how far a view reaches; this much of it at the sides is left out."""
"""Most ratio of the areas in the two views."""


@dataclass(frozen=True, slots=True)
class Spot:
    """Silhouettes of both views taken together.

    place: (3,) mm, of the silhouette's middle. radius_mm: half the width, of a rod half the shorter one.
    round_: 0 where it looks flat, 1 where round, with noise, so also beyond; NaN for a rod, which is round.
    lever_mm: from the mirror down to where the lens seems to be. slant2: square of the rays' slope, mean of
    both. cut: only a part of it is in view: height and y are right, x and size are not. doubt_mm: by how much
    the views disagree about its size, as one does that misses a part as light as the background.
    reach_mm: half its extent across the views.
    """

    place: Float
    radius_mm: float
    round_: float
    weight: float
    lever_mm: float
    slant2: float
    cut: bool
    doubt_mm: float
    reach_mm: float


def spot_of(exits: tuple[Exits, Exits], pair: tuple[Silhouette, Silhouette]) -> Spot | None:
    """What two silhouettes are together; None where they do not belong together."""
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
    shape = 0.5 * (left.shape + right.shape)
    least, most = np.linalg.eigvalsh(shape)
    lever = 0.5 * (left.lever_mm + right.lever_mm)
    doubt = abs(float(np.sqrt(ratio)) - 1.0) * float(np.sqrt(left.area_mm2 / np.pi))
    slant2 = 0.5 * float(left.tangent @ left.tangent + right.tangent @ right.tangent)
    place = np.array([*(0.5 * (left.place + right.place)), z])
    cut = pair[0].cut or pair[1].cut
    if cut or most > LONG**2 * least:
        radius, round_, weight = float(np.sqrt(3.0 * max(least, 0.0))), np.nan, 0.0
        aside = between / np.hypot(*between)
        reach = max(float(np.sqrt(3.0 * max(float(aside @ shape @ aside), 0.0))), radius)
    else:
        rounds, weights = zip(*(one.roundness() for one in (left, right)), strict=True)
        weight = sum(weights)
        round_ = float(np.average(rounds, weights=weights))
        area = 0.5 * (left.area_mm2 + right.area_mm2)
        radius = float(np.sqrt(area / np.pi / np.sqrt(1.0 + min(max(round_, 0.0), 1.0) * slant2)))
        weight *= radius**2
        reach = radius
    return Spot(place, radius, round_, weight, lever, slant2, cut, doubt, reach)


def _common(exits: tuple[Exits, Exits], z: float) -> tuple[Float, float, float]:
    """Direction (2,) across both views, and from where to where along it, mm, both see the plane at z."""
    middles = [one.tangent[one.valid].mean(axis=0) for one in exits]
    direction = (middles[0] - middles[1]) / np.linalg.norm(middles[0] - middles[1])
    seen = [(one.foot + z * one.tangent)[one.valid][::SPARSE] @ direction for one in exits]
    least, most = max(float(one.min()) for one in seen), min(float(one.max()) for one in seen)
    return direction, least + EDGE_MM, most - EDGE_MM


class _Planar:
    """A silhouette as it lies on the plane at height z: area, middle, second moments (2, 2) mm^2."""

    def __init__(
        self, exits: Exits, silhouette: Silhouette, z: float, common: tuple[Float, float, float] | None
    ) -> None:
        """common: of what the sides cut only this part counts, which both views see."""
        window = silhouette.rows, silhouette.cols
        foot, tangent = exits.foot[window], exits.tangent[window]
        place: Float = foot + z * tangent
        by_row, by_col = (np.gradient(place, axis=axis) for axis in (0, 1))
        pixel_mm2: Float = np.abs(by_row[..., 0] * by_col[..., 1] - by_row[..., 1] * by_col[..., 0])
        weight = silhouette.cover * pixel_mm2 * exits.valid[window]
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
        # a pixel is no point: its own second moments are no part of the thing's
        blur = pixel_mm2.mean() / 12.0
        self.shape = np.einsum("ij,ijk,ijl->kl", share, off, off) - blur * np.eye(2)
        feet, tangents = (np.gradient(one, axis=1).mean(axis=(0, 1)) for one in (foot, tangent))
        self.lever_mm = float(np.hypot(*feet) / np.hypot(*tangents))

    def roundness(self) -> tuple[float, float]:
        """(roundness, weight): a ball seen aslant is longer along the slant by 1 / cos, a plate is not."""
        slant2 = float(self.tangent @ self.tangent)
        along = self.tangent / np.sqrt(slant2)
        across = np.array([along[1], -along[0]])
        longer = float(along @ self.shape @ along) / float(across @ self.shape @ across)
        return (longer - 1.0) / slant2, slant2**2
