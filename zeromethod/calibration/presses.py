"""Presses as data: read through the candidate rig as any reading is, without assuming their shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.calibration.measurements import off_seams, well_inside
from zeromethod.calibration.parameters import PARAMETERS
from zeromethod.calibration.rays import UnboundedOptics, teeth_seen
from zeromethod.errors import InputError, MeasurementError
from zeromethod.rig.model import Rig
from zeromethod.rig.prism_tables import MOST_TEETH
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.surface.learned import Learned
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest_pixels import RestGrid, rest_pixels
from zeromethod.warp.warp import Warp

_PEAK_SHARE = 5e-4
"""Bias, relative to the depth, of the polynomial that finds a peak between nodes."""
_CAP_SHARE = 0.6
"""Share of the contact's radius within which the rubber surely follows the ball."""
_LEAST_CAP_NODES = 12
_CAP_SHARE_ERROR = 0.01
"""What the contact's rim does to the cap's curvature, relative."""

_POINTING = frozenset(
    name
    for name in PARAMETERS
    if name.startswith("camera.") and name not in {"camera.x_mm", "camera.y_mm", "camera.z_mm"}
)
_PLACE = frozenset({"camera.x_mm", "camera.y_mm", "camera.z_mm"})


@dataclass(frozen=True, eq=False)
class RestReading:
    """How presses are read through a candidate rig: on the rays that the measured rest names.

    grid: the nodes of all warps. q_rest: (rows, cols, 2) LCD px seen by the mirror at rest, NaN where it
    was not measured. Each node's ray is the candidate's one that sees q_rest (`surface.rest_pixels`), so
    the candidate's reading is zero at rest, and where a perspective camera points, its focal length and its
    distortion have no part in it at all.
    """

    grid: NodeGrid
    q_rest: Float
    start: Float | None = field(default=None, repr=False)

    @classmethod
    def of(cls, grid: NodeGrid, rest: Warp) -> RestReading:
        """From a warp measured at rest; flagged nodes are not read."""
        if rest.q.shape != (*grid.shape, 2):
            raise InputError(f"rest.q: shape {rest.q.shape}: must be {(*grid.shape, 2)}")
        known = np.zeros(grid.shape, bool)
        known[grid.inner] = rest.valid[grid.inner]
        return cls(grid, np.where(known[..., None], rest.q, np.nan))

    def prepared(self, rig: Rig) -> RestReading:
        """With the nodes fixed that lie well inside `rig`'s mirror, and its rays to start from."""
        nodes = np.stack(self.grid.mesh(), axis=-1)
        inside = well_inside(rig, nodes)
        known = inside & np.isfinite(self.q_rest).all(axis=-1)
        if rig.prism.teeth is not None:
            known &= off_seams(rig, nodes)
        q_rest = np.where(known[..., None], self.q_rest, np.nan)
        start = rest_pixels(UnboundedOptics(rig), nodes, q_rest)
        return replace(self, q_rest=q_rest, start=np.where(inside[..., None], start, np.nan))

    def reader(self, rig: Rig, with_sigma: bool = True) -> SurfaceReader:
        """Reader of `rig` on these rays, where only depths count `with_sigma` off.

        Raises InputError where no node can be read.
        """
        optics = UnboundedOptics(rig)
        nodes = np.stack(self.grid.mesh(), axis=-1)
        start = nodes if self.start is None else self.start
        pixel = rest_pixels(optics, start, self.q_rest)
        known: Mask = np.asarray(np.isfinite(self.q_rest).all(axis=-1))
        if rig.prism.teeth is None:
            pixel[~known] = np.nan
        else:
            # what a seam hides has rays, too, for slopes to be carried across: between its neighbours'
            away = continue_smoothly(np.where(known[..., None], pixel - nodes, 0.0), known)
            pixel = np.where(np.isfinite(start), nodes + away, np.nan)
        grid = RestGrid(image_shape=self.grid.image_shape, period_px=self.grid.period_px, pixels=pixel)
        return SurfaceReader(rig, optics, grid, with_sigma)


