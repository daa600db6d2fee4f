"""How a curved mirror at rest falls away from an object: what of it the object meets."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from zeromethod.errors import InputError
from zeromethod.optics.mirror import HeightField, height_field
from zeromethod.rig.prism_tables import RestSurface
from zeromethod.simulation.contact.objects import Held

_STEP_MM = 0.5
_DECIMALS = 5
"""Of a map's curvatures, 1/mm, which are rounded so that an object that slides is seldom solved again."""


@lru_cache(4)
def _heights(rest: RestSurface) -> HeightField:
    """Read once, not at every place of an object that slides."""
    return height_field(rest)


def bow_of(rest: RestSurface, x_mm: float, y_mm: float) -> tuple[float, float, float]:
    """Second derivatives (xx, xy, yy), 1/mm, of how far the mirror lies below its tangent plane at a point.

    Objects press along its normal there. Raises InputError where a map of heights cannot be read.
    """
    if rest.shape == "map":
        way = _STEP_MM * np.array([1.0, -1.0, 0.0, 0.0])
        zx, zy = _heights(rest).gradient(x_mm + way, y_mm + way[::-1])
        found = -np.array([zx[0] - zx[1], zx[3] - zx[2], zy[3] - zy[2]]) / (2 * _STEP_MM)
        xx, xy, yy = np.round(found, _DECIMALS).tolist()
        return xx, xy, yy
    if rest.radius_mm is None:
        return 0.0, 0.0, 0.0
    if rest.shape == "sphere":
        return 1.0 / rest.radius_mm, 0.0, 1.0 / rest.radius_mm
    turn = np.radians(rest.axis_deg)
    s, c = float(np.sin(turn)), float(np.cos(turn))
    return s * s / rest.radius_mm, -s * c / rest.radius_mm, c * c / rest.radius_mm


def on_rest(held: Held, rest: RestSurface) -> Held:
    """The object in front of the mirror as it is curved there. Raises InputError for one that sticks."""
    if rest.shape == "flat":
        return held
    if held.solid.adhesion_j_m2:
        raise InputError(
            f"object[{held.number}].adhesion_j_m2: {held.solid.adhesion_j_m2:g}: 0 on a curved mirror "
            "(a sticking ball is solved on a flat one)"
        )
    return replace(held, bow=bow_of(rest, held.x_mm, held.y_mm))
