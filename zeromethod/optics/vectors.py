"""Vector helpers of the ray model; the last axis is (x, y, z)."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float


def dot(a: Float, b: Float) -> Float:
    """Scalar product along the last axis: (..., 3), (..., 3) -> (...)."""
    product: Float = np.einsum("...i,...i->...", a, b)
    return product


def unit(vector: Float) -> Float:
    """Vector (..., 3) divided by its length."""
    length: Float = np.sqrt(dot(vector, vector))
    result: Float = vector / length[..., None]
    return result


def reflect(direction: Float, normal: Float) -> Float:
    """Direction (..., 3) after reflection at unit normals (..., 3) of either sense: d - 2 (d.n) n.

    Convention: directions point along the travel, before and after.
    """
    result: Float = direction - 2.0 * dot(direction, normal)[..., None] * normal
    return result


def rotation(axis: Float, angle_rad: float) -> Float:
    """(3, 3) right-handed rotation about a unit axis (Rodrigues' formula)."""
    cross: Float = np.cross(axis, np.eye(3)).T
    result: Float = np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * (cross @ cross)
    return result
