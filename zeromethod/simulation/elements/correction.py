"""What a body's other faces add to a half-space's answer, by what is left over on them.

A force on the mirror of a half-space would displace, and load, the places where the body has its faces. The
correction is the body's own deformation that takes this away: smooth on the mirror, for where the force
itself acts nothing is left over. Elements therefore need not resolve the force.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zeromethod.arrays import Float
from zeromethod.simulation.elements import half_space

if TYPE_CHECKING:
    from zeromethod.simulation.elements.elasticity import ElasticBody

_INSET = 1e-9
"""Share of the mirror by which points are moved off its ends, so that they lie in the mesh."""


def mirror_response(body: ElasticBody, forces_mm: Float, places_mm: Float) -> Float:
    """(places, forces) mm into the rubber at places (x, y) on the mirror, by a force of 1 N at other places.

    forces_mm: (2, forces), places_mm: (2, places); none on the mirror's borders.
    """
    reach = np.abs(places_mm[1])
    out = np.zeros((places_mm.shape[1], forces_mm.shape[1]))
    at = _trace(body, places_mm[0], reach)
    for even in (True, False):
        displaced = body.solve(*_left_over(body, forces_mm, even=even), even=even)[1]
        half = at @ displaced.reshape(-1, displaced.shape[-1])
        out += half if even else np.sign(places_mm[1])[:, None] * half
    return out


def _trace(body: ElasticBody, x: Float, y: Float) -> Float:
    """(places, section x line) values at places of the mirror of fields given at nodes."""
    low, high = body.section.mirror_mm
    inside = np.clip(x, low + _INSET * (high - low), high - _INSET * (high - low))
    on_mirror = np.stack((inside, np.full_like(inside, _INSET * (high - low))))
    plane = body.plane.probes(on_mirror).toarray()
    along = body.along.probes(np.clip(y, 0.0, body.nodes[2].max() * (1 - _INSET))[None, :]).toarray()
    return np.asarray((plane[:, :, None] * along[:, None, :]).reshape(len(x), -1))


def _left_over(body: ElasticBody, forces_mm: Float, *, even: bool) -> tuple[Float, Float]:
    """(displacements to give, loads) that take a half-space's off the faces; each (3, section, line, n)."""
    x, w, y = body.nodes
    shape = 3, len(x), len(y), forces_mm.shape[1]
    given, load = np.zeros(shape), np.zeros(shape)
    for face in body.section.faces:
        on = body.on(face)
        moved, stress = _parts(body, x[on], w[on], y, forces_mm, even=even)
        if face.support != "free":
            given[:, on] = -moved
        if face.support != "bonded":
            pulled = stress[0] * face.normal[0] + stress[1] * face.normal[1]
            whole = np.zeros(shape)
            whole[:, on] = -pulled
            load += body.face_load(face, whole)
    moved, stress = _parts(body, x, w, y[[body.end]], forces_mm, even=even)
    if body.ends != "free":
        given[:, :, body.end] = -moved[:, :, 0]
    if body.ends != "bonded":
        load += body.end_load(-stress[2][:, :, 0])
    return given, load


def _parts(
    body: ElasticBody, x: Float, w: Float, y: Float, forces_mm: Float, *, even: bool
) -> tuple[Float, Float]:
    """Even or odd part of a half-space's displacement (3, section, line, n) and stress (3, 3, ...)."""
    moved: Float | float = 0.0
    stress: Float | float = 0.0
    order = [0, 2, 1]  # components of the half-space are x, y, into it
    for side in (1.0, -1.0):
        at = x[:, None, None] - forces_mm[0], side * y[None, :, None] - forces_mm[1], w[:, None, None]
        dx, dy, down = np.broadcast_arrays(*at)
        flip = np.array([1.0, 1.0, side])
        sign = 0.5 if even or side > 0 else -0.5
        pushed = half_space.displacement(dx, dy, down, body.shear_mpa, body.poisson)[order]
        moved = moved + sign * flip[:, None, None, None] * pushed
        turned = half_space.stress(dx, dy, down, body.poisson)[np.ix_(order, order)]
        stress = stress + sign * np.multiply.outer(flip, flip)[..., None, None, None] * turned
    return np.asarray(moved), np.asarray(stress)
