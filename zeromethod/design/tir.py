"""Margin of every node to the critical angle, at rest and when the mirror slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.design.sampled_view import SampledView
from zeromethod.optics import HeightField, Trace, critical_angle_rad
from zeromethod.rig.model import Rig

SLOPES_MRAD = (0.0, 5.0, 10.0, 20.0, 50.0)
"""Slopes of the mirror, of either sign along x and along y, for which the margin is given."""

_DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


@dataclass(frozen=True)
class Facets:
    """The rest surface with every point tilted in its place: no height changes, all slopes do.

    Convention: `slope` = (dd/dx, dd/dy) of the depth, rad.
    """

    rest: HeightField
    slope: tuple[float, float]

    def height(self, x: Float, y: Float) -> Float:
        """Height of the rest surface, mm."""
        return self.rest.height(x, y)

    def gradient(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dz/dx, dz/dy) of the rest surface less the slope."""
        zx, zy = self.rest.gradient(x, y)
        return zx - self.slope[0], zy - self.slope[1]


def critical_deg(rig: Rig) -> float:
    """Critical angle of rubber against air, deg."""
    return float(np.degrees(critical_angle_rad(rig.prism.index)))


def incidence_deg(trace: Trace) -> Float:
    """Angle of incidence on the mirror, deg."""
    return np.degrees(np.arccos(np.clip(trace.cos_incidence, -1.0, 1.0)))


def margin_deg(view: SampledView, slope: tuple[float, float] = (0.0, 0.0)) -> Float:
    """Angle of incidence less the critical angle where the mirror has a slope (rad), deg, (rows, cols).

    Below 0 the reflection is no longer total. NaN where the node does not see the LCD at rest.
    """
    tilted = Facets(view.optics.rest, slope)
    trace = view.optics.trace(view.u_px, view.v_px, tilted) if any(slope) else view.trace
    return np.where(view.on_lcd, incidence_deg(trace) - critical_deg(view.rig), np.nan)


def reflectance(view: SampledView) -> Float:
    """Power reflectance of the mirror at rest for the LCD's light, (rows, cols); NaN off the LCD."""
    return np.where(view.on_lcd, view.trace.reflectance, np.nan)


def margins_by_slope_deg(view: SampledView) -> Float:
    """Least margin over slopes of +-x and +-y, (slopes, rows, cols), deg; slopes as in SLOPES_MRAD."""
    return np.stack(
        [
            np.min([margin_deg(view, (1e-3 * x * size, 1e-3 * y * size)) for x, y in _DIRECTIONS], axis=0)
            for size in SLOPES_MRAD
        ]
    )


def slope_to_loss_mrad(view: SampledView) -> Float:
    """Slope, in the plane of incidence and towards the camera, that uses up the margin, mrad, (rows, cols).

    Turning the normal by an angle towards the ray takes as much off the angle of incidence; below 0: lost at
    rest already. Exact where the rest surface is flat.
    """
    result: Float = 1e3 * np.tan(np.radians(margin_deg(view)))
    return result
