"""The footprint of the camera's pupil on the mirror, in camera pixels.

The camera is focused on the LCD's image, so that all rays of a pixel end at one LCD position while the mirror
is at rest. Its other rays meet the mirror where other pixels' middle rays do.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.bench import Optics
from zeromethod.rig.model import Rig

_STEP_MM = 1.0
"""Displacement of the camera by which the rays of other points of the pupil are found."""
_LATTICE = 7
"""Places along each side of the view to which the terms are fitted."""


def footprint_terms(rig: Rig) -> Float:
    """(6, 2, 2): terms 1, s, t, s^2, s t, t^2 of the shift, camera px, by half the pupil's diameter.

    s, t: place in the image, -1 to 1 along u and v. [.., i, j]: shift along u or v (i) for a point at the
    pupil's border along u or v (j).
    """
    camera = rig.camera
    side = np.linspace(-1, 1, _LATTICE)
    s, t = np.meshgrid(side, side)
    u, v = 0.5 * (s + 1) * (camera.columns - 1), 0.5 * (t + 1) * (camera.rows - 1)
    position, aim = np.array(camera.position_mm), np.array(camera.look_at_mm)
    axis = (aim - position) / np.linalg.norm(aim - position)
    v_axis = np.array([0.0, 1.0, 0.0]) - axis[1] * axis
    v_axis /= np.linalg.norm(v_axis)
    q, at, q_by, at_by = _jacobians(Optics(rig), u, v)
    columns = []
    for way in (np.cross(v_axis, axis), v_axis):
        off = _STEP_MM * way
        place = {"position_mm": tuple(position + off), "look_at_mm": tuple(aim + off)}
        optics = Optics(rig.model_copy(update={"camera": camera.model_copy(update=place)}))
        moved = optics.trace(u, v, optics.rest)
        # the moved camera's pixel that looks at the same LCD position, then the pixel whose ray is met there
        turned = np.linalg.solve(q_by, -(moved.q - q)[..., None])
        reached = (moved.point - at)[..., None] + at_by @ turned
        # least squares: both differences lie in the mirror
        back = np.swapaxes(at_by, -1, -2)
        columns.append(np.linalg.solve(back @ at_by, back @ reached))
    shift = np.concatenate(columns, axis=-1) * (0.5 * camera.pupil_mm / _STEP_MM)
    terms = quadratic_terms(s, t).reshape(-1, 6)
    flat = shift.reshape(-1, 4)
    known = np.isfinite(flat).all(axis=-1)
    found = np.linalg.lstsq(terms[known], flat[known], rcond=None)[0]
    return np.asarray(found.reshape(6, 2, 2))


def quadratic_terms(s: Float, t: Float) -> Float:
    """(..., 6): the terms of `footprint_terms` at places s, t (...)."""
    return np.stack((np.ones_like(s), s, t, s * s, s * t, t * t), axis=-1)


def _jacobians(optics: Optics, u: Float, v: Float) -> tuple[Float, Float, Float, Float]:
    """(q, mirror point, their derivatives (.., 2, 2) and (.., 3, 2) by (u, v)) of camera pixels."""
    here = optics.trace(u, v, optics.rest)
    rest = optics.rest
    steps = [((u + du, v + dv), (u - du, v - dv)) for du, dv in ((1, 0), (0, 1))]
    sides = [(optics.trace(*after, rest), optics.trace(*before, rest)) for after, before in steps]
    q_by = np.stack([(a.q - b.q) / 2 for a, b in sides], axis=-1)
    at_by = np.stack([(a.point - b.point) / 2 for a, b in sides], axis=-1)
    return here.q, here.point, q_by, at_by
