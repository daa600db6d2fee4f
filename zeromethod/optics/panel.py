"""The LCD panel: its plane and pixel lattice in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics.prism import Face
from zeromethod.optics.vectors import dot, rotation
from zeromethod.rig.model import DisplaySpec


@dataclass(frozen=True)
class Panel:
    """The LCD's plane and pixel lattice.

    Convention: q = (column, row) in LCD px, centres at integers; `column` and `row` are the unit vectors
    (3,) along which they grow, `normal` (3,) points away from the prism. `centre` (3,) in mm is the middle
    of the pixel area, q = ((columns - 1) / 2, (rows - 1) / 2). `field` (3,) is the direction of the emitted
    light's electric field in the panel's plane, None where unpolarised.
    """

    centre: Float
    column: Float
    row: Float
    normal: Float
    field: Float | None
    pitch_mm: float
    columns: int
    rows: int

    @classmethod
    def place(cls, spec: DisplaySpec, face: Face, stack_mm: float) -> Panel:
        """Panel of a rig: parallel to `face`, `stack_mm` beyond it, then tilted about its centre.

        Convention: untilted and unturned, columns grow along the face away from P0 and rows with y;
        `mirrored` flips the columns, then `turn_deg` turns columns towards rows; tilt is
        R_y(tilt[1]) @ R_along(tilt[0]), right-handed. The field lies at `polarisation_deg` to y, turning
        towards the face's along direction (tilted with the panel, not turned).
        """
        tilt_along, tilt_y = np.radians(spec.tilt_deg)
        y = np.array([0.0, 1.0, 0.0])
        tilt = rotation(y, float(tilt_y)) @ rotation(face.along, float(tilt_along))
        first = -face.along if spec.mirrored else face.along
        turn = np.radians(spec.turn_deg)
        column = np.cos(turn) * first + np.sin(turn) * y
        row = -np.sin(turn) * first + np.cos(turn) * y
        field = None
        if spec.polarisation_deg is not None:
            angle = np.radians(spec.polarisation_deg)
            field = tilt @ (np.cos(angle) * y + np.sin(angle) * face.along)
        centre = face.edge + spec.centre_mm[0] * face.along + spec.centre_mm[1] * y + stack_mm * face.normal
        return cls(
            centre=centre,
            column=tilt @ column,
            row=tilt @ row,
            normal=tilt @ face.normal,
            field=field,
            pitch_mm=spec.pitch_mm,
            columns=spec.columns,
            rows=spec.rows,
        )

    @property
    def _middle(self) -> tuple[float, float]:
        return (self.columns - 1) / 2, (self.rows - 1) / 2

    def lcd_to_world(self, q: Float) -> Float:
        """World points (..., 3) in mm of LCD positions (..., 2) in px."""
        column, row = ((q[..., i, None] - self._middle[i]) * self.pitch_mm for i in (0, 1))
        result: Float = self.centre + column * self.column + row * self.row
        return result

    def world_to_lcd(self, point: Float) -> Float:
        """LCD positions (..., 2) in px of world points (..., 3); their distance to the panel is ignored."""
        offset = (point - self.centre) / self.pitch_mm
        column, row = dot(offset, self.column), dot(offset, self.row)
        return np.stack([column + self._middle[0], row + self._middle[1]], axis=-1)

    def contains(self, q: Float) -> Mask:
        """Whether LCD positions (..., 2) lie on a pixel (half a pixel beyond the outer centres)."""
        column, row = q[..., 0], q[..., 1]
        inside = (column >= -0.5) & (column <= self.columns - 0.5)
        return np.asarray(inside & (row >= -0.5) & (row <= self.rows - 0.5))
