"""Stacks of parallel slabs: a ray through them, and the ray that joins two points across them.

Along a ray through parallel slabs the vector p = n x (unit direction's part across the normal) does not
change (Snell). In a slab of index n and thickness t the ray shifts sideways by t p / sqrt(n^2 - p^2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.vectors import dot

_ITERATIONS = 100
"""Most Newton steps: grazing rays take many."""


def through_slabs(
    direction: Float, normal: Float, index: float, slabs: Sequence[tuple[float, float]], index_out: float
) -> tuple[Float, Float]:
    """Follow rays from index `index` through `slabs` into `index_out`.

    Parameters
    ----------
    direction : (..., 3) unit vectors of travel in front of the stack.
    normal : (3,) unit normal of all interfaces, along the travel.
    slabs : (index, thickness in mm) in the order met.

    Returns
    -------
    displacement : (..., 3) from entry into the first slab to exit from the last, in mm.
    direction : (..., 3) unit vectors of travel behind the stack.
    Both NaN where a slab or the medium behind totally reflects the ray, or it runs against `normal`.
    """
    along = dot(direction, normal)
    invariant = index * (direction - along[..., None] * normal)
    squared = np.where(along > 0.0, dot(invariant, invariant), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        sideways = sum((t / np.sqrt(n * n - squared) for n, t in slabs), np.zeros_like(squared))
        cosine = np.sqrt(index_out * index_out - squared)
    thickness = sum(t for _, t in slabs)
    displacement = sideways[..., None] * invariant + thickness * normal
    blocked = np.isnan(sideways + cosine)[..., None]
    out = (invariant + cosine[..., None] * normal) / index_out
    return np.where(blocked, np.nan, displacement), np.where(blocked, np.nan, out)


def direction_between(offset: Float, normal: Float, indices: Sequence[float], thicknesses_mm: Float) -> Float:
    """Direction, in the first slab, of the ray that joins two points across a stack of parallel slabs.

    Parameters
    ----------
    offset : (..., 3) second point minus first, in mm.
    normal : (3,) unit normal of all interfaces, from the first point to the second.
    indices : index of each slab, in the order met; the first point lies in the first slab.
    thicknesses_mm : (slabs, ...) thickness of each, adding up to `offset`'s part along `normal`.

    Returns
    -------
    (..., 3) unit vectors; NaN where a thickness is negative or no ray joins the points.

    Notes
    -----
    Solved for w = tan(angle in the slab of least index m): the sideways shift
    s(w) = sum t m w / sqrt(n^2 + (n^2 - m^2) w^2) rises and is concave, so Newton's steps from below the
    root rise to it without passing it and always converge, up to grazing rays.
    """
    along = dot(offset, normal)
    sideways = offset - along[..., None] * normal
    shift = np.sqrt(dot(sideways, sideways))
    least = min(indices)
    squares = [(n * n, n * n - least * least) for n in indices]
    with np.errstate(all="ignore"):
        t = np.where((thicknesses_mm >= 0.0).all(axis=0), thicknesses_mm, np.nan)
        w = shift / sum(least / n * ti for n, ti in zip(indices, t, strict=True))
        bound = sum(least / np.sqrt(b) * ti for (_, b), ti in zip(squares, t, strict=True) if b > 0.0)
        open_mm = sum(ti for (_, b), ti in zip(squares, t, strict=True) if b == 0.0)
        steep = (shift - bound) / open_mm
        w = np.where(steep > w, steep, w)
        for _ in range(_ITERATIONS):
            value, slope = np.zeros_like(w), np.zeros_like(w)
            for (a, b), ti in zip(squares, t, strict=True):
                root = 1.0 / np.sqrt(a + b * w * w)
                value += ti * root
                slope += ti * a * root**3
            step = (shift - least * w * value) / (least * slope)
            w = w + step
            unsettled = np.abs(step) > 1e-15 * (1.0 + w) * (1.0 + w)
            if not unsettled.any():
                break
        w = np.where(np.abs(step) > 1e-9 * (1.0 + w) * (1.0 + w), np.nan, w)
        first = indices[0]
        scale = 1.0 / (first * np.sqrt(1.0 + w * w))
        sine = least * w * scale
        cosine = np.sqrt(squares[0][0] + squares[0][1] * w * w) * scale
        heading = np.where(shift > 0.0, sine / shift, 0.0 * sine)
    result: Float = heading[..., None] * sideways + cosine[..., None] * normal
    return result