def blind_to(rig: Rig) -> frozenset[str]:
    """Parameters that a reading on the measured rest's rays does not depend on."""
    if rig.prism.teeth is not None:
        unseen = set(range(MOST_TEETH)) - teeth_seen(rig)
        far = frozenset(name for name in PARAMETERS if name.startswith(tuple(f"tooth{k}." for k in unseen)))
        return far | blind_to(rig.model_copy(update={"prism": rig.prism.model_copy(update={"teeth": None})}))
    if rig.prism.rest.shape == "flat" and rig.camera.projection == "perspective":
        return _POINTING
    return frozenset(_POINTING | _PLACE) - {"camera.heading_deg", "camera.elevation_deg", "camera.roll_deg"}


@dataclass(frozen=True, eq=False)
class KnownPress:
    """A press of known depth: its measured warp, what the height gauge said and how well it is known, mm."""

    name: str
    warp: Warp
    depth_mm: float
    sigma_mm: float


_Read = tuple[Surface, Learned | None]
"""A press as it was read, and the loads that were learned to make it."""


@dataclass(frozen=True, eq=False)
class Presses:
    """Presses of known depth, of any shape. The numbers are depths of their peaks, mm."""

    reading: RestReading
    presses: Sequence[KnownPress]
    sigma: Float
    before: Sequence[_Read | None] = field(default=(), repr=False)
    blind_to: frozenset[str] = frozenset()
    name: ClassVar[str] = "presses"
    group: ClassVar[int] = 1
    costly: ClassVar[bool] = True
    step: ClassVar[float] = 0.1

    @classmethod
    def of(cls, reading: RestReading, presses: Sequence[KnownPress]) -> Presses:
        """Presses read on a common rest. Raises InputError for depths or sigmas that are not above 0."""
        for press in presses:
            if not (press.depth_mm > 0.0 and press.sigma_mm > 0.0):
                raise InputError(
                    f"press {press.name}: depth {press.depth_mm}, sigma {press.sigma_mm}: both above 0, in mm"
                )
        sigma = np.array([press.sigma_mm for press in presses])
        return cls(reading, tuple(presses), sigma, (None,) * len(sigma))

    @property
    def measured(self) -> Float:
        """(n,) known depths, mm."""
        return np.array([press.depth_mm for press in self.presses])

    def prepared(self, rig: Rig) -> Presses:
        """Nodes chosen, and sigma with what the reading itself adds.

        Raises MeasurementError, naming the press, where its warp gives no depth.
        """
        reading = self.reading.prepared(rig)
        read = self._read(reading, rig)
        peaks = [peak(surface) for surface, _ in read]
        for press, found in zip(self.presses, peaks, strict=True):
            if not np.isfinite(found.depth_mm + found.sigma_mm):
                raise MeasurementError(
                    f"press {press.name}: its warp gives no depth where the mirror is seen"
                )
        sigma = np.sqrt(
            [
                press.sigma_mm**2 + found.sigma_mm**2 + (_PEAK_SHARE * found.depth_mm) ** 2
                for press, found in zip(self.presses, peaks, strict=True)
            ]
        )
        return replace(self, reading=reading, sigma=sigma, before=read, blind_to=blind_to(rig))

    def predict(self, rig: Rig) -> Float:
        """(n,) depths of the peaks as read through `rig`, mm; NaN for what it cannot read."""
        try:
            return np.array([found.depth_mm for found in self.peaks(rig, with_sigma=False)])
        except InputError:
            return np.full(len(self.presses), np.nan)

    def peaks(self, rig: Rig, with_sigma: bool = True) -> list[Peak]:
        """Peak of every press as read through `rig`."""
        return [peak(surface) for surface, _ in self._read(self.reading, rig, with_sigma)]

    def _read(self, reading: RestReading, rig: Rig, with_sigma: bool = True) -> list[_Read]:
        """Each press with what it was read from before: the loads that it is made by stay those."""
        reader = reading.reader(rig, with_sigma)
        found = []
        for press, before in zip(self.presses, self.before, strict=True):
            surface, learned = (None, None) if before is None else before
            found.append((reader.read(press.warp, surface, learned), reader.learned))
        return found


