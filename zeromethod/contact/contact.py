"""One contact in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from zeromethod.arrays import Float, Single


@dataclass(frozen=True, slots=True)
class Probability:
    """Probability, per camera pixel, that something touches there: (rows, cols) from pixel (left, top) on."""

    left: int
    top: int
    values: Single


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactFigures:
    """The figures of something that touches the mirror.

    Attributes
    ----------
    id : int
        The same from touch to lift; no two contacts of a run share one.
    x_mm, y_mm, sigma_x_mm, sigma_y_mm : float
        Centroid, world frame, and its standard deviations.
    area_mm2, sigma_area_mm2 : float
        Area and its standard deviation.
    major_mm, minor_mm, angle_deg : float
        Axes (whole lengths) of the ellipse of the same second moments, and the major one's direction, from x
        towards y, 0 to 180.
    sigma_edge_mm : float
        Standard deviation of the border across itself, each point's own.
    scattered : float
        Light that comes out of the contact, over the mean of the mirrored picture there.
    depth_mm, sigma_depth_mm : float
        Depth of the mirror at its deepest inside, carried in from around (`zeromethod.contact.inside`), and
        its standard deviation; NaN where too little was read around it.
    """

    id: int
    x_mm: float
    y_mm: float
    sigma_x_mm: float
    sigma_y_mm: float
    area_mm2: float
    sigma_area_mm2: float
    major_mm: float
    minor_mm: float
    angle_deg: float
    sigma_edge_mm: float
    scattered: float
    depth_mm: float = math.nan
    sigma_depth_mm: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Contact(ContactFigures):
    """Something that touches the mirror, with its border.

    outline_mm: (n, 2) a closed polygon, world x and y, from x to y, its points about as far apart as pixels.
    outline_px: (n, 2) the border as the camera sees it, (u, v). probability: of contact, per pixel.
    """

    outline_mm: Float
    outline_px: Float
    probability: Probability

    @property
    def figures(self) -> ContactFigures:
        """The same without its arrays."""
        return ContactFigures(**{field.name: getattr(self, field.name) for field in fields(ContactFigures)})

    def __repr__(self) -> str:
        return f"Contact({self.id}: {self.area_mm2:.3g} mm2 at ({self.x_mm:.3f}, {self.y_mm:.3f}) mm)"
