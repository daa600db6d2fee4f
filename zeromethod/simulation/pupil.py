"""The camera's pupil: a pixel sees the mirror not at a point but over the pupil's footprint.

The camera is focused on the LCD's image, so that all rays of a pixel end at one LCD position while the mirror
is at rest. Its other rays meet the mirror where other pixels' middle rays do: what they see is read off the
ray map, shifted by the footprint, in camera px.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from zeromethod.arrays import Float
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig

SAMPLES = 24
"""Points of the pupil, evenly over its area."""
_STEP_MM = 1.0
_LATTICE = 7


def spiral() -> Float:
    """(SAMPLES, 2) points of the unit disc on Vogel's spiral."""
    k = np.arange(SAMPLES)
    radius, angle = np.sqrt((k + 0.5) / SAMPLES), k * np.pi * (3 - np.sqrt(5))
    return np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1)


def shift_terms(rig: Rig) -> Float:
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
    terms = np.stack((np.ones_like(s), s, t, s * s, s * t, t * t), axis=-1).reshape(-1, 6)
    flat = shift.reshape(-1, 4)
    known = np.isfinite(flat).all(axis=-1)
    found = np.linalg.lstsq(terms[known], flat[known], rcond=None)[0]
    return np.asarray(found.reshape(6, 2, 2))


def _jacobians(optics: Optics, u: Float, v: Float) -> tuple[Float, Float, Float, Float]:
    """(q, mirror point, their derivatives (.., 2, 2) and (.., 3, 2) by (u, v)) of camera pixels."""
    here = optics.trace(u, v, optics.rest)
    rest = optics.rest
    steps = [((u + du, v + dv), (u - du, v - dv)) for du, dv in ((1, 0), (0, 1))]
    sides = [(optics.trace(*after, rest), optics.trace(*before, rest)) for after, before in steps]
    q_by = np.stack([(a.q - b.q) / 2 for a, b in sides], axis=-1)
    at_by = np.stack([(a.point - b.point) / 2 for a, b in sides], axis=-1)
    return here.q, here.point, q_by, at_by


class Pupil:
    """Means over the pupil of what single rays see."""

    def __init__(self, rig: Rig) -> None:
        """Raises InputError where the rig's rest surface cannot be used."""
        terms = shift_terms(rig)
        rows, cols = rig.camera.rows, rig.camera.columns
        self._v, self._u = np.mgrid[0:rows, 0:cols].astype(np.float64)
        s, t = 2 * self._u / (cols - 1) - 1, 2 * self._v / (rows - 1) - 1
        self._shift = np.einsum(
            "krc,kij->rcij", np.stack((np.ones_like(s), s, t, s * s, s * t, t * t)), terms
        )
        self._unit = 1 / (rig.camera.psf_px**2 + 1 / 12)

    @classmethod
    def of(cls, rig: Rig) -> Pupil | None:
        """The rig's pupil; None where it is a point."""
        return cls(rig) if rig.camera.pupil_mm > 0 else None

    def mean(self, q: Float, gain: Float, q_rest: Float) -> tuple[Float, Float, Float]:
        """(q, gain, spread as `Beam.of` takes it), weighted by the light of each ray; NaN q where none comes.

        q, gain: of single rays. q_rest: of single rays at rest.
        """
        bent = q - q_rest
        lit = np.where(np.isnan(bent[..., 0]) | np.isnan(gain), 0.0, gain)
        bent = np.where(lit[..., None] > 0, bent, 0.0)
        total, first, second = np.zeros(lit.shape), np.zeros(bent.shape), np.zeros((*lit.shape, 3))
        for x, y in spiral():
            share = self._shifted(lit, x, y)
            off = np.stack([self._shifted(lit * bent[..., k], x, y) for k in (0, 1)], axis=-1)
            with np.errstate(invalid="ignore", divide="ignore"):
                off = np.where(share[..., None] > 0, off / share[..., None], 0.0)
            total += share
            first += share[..., None] * off
            squares = (off[..., 0] ** 2, off[..., 0] * off[..., 1], off[..., 1] ** 2)
            second += share[..., None] * np.stack(squares, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            middle = first / total[..., None]
            spread = second / total[..., None] - np.stack(
                (middle[..., 0] ** 2, middle[..., 0] * middle[..., 1], middle[..., 1] ** 2), axis=-1
            )
        spread[..., (0, 2)] = np.maximum(spread[..., (0, 2)], 0.0)
        return q_rest + middle, total / SAMPLES, np.nan_to_num(self._unit * spread)

    def mean_light(self, light: Float) -> Float:
        """Mean of light (rows, cols)."""
        return np.asarray(np.mean([self._shifted(light, x, y) for x, y in spiral()], axis=0))

    def _shifted(self, values: Float, x: float, y: float) -> Float:
        """Values, bilinear, where rays through the point (x, y) of the pupil meet the mirror."""
        u = self._u + self._shift[..., 0, 0] * x + self._shift[..., 0, 1] * y
        v = self._v + self._shift[..., 1, 0] * x + self._shift[..., 1, 1] * y
        return np.asarray(map_coordinates(values, (v, u), order=1, mode="nearest"))
