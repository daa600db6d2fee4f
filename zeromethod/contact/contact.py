"""One contact in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single

LEAST_MM2 = 0.2
"""Area below which nothing is called a contact."""


@dataclass(frozen=True, slots=True)
class Probability:
    """Probability, per camera pixel, that something touches there: (rows, cols) from pixel (left, top) on."""

    left: int
    top: int
    values: Single


@dataclass(frozen=True, slots=True, eq=False)
class ContactImage:
    """What touches, as the camera sees it through the mirror, rectified to mm.

    Attributes
    ----------
    light : (rows, cols) float32
        Light over the mean of the picture that the mirror shows there in the null: an object's is what it
        scatters, that of rubber between ridges up to 2, as the LCD is white there. NaN out of view. Columns
        along x, rows along y.
    mm_per_px : float
        Side of a pixel: the camera's, as it sees the mirror there.
    x_mm, y_mm : float
        World place of the middle of pixel (0, 0).
    sunk_x_mm, sunk_y_mm : float
        How far all of it lies, by the depth of the mirror, from where the camera would see it at rest.
    """

    light: Single
    mm_per_px: float
    x_mm: float
    y_mm: float
    sunk_x_mm: float = 0.0
    sunk_y_mm: float = 0.0

    def inside(self, outline_mm: Float) -> Mask:
        """(rows, cols) pixels inside a closed polygon (n, 2), mm."""
        at = (outline_mm - np.array([self.x_mm, self.y_mm])) / self.mm_per_px
        mask = np.zeros(self.light.shape, np.uint8)
        cv2.fillPoly(mask, [np.rint(at * 16).astype(np.int32)], 1, shift=4)
        return np.asarray(mask > 0)


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
    leak_mm : float
        By how much the border was moved inwards, as light leaks across the gap beside a ball but not beside
        an edge: half of what a ball's gap would let across.
    scattered : float
        Light that comes out of the contact, over the mean of the mirrored picture there.
    depth_mm, sigma_depth_mm : float
        Depth of the mirror at its deepest inside, carried in from around (`zeromethod.contact.inside`), and
        its standard deviation; NaN where too little was read around it.
    age_s : float
        Time since it was first seen. Rubber creeps, which forces do not allow for.
    force_n, torque_x_nmm, torque_y_nmm : float
        Force into the rubber, and its torques about x and y through the centroid
        (`zeromethod.contact.force`); NaN where the rig file does not say how stiff the rubber is, or too
        little was read.
    sigma_force_n, sigma_torque_x_nmm, sigma_torque_y_nmm : float
        Their standard deviations.
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
    age_s: float = 0.0
    force_n: float = math.nan
    sigma_force_n: float = math.nan
    torque_x_nmm: float = math.nan
    sigma_torque_x_nmm: float = math.nan
    torque_y_nmm: float = math.nan
    sigma_torque_y_nmm: float = math.nan
    leak_mm: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Contact(ContactFigures):
    """Something that touches the mirror, with its border.

    outline_mm: (n, 2) a closed polygon, world x and y, from x to y, its points about as far apart as pixels.
    outline_px: (n, 2) the border as the camera sees it, (u, v). probability: of contact, per pixel.
    image: what touches; None where too little was read around it to place it in mm. carrier_left: amplitude
    of the carriers in its middle over that at rest; NaN where it is not what shows contacts.
    """

    outline_mm: Float
    outline_px: Float
    probability: Probability
    image: ContactImage | None = None
    carrier_left: float = math.nan

    @classmethod
    def of_row(cls, row: Any) -> Contact:
        """From a row of a recording's table of contacts, which has neither pixels nor image."""
        known = row.dtype.names
        values = {one.name: row[one.name].item() for one in fields(ContactFigures) if one.name in known}
        outline = np.asarray(row["outline_mm"], dtype=np.float64)
        none = Probability(0, 0, np.zeros((0, 0), np.float32))
        return cls(**values, outline_mm=outline, outline_px=np.zeros((0, 2)), probability=none)

    @property
    def figures(self) -> ContactFigures:
        """The same without its arrays."""
        return ContactFigures(**{field.name: getattr(self, field.name) for field in fields(ContactFigures)})

    def __repr__(self) -> str:
        return f"Contact({self.id}: {self.area_mm2:.3g} mm2 at ({self.x_mm:.3f}, {self.y_mm:.3f}) mm)"
