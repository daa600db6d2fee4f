"""Dents and the pressed mirror at one instant, in closed form: the truth that a reading is compared with.

Convention: depth d > 0 into the rubber, slope = (dd/dx, dd/dy), world millimetres. Dents add up, as
they do in linear elasticity.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.devices.protocols import TrueContact
from zeromethod.simulation.cloth import Cloth
from zeromethod.simulation.contact.touch import Touch, evanescent_mm
from zeromethod.simulation.shapes import Field, ball, cone, edge, gaussian, height_map, radial, whole_plane
from zeromethod.simulation.spline import spline_coefficients


class Shape(enum.StrEnum):
    """Kinds of dent (formulas in `zeromethod.simulation.shapes`).

    Gaussians and edges are formulas which no rubber makes; loads on it (`zeromethod.simulation.loads`) are
    radial or maps of the whole plane.
    """

    GAUSSIAN = "gaussian"
    BALL = "ball"
    CONE = "cone"
    EDGE = "edge"
    MAP = "map"
    RADIAL = "radial"
    WHOLE_PLANE = "whole_plane"


SAMPLED = {Shape.MAP: height_map, Shape.RADIAL: radial, Shape.WHOLE_PLANE: whole_plane}
"""Those that splines through samples describe."""


@dataclass(frozen=True, slots=True, eq=False)
class Dent:
    """One press at one instant.

    depth_mm: at the peak, > 0 into the rubber, negative allowed. size_mm: gaussian sigma; ball radius R;
    cone contact radius a; edge sigma of the cross profile; map pitch; radial and whole plane their scale.
    length_mm: of the straight line that an edge or rod touches along. angle_deg: edge and maps, from x
    towards y. contact_mm: radius (with a length: half width) inside which the object touches while depth_mm
    > 0, so that reflection falls to `touch_reflectance` of itself; 0 = a dry pad that does not couple.
    map: (rows along y, cols along x) centred at (x_mm, y_mm), depth = depth_mm x map, continued by zeros;
    `map_coefficients` are its `spline_coefficients`, filled in; radial and whole plane have their own.
    Dents are equal when all numbers are equal and the map is the same object.
    """

    shape: Shape
    x_mm: float
    y_mm: float
    depth_mm: float
    size_mm: float
    length_mm: float = 0.0
    angle_deg: float = 0.0
    contact_mm: float = 0.0
    touch_reflectance: float = 0.05
    map: NDArray[np.floating] | None = field(default=None, repr=False)
    map_coefficients: Float | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.map is not None and self.map_coefficients is None:
            object.__setattr__(self, "map_coefficients", spline_coefficients(self.map))

    @property
    def key(self) -> tuple[object, ...]:
        """All that makes up the dent, hashable."""
        numbers = (self.x_mm, self.y_mm, self.depth_mm, self.size_mm, self.length_mm, self.angle_deg)
        return (self.shape, *numbers, self.contact_mm, self.touch_reflectance, id(self.map))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Dent) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def touches(self) -> bool:
        """Whether the object couples light out."""
        return self.contact_mm > 0 and self.depth_mm > 0

    def local(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(along, across) mm: coordinates about the dent's centre, turned by `angle_deg`."""
        angle = np.deg2rad(self.angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        x, y = x - self.x_mm, y - self.y_mm
        return c * x + s * y, c * y - s * x

    def world(self, along: Float, across: Float) -> tuple[Float, Float]:
        """(x, y) mm of places about the dent's centre."""
        angle = np.deg2rad(self.angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        return self.x_mm + c * along - s * across, self.y_mm + s * along + c * across

    def field(self, x: Float, y: Float) -> Field:
        """(depth mm, dd/dx, dd/dy) of this dent alone."""
        along, across = self.local(x, y)
        depth, by_along, by_across = self._local_field(along, across)
        angle = np.deg2rad(self.angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        return depth, c * by_along - s * by_across, s * by_along + c * by_across

    def _local_field(self, along: Float, across: Float) -> Field:
        if self.depth_mm == 0:
            zero = np.zeros(np.broadcast_shapes(along.shape, across.shape))
            return zero, zero, zero
        if self.shape is Shape.GAUSSIAN:
            return gaussian(along, across, self.depth_mm, self.size_mm)
        if self.shape is Shape.BALL:
            return ball(along, across, self.depth_mm, self.size_mm)
        if self.shape is Shape.CONE:
            return cone(along, across, self.depth_mm, self.size_mm)
        if self.shape is Shape.EDGE:
            return edge(along, across, self.depth_mm, self.size_mm, self.length_mm)
        if self.map_coefficients is None or self.map is None:
            raise ValueError(f"a dent of shape '{self.shape}' needs a map")
        return SAMPLED[self.shape](along, across, self.depth_mm, self.size_mm, self.map_coefficients)

    def covers(self, x: Float, y: Float) -> Mask:
        """Where the object touches."""
        if not self.touches:
            return np.zeros(np.broadcast_shapes(x.shape, y.shape), dtype=np.bool_)
        along, across = self.local(x, y)
        if self.length_mm:
            return (np.abs(across) < self.contact_mm) & (np.abs(along) < self.length_mm / 2)
        covered: Mask = along**2 + across**2 < self.contact_mm**2
        return covered


@dataclass(frozen=True, slots=True)
class Mirror:
    """The pressed mirror at one instant: exact depth, slope and reflectance. No dents = at rest.

    touches: hard objects in contact, whose dents are among the others. cloth: what lies on the mirror, and
    between it and them.
    """

    dents: tuple[Dent, ...] = ()
    touches: tuple[Touch, ...] = ()
    cloth: Cloth | None = None

    def depth(self, x: ArrayLike, y: ArrayLike) -> Float:
        """Depth, mm, > 0 into the rubber, of the broadcast shape of x and y (mm)."""
        return self._sum(x, y)[0]

    def slope(self, x: ArrayLike, y: ArrayLike) -> tuple[Float, Float]:
        """(dd/dx, dd/dy) of the depth, analytic."""
        _, by_x, by_y = self._sum(x, y)
        return by_x, by_y

    def reflectance_factor(self, x: ArrayLike, y: ArrayLike) -> Float:
        """Share of the reflection left by what touches: 1 where nothing does."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        factor = np.ones(np.broadcast_shapes(x.shape, y.shape))
        for dent in self.dents:
            if dent.touches:
                factor = np.where(dent.covers(x, y), np.minimum(factor, dent.touch_reflectance), factor)
        for touch in self.touches:
            factor = np.where(touch.covers(x, y), 0.0, factor)
        return factor

    def light(self, x: Float, y: Float, cos_incidence: Float, index: float) -> tuple[Float, Float]:
        """(share of the reflection left, share of light scattered by what touches) for rays in the rubber.

        Other than `reflectance_factor` it counts what crosses the gap beside a contact. index: the rubber's.
        """
        dents = Mirror(self.dents)
        left, scattered = dents.reflectance_factor(x, y), np.zeros(np.shape(x))
        if self.cloth is not None:
            taken = self.threads(x, y)
            return left * (1 - taken), self.cloth.spec.albedo * taken
        if self.touches:
            evanescent = evanescent_mm(cos_incidence, index)
            for touch in self.touches:
                crossing = touch.crossing(x, y, evanescent)
                left, scattered = left * (1 - crossing), scattered + touch.albedo * crossing
        return left, scattered

    def threads(self, x: Float, y: Float) -> Float:
        """Share of light that the cloth's threads take; 0 without a cloth."""
        if self.cloth is None:
            return np.zeros(np.shape(x))
        gap = np.full(np.shape(x), np.inf)
        for touch in self.touches:
            gap = np.minimum(gap, np.maximum(touch.level_at(x, y), 0.0) ** 1.5)
        return self.cloth.share(x, y, gap)

    @property
    def contacts(self) -> tuple[TrueContact, ...]:
        """The hard objects in contact."""
        return tuple(
            TrueContact(touch.number + 1, *touch.centroid_mm, touch.area_mm2, touch.force_n)
            for touch in self.touches
        )

    def _sum(self, x: ArrayLike, y: ArrayLike) -> Field:
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        shape = np.broadcast_shapes(x.shape, y.shape)
        depth, by_x, by_y = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for dent in self.dents:
            if dent.depth_mm != 0:
                d, dx, dy = dent.field(x, y)
                depth, by_x, by_y = depth + d, by_x + dx, by_y + dy
        return depth, by_x, by_y


def contact_radius_mm(shape: Shape, depth_mm: float, size_mm: float) -> float:
    """Radius, mm, of the area in which a ball (Hertz: sqrt(R d)) or cone touches; 0 for other shapes."""
    if depth_mm <= 0:
        return 0.0
    if shape is Shape.BALL:
        return float(np.sqrt(size_mm * depth_mm))
    return size_mm if shape is Shape.CONE else 0.0
