"""Reflectance of an interface: Fresnel's equations and total internal reflection."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.vectors import dot


def critical_angle_rad(n1: float, n2: float = 1.0) -> float:
    """Smallest angle of incidence in index `n1` at which `n2` reflects all light; pi/2 where none does."""
    return float(np.arcsin(min(1.0, n2 / n1)))


def fresnel(cos_incidence: Float, n1: float, n2: float) -> tuple[Float, Float]:
    """Power reflectances (Rs, Rp) of light that travels in `n1` and meets `n2`.

    cos_incidence: (...) cosine of the angle between ray and normal, 0 to 1. s: field perpendicular to
    the plane of incidence, p: in it. Both are 1 at and beyond the critical angle. Source: Born and Wolf,
    Principles of Optics, section 1.5.2.
    """
    cosine = np.asarray(cos_incidence, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        transmitted = np.sqrt(np.maximum(0.0, 1.0 - (n1 / n2) ** 2 * (1.0 - cosine**2)))
        s = ((n1 * cosine - n2 * transmitted) / (n1 * cosine + n2 * transmitted)) ** 2
        p = ((n2 * cosine - n1 * transmitted) / (n2 * cosine + n1 * transmitted)) ** 2
    total = transmitted == 0.0
    return np.where(total, 1.0, s), np.where(total, 1.0, p)


def s_share(travel: Float, normal: Float, field: Float) -> Float:
    """Share (...) of a linearly polarised wave's power that is s-polarised at an interface.

    travel, normal: (..., 3) unit vectors. field: (3,) or (..., 3) direction of the electric field; only
    its part across `travel` counts. At normal incidence, where s and p are one, the share is 1/2.
    """
    across = field - dot(field, travel)[..., None] * travel
    s_axis = np.cross(travel, normal)
    size = dot(s_axis, s_axis) * dot(across, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = dot(across, s_axis) ** 2 / size
    return np.where(size == 0.0, 0.5, share)