@dataclass(frozen=True, eq=False)
class KnownBall:
    """A ball of known radius, mm, pressed in: inside the contact the rubber has its curvature.

    Needs the light inside the contact: a ball that wets the rubber takes it away. The number is the
    logarithm of the radius, so that its sigma is relative. model: relative error of taking a paraboloid
    inside 0.6 of Hertz's contact radius for the ball.
    """

    reading: RestReading
    warp: Warp
    radius_mm: float
    sigma_radius_mm: float
    sigma: Float = field(default_factory=lambda: np.full(1, np.nan))
    learned: Learned | None = field(default=None, repr=False)
    blind_to: frozenset[str] = frozenset()
    name: ClassVar[str] = "ball"
    group: ClassVar[int] = 1
    costly: ClassVar[bool] = True
    step: ClassVar[float] = 0.1

    @property
    def measured(self) -> Float:
        """(1,) log of the radius in mm."""
        return np.log([self.radius_mm])

    def prepared(self, rig: Rig) -> KnownBall:
        """Nodes chosen, and sigma with the noise of the reading.

        Raises MeasurementError where too few nodes see the contact.
        """
        reading = self.reading.prepared(rig)
        reader = reading.reader(rig)
        fitted = self._radius(reader.read(self.warp))
        if fitted is None:
            raise MeasurementError(
                "ball: the contact shows too few nodes; it takes the light away, or is small"
            )
        relative = float(np.hypot(self.sigma_radius_mm / self.radius_mm, _CAP_SHARE_ERROR))
        sigma = np.array([np.hypot(relative, fitted[1])])
        return replace(self, reading=reading, sigma=sigma, learned=reader.learned, blind_to=blind_to(rig))

    def predict(self, rig: Rig) -> Float:
        """(1,) log of the radius as read."""
        reader = self.reading.reader(rig, with_sigma=False)
        fitted = self._radius(reader.read(self.warp, learned=self.learned))
        return np.array([np.nan if fitted is None else np.log(fitted[0])])

    def _radius(self, surface: Surface) -> tuple[float, float] | None:
        """Radius in mm of the cap's slopes, and its relative sigma; None where it is not seen.

        Inside the contact depth is d0 - r^2 / 2R (to (r/R)^2 / 4), so slope = -(p - centre) / R: linear in
        x and y with one coefficient. Slopes need no anchor.
        """
        top = peak(surface)
        if not top.depth_mm > 0.0:
            return None
        away = np.hypot(surface.x_mm - top.x_mm, surface.y_mm - top.y_mm)
        with np.errstate(invalid="ignore"):
            cap = surface.valid & (away < _CAP_SHARE * np.sqrt(self.radius_mm * top.depth_mm))
        count = int(np.count_nonzero(cap))
        if count < _LEAST_CAP_NODES:
            return None
        x, y, zero, one = surface.x_mm[cap], surface.y_mm[cap], np.zeros(count), np.ones(count)
        columns = np.concatenate([np.stack([x, one, zero], -1), np.stack([y, zero, one], -1)])
        slope = np.concatenate([surface.slope[cap][:, 0], surface.slope[cap][:, 1]])
        spread = np.concatenate([surface.sigma_slope[cap][:, 0], surface.sigma_slope[cap][:, 1]])
        inverse = np.linalg.inv((columns / spread[:, None] ** 2).T @ columns)
        bend = float((inverse @ (columns / spread[:, None] ** 2).T @ slope)[0])
        if not bend < 0.0:
            return None
        return -1.0 / bend, float(np.sqrt(inverse[0, 0]) / -bend)
