"""Levels across a contact's border beside which rubber falls away steeply: seen, and as they should be."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.contact.likelihood import UNKNOWN
from zeromethod.contact.polygon import compiled_perimeter, compiled_smooth

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


@numba.njit(cache=True, nogil=True)
def reflectances(slope: float, outward: Float, ray: Float, rest: Float, share: Float, index: float) -> Float:
    """(n,) reflectance of a mirror that falls away outwards by a slope."""
    result = np.empty(len(ray))
    for i in range(len(ray)):
        result[i] = reflectance(slope, outward[i], ray[i], rest[i], share[i], index)
    return result


@numba.njit(cache=True, nogil=True)
def reflectance(slope: float, outward: Float, ray: Float, rest: Float, share: float, index: float) -> float:
    """Reflectance of a mirror that falls away outwards by a slope, as `optics.fresnel` has it."""
    zx, zy = rest[0] + slope * outward[0], rest[1] + slope * outward[1]
    cosine = (ray[2] - zx * ray[0] - zy * ray[1]) / math.sqrt(1 + zx * zx + zy * zy)
    if cosine <= 0:
        return 0.0
    passes = math.sqrt(max(1 - index * index * (1 - cosine * cosine), 0.0))
    s = (index * cosine - passes) / (index * cosine + passes)
    p = (cosine - index * passes) / (cosine + index * passes)
    return float(share * s * s + (1 - share) * p * p)


@numba.njit(cache=True, nogil=True)
def across(at: Float, out: Float, columns: Bytes, light_of: Single, inside: int) -> tuple[Float, Float]:
    """(n, positions) levels across a border, from `inside` px inside on, and the share of them that is known.

    Both are averaged along the border.
    """
    rows, cols = columns.shape
    n, positions = len(at), inside + OUT_PX + 1
    both = np.zeros((n, 2 * positions))
    for i in range(n):
        for t in range(positions):
            u, v = at[i, 0] + (t - inside) * out[i, 0], at[i, 1] + (t - inside) * out[i, 1]
            if not (0 <= u < cols - 1 and 0 <= v < rows - 1):
                continue
            col, row = int(u), int(v)
            for b in range(2):
                for a in range(2):
                    weight = (u - col if a else 1 - u + col) * (v - row if b else 1 - v + row)
                    column = columns[row + b, col + a]
                    if column != UNKNOWN:
                        both[i, t] += weight * light_of[column]
                        both[i, positions + t] += weight
    smoothed = compiled_smooth(both, ALONG_PX * n / compiled_perimeter(at))
    known = smoothed[:, positions:].copy()
    return smoothed[:, :positions] / np.maximum(known, 1e-3), known


@numba.njit(cache=True, nogil=True)
def profile(
    slope: float,
    radius: float,
    mm_per_px: float,
    outward: Float,
    ray: Float,
    rest: Float,
    share: float,
    index: float,
    own: float,
    noise: float,
    blur: Float,
    inside: int,
) -> tuple[Float, Float, Float]:
    """(level, 1 / variance, its log) across a border, every STEP_PX from `inside` + 2 px inside on."""
    zero = 2 * (inside + 2)
    fine = zero + 2 * (OUT_PX + inside) + 1
    lean = (ray[0] * outward[0] + ray[1] * outward[1]) / ray[2]
    sharp, doubt = np.empty(fine), np.empty(fine)
    g, here, light = 0, 0.0, reflectance(slope, outward, ray, rest, share, index)
    after, light_after = here, light
    for j in range(fine):
        at = STEP_PX * (j - zero)
        while after < at and g < len(_AT) - 1:
            here, light = after, light_after
            g += 1
            after = max(here, radius * (_AT[g] - slope * lean * _DROP[g]) / mm_per_px)
            light_after = reflectance(slope * _FALL[g], outward, ray, rest, share, index)
        beyond = light_after
        if here < after and at < after:
            beyond = light + (at - here) / (after - here) * (light_after - light)
        outside = 0.0 if j < zero else 0.5 if j == zero else 1.0
        sharp[j] = (1 - outside) * own + outside * beyond
        doubt[j] = outside * ((_LAW * beyond) ** 2 + (_PICTURE * beyond**4) ** 2)
    half = len(blur) // 2
    mean, sharpness, log = np.zeros(fine), np.empty(fine), np.empty(fine)
    for j in range(fine):
        variance = noise
        for b in range(len(blur)):
            k = min(max(j + b - half, 0), fine - 1)
            mean[j] += blur[b] * sharp[k]
            variance += blur[b] * doubt[k]
        sharpness[j], log[j] = 1 / variance, math.log(variance)
    return mean, sharpness, log


@numba.njit(cache=True, nogil=True)
def likeliest(levels: Float, known: Float, mean: Float, sharpness: Float, log: Float, inside: int) -> float:
    """Px, from `inside` inwards to 2 outwards, to where a border's levels are likeliest."""
    ways = 2 * (inside + 2) + 1
    best, at, before, after = -np.inf, 0, 0.0, 0.0
    totals = np.zeros(ways)
    for w in range(ways):
        first = 2 * (inside + 2) - w
        for t in range(len(levels)):
            if known[t] > _LEAST_KNOWN:
                off = levels[t] - mean[first + 2 * t]
                totals[w] -= 0.5 * (off * off * sharpness[first + 2 * t] + log[first + 2 * t])
        if totals[w] > best:
            best, at = totals[w], w
    part = 0.0
    if 0 < at < ways - 1:
        before, after = totals[at - 1], totals[at + 1]
        bend = 2 * best - before - after
        part = 0.5 * (after - before) / bend if bend > 0 else 0.0
    return STEP_PX * (at + part) - inside
