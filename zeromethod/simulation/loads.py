"""Presses that rubber makes: loads on it, and the dents that they leave in a half-space or a layer.

A load is a Gaussian pressure p0 exp(-r^2 / 2 l^2), l = `width_mm`; a ring, a rod, or something rough is many.

>>> from zeromethod.simulation.press import Mirror
>>> float(Mirror((load(42.0, 0.0, 0.2, 3.54),)).depth(42.0, 0.0).round(9))
0.2
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from zeromethod.errors import InputError
from zeromethod.rig.tables import FaceSupports, Rubber
from zeromethod.simulation.load_fields import Base, UnitDent, ring_dent, rod_dent, rough_dent
from zeromethod.simulation.press import Dent

HALF_SPACE = Rubber(support="free")
"""Rubber whose other faces do not matter."""
LEAST_WIDTH_MM = 0.1
"""Maps of narrower loads have more than 1600 samples a side."""
MOST_WIDTHS = 25
"""Of a ring's or rough disc's radius, or a rod's length, in widths: maps then have at most 1043 a side."""
_REACH_MM = 100.0
"""Farthest of a mirror from what presses it."""


class Form(enum.StrEnum):
    """What presses: one load, or many along a circle, along a line, or strewn over a disc."""

    LOAD = "load"
    RING = "ring"
    ROD = "rod"
    ROUGH = "rough"


@dataclass(frozen=True, slots=True)
class Load:
    """A pressure that moves without changing its shape.

    width_mm: of one load. radius_mm: of the circle or disc. length_mm, angle_deg (from x towards y): of the
    line. seed: of what is strewn. contact_mm, touch_reflectance: as `Dent` has them.
    """

    form: Form
    width_mm: float
    radius_mm: float = 0.0
    length_mm: float = 0.0
    angle_deg: float = 0.0
    seed: int = 0
    contact_mm: float = 0.0
    touch_reflectance: float = 0.05

    def unit(self, rubber: Rubber) -> UnitDent:
        """Its dent, 1 deep, lengths in widths; what a prism adds to a half-space left out."""
        width, base = self.width_mm, None
        if rubber.thickness_mm is not None:
            base = Base(rubber.thickness_mm / width, rubber.poisson, rubber.support == "bonded")
        if self.form is Form.ROD:
            return rod_dent(self.length_mm / width, _REACH_MM / width, base)
        if self.form is Form.ROUGH:
            return rough_dent(self.radius_mm / width, self.seed, _REACH_MM / width, base)
        return ring_dent(self.radius_mm / width, base)

    def dent(self, x_mm: float, y_mm: float, depth_mm: float, rubber: Rubber = HALF_SPACE) -> Dent:
        """The dent, `depth_mm` deep where it is deepest.

        Raises InputError for rubber held at the faces of a prism, where the place matters: use a `Scenario`.
        """
        if isinstance(rubber.support, FaceSupports):
            raise InputError("rubber.support: per face: a load's dent alone needs a half-space or a layer")
        return self.free_dent(x_mm, y_mm, depth_mm, rubber)

    def free_dent(self, x_mm: float, y_mm: float, depth_mm: float, rubber: Rubber) -> Dent:
        """As `dent`, without what a prism adds."""
        unit = self.unit(rubber)
        return Dent(
            unit.shape, x_mm, y_mm, depth_mm, unit.size * self.width_mm, self.length_mm, self.angle_deg,
            self.contact_mm, self.touch_reflectance, unit.coefficients, unit.coefficients,
        )  # fmt: skip


def load(x_mm: float, y_mm: float, depth_mm: float, width_mm: float, rubber: Rubber = HALF_SPACE) -> Dent:
    """Dent of one load, `depth_mm` deep in its middle.

    A Gaussian dent of sigma sqrt(2) width has the same curvature there.
    """
    return Load(Form.LOAD, width_mm).dent(x_mm, y_mm, depth_mm, rubber)


def ring(
    x_mm: float, y_mm: float, depth_mm: float, radius_mm: float, width_mm: float, rubber: Rubber = HALF_SPACE
) -> Dent:
    """Dent of a load smeared along a circle, `depth_mm` where it is deepest."""
    return Load(Form.RING, width_mm, radius_mm).dent(x_mm, y_mm, depth_mm, rubber)


def rod(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    length_mm: float,
    width_mm: float,
    angle_deg: float = 0.0,
    rubber: Rubber = HALF_SPACE,
) -> Dent:
    """Dent of a load smeared along a line, `depth_mm` where it is deepest."""
    one = Load(Form.ROD, width_mm, length_mm=length_mm, angle_deg=angle_deg)
    return one.dent(x_mm, y_mm, depth_mm, rubber)


def rough(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    radius_mm: float,
    width_mm: float,
    seed: int,
    rubber: Rubber = HALF_SPACE,
) -> Dent:
    """Dent of loads strewn over a disc at random, `depth_mm` where it is deepest."""
    return Load(Form.ROUGH, width_mm, radius_mm, seed=seed).dent(x_mm, y_mm, depth_mm, rubber)
