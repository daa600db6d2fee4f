"""Hard objects that press on the rubber: their shapes, and where and how deep they are held."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.simulation.contact.texture import Texture


class Form(enum.StrEnum):
    """Shapes of objects, each with its lowest point (or line, or face) in the middle."""

    BALL = "ball"
    CONE = "cone"
    PUNCH = "punch"
    EDGE = "edge"
    FINGER = "finger"
    BARS = "bars"
    TEXTURE = "texture"


ALBEDO = {"black": 0.04, "grey": 0.2, "white": 0.8}
"""Share of the light that falls on an object which it scatters back."""


@dataclass(frozen=True, slots=True)
class Solid:
    """An object, rigid compared with the rubber.

    radius_mm: of a ball, a punch (flat and round, its edge sharp), an edge (a rod of `length_mm` along
    `angle_deg`, from x towards y), a finger (a ball with `ridge_height_mm` high ridges, `ridge_pitch_mm`
    apart along that angle), bars (a punch with such ridges, flat, sharp, half a pitch wide). flank_deg: of a
    cone, from the surface. adhesion_j_m2: work to part a ball from the rubber.
    friction: force along x that it drags the rubber with, over that into it. texture: what a flat, round face
    of `radius_mm` is covered with.
    Balls are parabolas of that curvature, as Hertz has them.
    """

    form: Form
    radius_mm: float = 0.0
    flank_deg: float = 0.0
    length_mm: float = 0.0
    angle_deg: float = 0.0
    ridge_pitch_mm: float = 0.0
    ridge_height_mm: float = 0.0
    adhesion_j_m2: float = 0.0
    albedo: float = ALBEDO["black"]
    friction: float = 0.0
    texture: Texture | None = None

    @property
    def flat(self) -> bool:
        """Whether it ends in a flat face of `radius_mm`."""
        return self.form in (Form.PUNCH, Form.BARS, Form.TEXTURE)

    def profile(self, along: Float, across: Float) -> Float:
        """Height, mm, over the lowest point, at places in the object's own frame, mm; inf beside it."""
        r2 = along**2 + across**2
        if self.form is Form.CONE:
            return np.asarray(np.tan(np.radians(self.flank_deg)) * np.sqrt(r2))
        if self.form is Form.PUNCH:
            return np.where(r2 <= self.radius_mm**2, 0.0, np.inf)
        if self.form is Form.BARS:
            away = np.abs(along / self.ridge_pitch_mm - np.rint(along / self.ridge_pitch_mm))
            grooved = np.where(away <= 0.25, 0.0, self.ridge_height_mm)
            return np.where(r2 <= self.radius_mm**2, grooved, np.inf)
        if self.texture is not None:
            height = self.texture.profile(along, across, self.radius_mm)
            return np.where(r2 <= self.radius_mm**2, height, np.inf)
        if self.form is Form.EDGE:
            rod = across**2 / (2 * self.radius_mm) + 0.0 * along
            return np.where(np.abs(along) <= self.length_mm / 2, rod, np.inf)
        height = r2 / (2 * self.radius_mm)
        if self.form is Form.FINGER:
            height = height + self._ridges(along)
        return np.asarray(height)

    def _ridges(self, along: Float) -> Float:
        wave = np.cos(2 * np.pi * along / self.ridge_pitch_mm)
        return np.asarray(0.5 * self.ridge_height_mm * (1 - wave))

    def reach_mm(self, height_mm: float) -> tuple[float, float]:
        """(along, across) mm from the middle to where the object is that high over its lowest point."""
        if self.form is Form.CONE:
            reach = height_mm / np.tan(np.radians(self.flank_deg))
            return float(reach), float(reach)
        if self.flat:
            return self.radius_mm, self.radius_mm
        bow = float(np.sqrt(2 * self.radius_mm * height_mm))
        return (self.length_mm / 2, bow) if self.form is Form.EDGE else (bow, bow)

    def depth_guess_mm(self, force_n: float, modulus_mpa: float) -> float:
        """Depth that a force reaches on a half-space, roughly; modulus: E / (1 - nu^2)."""
        if self.form is Form.CONE:
            return float(np.sqrt(0.5 * np.pi * np.tan(np.radians(self.flank_deg)) * force_n / modulus_mpa))
        if self.flat:
            return force_n / (2 * self.radius_mm * modulus_mpa)
        if self.form is Form.EDGE:
            return float(2 * force_n / (modulus_mpa * self.length_mm))
        contact = np.cbrt(0.75 * force_n * self.radius_mm / modulus_mpa)
        return float(contact**2 / self.radius_mm) + self.ridge_height_mm


@dataclass(frozen=True, slots=True)
class Held:
    """An object at one instant: its middle, and either its depth below the surface at rest or its force.

    number: which object of the scenario it is. bow: second derivatives (xx, xy, yy), 1/mm, by which a curved
    mirror at rest falls away from the object's middle.
    """

    solid: Solid
    x_mm: float
    y_mm: float
    depth_mm: float | None = None
    force_n: float | None = None
    number: int = 0
    bow: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def profile(self, along: Float, across: Float) -> Float:
        """Height, mm, of the object over the mirror at rest, from 0 on, at places in its own frame, mm."""
        dx, dy = self.world(along, across)
        dx, dy = dx - self.x_mm, dy - self.y_mm
        falls = 0.5 * (self.bow[0] * dx**2 + self.bow[2] * dy**2) + self.bow[1] * dx * dy
        return np.asarray(self.solid.profile(along, across) + falls)

    def local(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(along, across) mm in the object's own frame of world points."""
        angle = np.radians(self.solid.angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        return c * (x - self.x_mm) + s * (y - self.y_mm), c * (y - self.y_mm) - s * (x - self.x_mm)

    def world(self, along: Float, across: Float) -> tuple[Float, Float]:
        """(x, y) mm of points in the object's own frame."""
        angle = np.radians(self.solid.angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        return self.x_mm + c * along - s * across, self.y_mm + s * along + c * across
