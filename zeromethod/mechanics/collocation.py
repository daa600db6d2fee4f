"""What a body's other faces add to a half-space's answer, by forces outside it that mend its faces.

A load on the mirror of a half-space leaves the places of the body's faces displaced and stressed. Forces
outside the body, whose fields inside it are exact, take away in least squares what the faces' supports do not
allow. There are no elements: with those of the simulated bench it shares nothing.
Source: Fairweather & Karageorghis 1998, Advances in Computational Mathematics 9, 69,
doi:10.1023/A:1018981221740.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import lstsq

from zeromethod.arrays import Float
from zeromethod.mechanics import kelvin
from zeromethod.mechanics.boussinesq import HalfSpaceForce
from zeromethod.mechanics.faces import FacePoints

_FLIP = np.array([1.0, -1.0, 1.0])
"""Of the components of a vector in its image beyond y = 0."""

_LENGTH_MM = 3.0
"""A displacement counts as the stress that it makes over so much rubber."""

_RANK = 1e-11
"""Singular values below this share of the largest are left out."""


def mirror_response(
    faces: Sequence[FacePoints], poisson: float, forces_mm: Float, places_mm: Float
) -> tuple[Float, float]:
    """(places, forces) mm into the rubber that the body adds under 1 N, E = 1 MPa; and what is left on faces.

    forces_mm: (2, forces), places_mm: (2, places), x and y on the mirror. What is left: root mean square of
    what supports do not allow, relative to the half-space's.
    """
    shear = 1 / (2 * (1 + poisson))
    outside = np.concatenate([face.outside for face in faces], axis=1)
    at = np.stack((places_mm[0], places_mm[1], np.zeros(places_mm.shape[1])))
    added = np.zeros((places_mm.shape[1], forces_mm.shape[1]))
    left2 = whole2 = 0.0
    for sign in (1.0, -1.0):
        matrix = np.concatenate([_by_outer(face, outside, sign, shear, poisson) for face in faces])
        wrong = np.concatenate([_by_loads(face, forces_mm, sign, shear, poisson) for face in faces])
        found = lstsq(matrix, -wrong, cond=_RANK, lapack_driver="gelsy", check_finite=False)[0]
        left2 += float(((matrix @ found + wrong) ** 2).sum())
        whole2 += float((wrong**2).sum())
        into = _both(at, outside, sign, lambda apart: kelvin.displacement(apart, shear, poisson)[2:])[0]
        added += np.moveaxis(into, 0, 2).reshape(len(at[0]), -1) @ found
    return added, float(np.sqrt(left2 / whole2))


def _both(at: Float, outside: Float, sign: float, field: Callable[[Float], Float]) -> Float:
    """(components, 3, places, outside) of a field (components, 3, ...), those of the forces' images added."""
    image = _FLIP[:, None] * outside
    of_image = field(at[:, :, None] - image[:, None, :]) * _FLIP[:, None, None]
    return np.asarray(field(at[:, :, None] - outside[:, None, :]) + sign * of_image)


def _by_outer(face: FacePoints, outside: Float, sign: float, shear: float, poisson: float) -> Float:
    """(conditions, 3 outside) of the forces outside."""
    normal = face.normal[:, None, None]
    moved = _both(face.at, outside, sign, lambda apart: kelvin.displacement(apart, shear, poisson))
    pulled = _both(face.at, outside, sign, lambda apart: kelvin.traction(apart, normal, poisson))
    found = _conditions(face, moved, pulled, shear)
    return np.moveaxis(found, 1, 2).reshape(-1, 3 * outside.shape[1])


def _by_loads(face: FacePoints, forces_mm: Float, sign: float, shear: float, poisson: float) -> Float:
    """(conditions, forces) of the even or odd part of loads on a half-space."""
    space = HalfSpaceForce(shear, poisson)
    moved, pulled = np.zeros((2, 3, face.at.shape[1], forces_mm.shape[1]))
    for side in (1.0, -1.0):
        share = 0.5 if side > 0 else 0.5 * sign
        x, y, w = np.broadcast_arrays(
            face.at[0][:, None] - forces_mm[0], face.at[1][:, None] - side * forces_mm[1], face.at[2][:, None]
        )
        moved += share * space.displacement(x, y, w)
        pulled += share * np.einsum("ijpf,j->ipf", space.stress(x, y, w), face.normal)
    return _conditions(face, moved[:, None], pulled[:, None], shear).reshape(-1, forces_mm.shape[1])


def _conditions(face: FacePoints, moved: Float, pulled: Float, shear: float) -> Float:
    """(3 places, components, n) of what must be 0, weighted.

    moved, pulled: displacement and traction (3, components, places, n).
    """
    moved = moved * (shear / _LENGTH_MM)
    if face.support == "bonded":
        whole = moved
    elif face.support == "free":
        whole = pulled
    else:
        other = np.array([0.0, 1.0, 0.0]) if abs(face.normal[1]) < 0.5 else np.array([1.0, 0.0, 0.0])
        third = np.cross(face.normal, other)
        whole = np.stack(
            [np.tensordot(face.normal, moved, 1), *(np.tensordot(t, pulled, 1) for t in (other, third))]
        )
    whole = whole * np.sqrt(face.area)[:, None]
    return np.concatenate([np.moveaxis(each, -2, 0) for each in whole])
