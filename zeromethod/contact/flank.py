"""Levels across a contact's border beside which rubber falls away steeply: seen, and as they should be."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from scipy.ndimage import map_coordinates

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.contact.likelihood import UNKNOWN
from zeromethod.contact.polygon import perimeter, smooth
from zeromethod.kernels import kernel, read

STEP_PX = 0.5
"""Step of the levels as they should be."""
OUT_PX = 6
"""Pixels that are looked at outside."""
ALONG_PX = 1.0
"""Standard deviation along the border of what levels are taken together."""
ALIKE_PX = 2 * math.sqrt(math.pi) * ALONG_PX
"""Pixels along the border that are one for the noise."""
_LAW = 0.25
"""What the law leaves open of the light in a shadow, relative."""
_PICTURE = 0.35
"""Deviation of the light beyond, where the picture's phase is not known, over its mean."""
_LEAST_KNOWN = 0.3
_AT = np.linspace(0.0, 1.0, 33) ** 2 * 2.0
"""Distances from the border over the radius at which the law is worked out."""
_RHO = 1 + _AT
_FALL = 1 - np.sqrt(_RHO**2 - 1) / _RHO
_DROP = _AT - np.sqrt(_RHO**2 - 1) + np.arccos(1 / _RHO)
"""Rubber beside a cone: slope over that at the border; drop over radius and that slope. A ball's differ by a
tenth. Source: Sneddon 1965, Int. J. Eng. Sci. 3, 47-57."""


class Around(NamedTuple):
    """What the camera sees about n points of a border.

    ray: (n, 3) unit vectors towards the mirror. rest: (n, 2) slopes of the mirror's own shape. share: (n,) of
    s-polarised light. rubber: its index.
    """

    ray: Float
    rest: Float
    share: Float
    rubber: float


def reflectances(slope: Float, outward: Float, around: Around) -> Float:
    """(n, k) reflectance of a mirror that falls away outwards by slopes (k,), as `optics.fresnel` has it."""
    zx, zy = (around.rest[:, axis, None] + slope * outward[:, axis, None] for axis in (0, 1))
    ray_x, ray_y, ray_z = around.ray.T[:, :, None]
    cosine = (ray_z - zx * ray_x - zy * ray_y) / np.sqrt(1 + zx * zx + zy * zy)
    passes = np.sqrt(np.maximum(1 - around.rubber**2 * (1 - cosine * cosine), 0.0))
    s = (around.rubber * cosine - passes) / (around.rubber * cosine + passes)
    p = (cosine - around.rubber * passes) / (cosine + around.rubber * passes)
    share = around.share[:, None]
    return np.where(cosine > 0, share * s * s + (1 - share) * p * p, 0.0)


def lit(columns: Bytes, light_of: Single) -> Single:
    """(2, rows, cols) light of a picture's pixels, 0 where it is not known, and 1 where it is.

    light_of: that of each of the `columns`.
    """
    known = columns != UNKNOWN
    return np.stack((light_of[columns] * known, known), dtype=np.float32)


def across(at: Float, out: Float, picture: Single, inside: int) -> tuple[Float, Float]:
    """(n, positions) levels across a border, from `inside` px inside on, and the share of them that is known.

    Both are averaged along the border. picture: as `lit` has it.
    """
    steps = np.arange(-inside, OUT_PX + 1.0)
    place = [at[:, axis, None] + steps * out[:, axis, None] for axis in (1, 0)]
    both = [map_coordinates(one, place, np.float64, order=1, prefilter=False) for one in picture]
    smoothed = smooth(np.concatenate(both, axis=1), ALONG_PX * len(at) / perimeter(at))
    known = smoothed[:, len(steps) :]
    return smoothed[:, : len(steps)] / np.maximum(known, 1e-3), known


class Flank(NamedTuple):
    """How a mirror falls away about n points of a border.

    place: (n, 33) px from the border, along which it is seen to grow flatter. light: (n, 33) what it reflects
    there.
    """

    place: Float
    light: Float

    @classmethod
    def of(cls, slope: float, radius: float, mm_per_px: Float, outward: Float, around: Around) -> Flank:
        """By the law, for a slope at the border of a contact of that radius, mm.

        mm_per_px: (n,) across the border. outward: (n, 2) unit vectors on the mirror.
        """
        lean = (around.ray[:, :2] * outward).sum(axis=1) / around.ray[:, 2]
        place = radius * (_AT - slope * lean[:, None] * _DROP) / mm_per_px[:, None]
        # what lies behind a flank is not seen
        place = np.maximum.accumulate(np.maximum(place, 0.0), axis=1)
        return cls(place, reflectances(slope * _FALL, outward, around))

    def likeliest(
        self, levels: Float, known: Float, blur: Float, own: float, noise: float, inside: int
    ) -> Float:
        """(n,) px, from `inside` inwards to 2 outwards, to where levels (n, positions) are likeliest.

        blur: weights of steps. own, noise: the object's level, and its variance.
        """
        px, fine = np.empty(len(levels)), np.empty((6, 2 * (2 * inside + 2 + OUT_PX) + 1))
        _likeliest(*self, levels, known, blur, own, noise, inside, fine, px)
        return px


@kernel(
    *4 * (read(numba.float64, 2),), read(numba.float64, 1), numba.float64, numba.float64, numba.int64,
    numba.float64[:, ::1], numba.float64[::1],
)  # fmt: skip
def _likeliest(
    place: Float,
    light: Float,
    levels: Float,
    known: Float,
    blur: Float,
    own: float,
    noise: float,
    inside: int,
    fine: Float,
    px: Float,
) -> None:
    """As `Flank.likeliest`. fine: room for levels every STEP_PX, from `inside` + 2 px inside on."""
    zero, steps, half = 2 * (inside + 2), fine.shape[1], len(blur) // 2
    sharp, doubt, mean, sharpness, log, total = fine[0], fine[1], fine[2], fine[3], fine[4], fine[5]
    for i in range(len(place)):
        g = 0
        for j in range(steps):
            at = STEP_PX * (j - zero)
            while place[i, g] < at and g < place.shape[1] - 1:
                g += 1
            beyond = light[i, g]
            if g > 0 and at < place[i, g]:
                part = (at - place[i, g - 1]) / (place[i, g] - place[i, g - 1])
                beyond = light[i, g - 1] + part * (beyond - light[i, g - 1])
            outside = 0.0 if j < zero else 0.5 if j == zero else 1.0
            sharp[j] = (1 - outside) * own + outside * beyond
            doubt[j] = outside * ((_LAW * beyond) ** 2 + (_PICTURE * beyond**4) ** 2)
        for j in range(steps):
            mean[j], variance = 0.0, noise
            for b in range(len(blur)):
                k = min(max(j + b - half, 0), steps - 1)
                mean[j] += blur[b] * sharp[k]
                variance += blur[b] * doubt[k]
            sharpness[j], log[j] = 1 / variance, math.log(variance)
        best = 0
        for way in range(zero + 1):
            total[way] = 0.0
            for t in range(levels.shape[1]):
                k = zero - way + 2 * t
                if known[i, t] > _LEAST_KNOWN:
                    total[way] -= 0.5 * ((levels[i, t] - mean[k]) ** 2 * sharpness[k] + log[k])
            if total[way] > total[best]:
                best = way
        px[i] = STEP_PX * best - inside
        if 0 < best < zero:
            bend = 2 * total[best] - total[best - 1] - total[best + 1]
            if bend > 0:
                px[i] += STEP_PX * 0.5 * (total[best + 1] - total[best - 1]) / bend
