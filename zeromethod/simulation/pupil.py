"""The camera's pupil: a pixel sees the mirror not at a point but over the pupil's footprint.

The camera is focused on the LCD's image, so that all rays of a pixel end at one LCD position while the mirror
is at rest. Its other rays meet the mirror where other pixels' middle rays do: what they see is read off the
ray map, shifted by the footprint, in camera px.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from zeromethod.arrays import Float
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.rig.model import Rig

RINGS, ON_RING = 3, 8
SAMPLES = RINGS * ON_RING
"""Points of the pupil: on rings of equal area, every other one turned by half a step.

Their moments to the third are the disc's, so that a dent is seen neither moved nor too wide. (A spiral of as
many is off the middle by a fiftieth of the radius: 12 nm of a pad of 50 um.)
"""


def points() -> Float:
    """(SAMPLES, 2) points of the unit disc."""
    ring, on_ring = np.divmod(np.arange(SAMPLES), ON_RING)
    radius, angle = np.sqrt((ring + 0.5) / RINGS), (on_ring + 0.5 * (ring % 2)) * (2 * np.pi / ON_RING)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1)


class Pupil:
    """Means over the pupil of what single rays see."""

    def __init__(self, rig: Rig) -> None:
        """Raises InputError where the rig's rest surface cannot be used."""
        terms = footprint_terms(rig)
        rows, cols = rig.camera.rows, rig.camera.columns
        self._v, self._u = np.mgrid[0:rows, 0:cols].astype(np.float64)
        s, t = 2 * self._u / (cols - 1) - 1, 2 * self._v / (rows - 1) - 1
        self._shift = np.einsum("rck,kij->rcij", quadratic_terms(s, t), terms)
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
        for x, y in points():
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
        return np.asarray(np.mean([self._shifted(light, x, y) for x, y in points()], axis=0))

    def _shifted(self, values: Float, x: float, y: float) -> Float:
        """Values, bilinear, where rays through the point (x, y) of the pupil meet the mirror."""
        u = self._u + self._shift[..., 0, 0] * x + self._shift[..., 0, 1] * y
        v = self._v + self._shift[..., 1, 0] * x + self._shift[..., 1, 1] * y
        return np.asarray(map_coordinates(values, (v, u), order=1, mode="nearest"))
