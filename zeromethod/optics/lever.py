"""The optical lever: LCD shift per slope of the mirror, in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.mirror import normal_of
from zeromethod.optics.panel import Panel
from zeromethod.optics.prism import Face
from zeromethod.optics.vectors import dot, reflect


def lcd_per_slope(
    point: Float,
    incoming: Float,
    gradient: tuple[Float, Float],
    face: Face,
    panel: Panel,
    slabs: Sequence[tuple[float, float]],
    last_index: float,
) -> Float:
    """Derivative of the LCD position by the depth's slope (dd/dx, dd/dy): (..., 2, 2), LCD px per rad.

    Parameters
    ----------
    point, incoming : (..., 3) mirror point in mm and unit ray in the rubber towards it.
    gradient : (dz/dx, dz/dy) of the surface at the point.
    slabs : (index, thickness in mm) from the rubber outwards, without the last; the first is the rubber,
        whose thickness is taken from the point instead.
    last_index : index of the slab that ends at the panel.

    Convention: slope is of depth, so the surface's gradient moves against it. The last axis of the result
    is the slope's (x, y), the one before it q's (column, row).
    """
    normal = normal_of(gradient)
    outgoing = reflect(incoming, normal)
    index = slabs[0][0]
    thicknesses = [face.depth_below(point), *(np.asarray(t) for _, t in slabs[1:])]

    along = dot(outgoing, face.normal)
    invariant = index * (outgoing - along[..., None] * face.normal)
    squared = dot(invariant, invariant)
    cosines = [np.sqrt(n * n - squared) for n, _ in slabs]
    per_invariant = sum(t / c for t, c in zip(thicknesses, cosines, strict=True))
    steepening = sum(t / c**3 for t, c in zip(thicknesses, cosines, strict=True))
    height = sum(thicknesses, np.zeros_like(squared))
    start = point + np.asarray(per_invariant)[..., None] * invariant + height[..., None] * face.normal
    cos_last = np.sqrt(last_index * last_index - squared)
    ray = invariant + cos_last[..., None] * face.normal
    reach = dot(panel.centre - start, panel.normal) / dot(ray, panel.normal)

    nz = normal[..., 2]
    columns = []
    for axis in (0, 1):
        raw = np.zeros(3)
        raw[axis] = 1.0  # the depth's slope tilts (-dz/dx, -dz/dy, 1) by (1, 0, 0) or (0, 1, 0)
        turn = nz[..., None] * (raw - normal[..., axis, None] * normal)
        bent = -2.0 * (dot(incoming, turn)[..., None] * normal + dot(incoming, normal)[..., None] * turn)
        moved = index * (bent - dot(bent, face.normal)[..., None] * face.normal)
        inner = dot(invariant, moved)
        start_moved = np.asarray(per_invariant)[..., None] * moved
        start_moved = start_moved + (np.asarray(steepening) * inner)[..., None] * invariant
        ray_moved = moved - (inner / cos_last)[..., None] * face.normal
        reach_moved = -(dot(start_moved, panel.normal) + reach * dot(ray_moved, panel.normal))
        reach_moved = reach_moved / dot(ray, panel.normal)
        end = start_moved + reach_moved[..., None] * ray + reach[..., None] * ray_moved
        columns.append(np.stack([dot(end, panel.column), dot(end, panel.row)], axis=-1) / panel.pitch_mm)
    return np.stack(columns, axis=-1)
