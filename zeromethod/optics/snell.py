"""Refraction and reflection of rays in vector form: exact, no small angles."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.vectors import dot


def refract(direction: Float, normal: Float, n1: float, n2: float) -> Float:
    """Direction behind an interface, by Snell's law: n1 sin(t1) = n2 sin(t2).

    Parameters
    ----------
    direction : (..., 3) unit vectors of travel in index `n1`.
    normal : (..., 3) unit normals of the interface, either sense.

    Returns
    -------
    (..., 3) unit vectors of travel in index `n2`; NaN where totally reflected.

    Convention: directions point along the travel.
    """
    along = dot(direction, normal)
    tangential = (n1 / n2) * (direction - along[..., None] * normal)
    with np.errstate(invalid="ignore"):
        cosine = np.copysign(np.sqrt(1.0 - dot(tangential, tangential)), along)
    result: Float = tangential + cosine[..., None] * normal
    return result


def reflect(direction: Float, normal: Float) -> Float:
    """Direction (..., 3) after reflection at unit normals (..., 3) of either sense: d - 2 (d.n) n.

    Convention: directions point along the travel, before and after.
    """
    result: Float = direction - 2.0 * dot(direction, normal)[..., None] * normal
    return result
