"""The paper's reading of a press (section 5): columns of picked crossings in, depth along the mirror out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics import Optics
from zeromethod.paper.series import Series, reconstruct
from zeromethod.rig.model import Rig

PITCH_MM = 2.5
"""Distance of the lattice's lines (section 5)."""


@dataclass(frozen=True, slots=True)
class LatticeView:
    """Where the lattice lies in the image of the mirror at rest, and what a pixel means.

    period_px: px between lines. origin_px: (u, v) of the crossing at P0 and y = 0; it need not be in view.
    captured_px: column in which R0 is seen. pixel_mm: mm on the camera face per px. angle_rad: alpha0 =
    beta0. length_mm: L0.

    Convention: columns grow from P0 to R0.
    """

    period_px: float
    origin_px: tuple[float, float]
    captured_px: float
    pixel_mm: float
    angle_rad: float
    length_mm: float

    @classmethod
    def of(cls, rig: Rig) -> LatticeView:
        """View of the paper's sensor: equal angles, camera at infinity, perpendicular to the camera face.

        Raises ValueError for another kind of rig.
        """
        optics, camera = Optics(rig), rig.camera
        prism = optics.prism
        if camera.pixel_mm is None or prism.pattern_angle_rad != prism.camera_angle_rad:
            raise ValueError("the paper's sensor has equal angles and a camera at infinity")
        column, row = (float(k) for k in optics.camera.project(prism.camera_face.edge))
        return cls(
            period_px=PITCH_MM / camera.pixel_mm,
            origin_px=(column - float(prism.pattern_face.length_mm) / camera.pixel_mm, row),
            captured_px=column,
            pixel_mm=camera.pixel_mm,
            angle_rad=prism.pattern_angle_rad,
            length_mm=prism.length_mm,
        )

    def resting_px(self) -> Float:
        """Columns (n,) of the lattice's lines at rest, those at P0 and R0 left out."""
        return np.arange(self.origin_px[0] + self.period_px, self.captured_px - 0.5, self.period_px)

    def series(
        self, before_px: Float, after_px: Float, *, step: Literal["printed", "centred"] = "printed"
    ) -> Series:
        """Depth in mm along the mirror from the columns (n,) of crossings, before the press and during it.

        At rest all rays cross both faces at right angles: what is seen at w lies at m = L0 cos(alpha0) - w.
        During the press m stays and w is where the crossing has gone (section 2.4). Equations 17 and 19;
        mirror at rest and level at both ends. Acryl and gap before the pattern are not in the equations.
        """
        w_before = self.pixel_mm * (self.captured_px - before_px)
        return reconstruct(
            self.length_mm * np.cos(self.angle_rad) - w_before,
            self.pixel_mm * (self.captured_px - after_px),
            alpha0=self.angle_rad,
            beta0=self.angle_rad,
            length=self.length_mm,
            step=step,
            rim=0.0,
        )
