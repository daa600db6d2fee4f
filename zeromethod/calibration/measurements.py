"""What a calibration is made from: each kind of data as numbers with sigma, and what a rig makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, Protocol, Self

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.calibration.parameters import PARAMETERS, describe
from zeromethod.calibration.rays import UnboundedOptics, mirror_point, tooth_phase
from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.optics.saw_rays import seams
from zeromethod.optics.teeth import Teeth
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

MARGIN_MM = 2.0
"""Nodes whose mirror point lies nearer to an edge of the mirror are left out: what they see is a chamfer or
worse, and a candidate rig may put them beyond P0, where the lever changes its sign."""
_SEAM_SHARE = 0.1
"""Of a tooth: nodes nearer to a seam are left out, as a candidate rig may have them on the next tooth."""
_MOST_NODES = 800
_STEP_PX = 0.5
_BLOCKS = 6
_NOTABLE = 1.3
"""Misfit, relative to what noise leaves, from which it counts."""


class Measurement(Protocol):
    """Data of one kind.

    Numbers are in the data's own unit and their errors count as independent. Consecutive numbers form groups
    that stand or fall together when outliers are looked for.
    """

    group: ClassVar[int]
    """Numbers that stand or fall together."""
    costly: ClassVar[bool]
    """Whether predicting takes more than milliseconds."""
    step: ClassVar[float]
    """Step of differences, in prior sigmas."""

    @property
    def name(self) -> str:
        """What it is called."""

    @property
    def measured(self) -> Float:
        """(n,) numbers."""

    @property
    def sigma(self) -> Float:
        """(n,) standard deviations."""

    @property
    def blind_to(self) -> frozenset[str]:
        """Parameters without influence."""

    def prepared(self, rig: Rig) -> Self:
        """The same data with everything chosen that must not change between rigs near `rig`."""

    def predict(self, rig: Rig) -> Float:
        """(n,) what `rig` would give; NaN where it cannot say."""


class SingleNumbers:
    """Numbers that stand or fall each by itself and are predicted at no cost."""

    group: ClassVar[int] = 1
    costly: ClassVar[bool] = False
    step: ClassVar[float] = 0.01


class PixelsOnLine(SingleNumbers):
    """Pixels (m, 2) on the image of a line. The numbers are distances from it; sigma_px: camera px."""

    pixel: Float
    sigma_px: float

    @property
    def measured(self) -> Float:
        """(m,) zeros: the pixels lie on the line."""
        return np.zeros(len(self.pixel))

    @property
    def sigma(self) -> Float:
        """(m,) camera px."""
        return np.full(len(self.pixel), self.sigma_px)

    def prepared(self, rig: Rig) -> Self:  # noqa: ARG002 (nothing to choose)
        """As it is."""
        return self


@dataclass(frozen=True, eq=False)
class RestPositions(SingleNumbers):
    """The rest map: LCD positions that camera pixels see by the mirror at rest.

    pixel: (m, 2) camera px. q: (m, 2) LCD px. sigma_q: (m, 2) LCD px. teeth: (m,) of a saw by
    which their rays enter and leave. Numbers are column, row, column, ...
    """

    pixel: Float
    q: Float
    sigma_q: Float
    teeth: tuple[Teeth, Teeth] | None = None
    group: ClassVar[int] = 2
    name: ClassVar[str] = "rest map"
    blind_to: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def of(cls, grid: NodeGrid, rest: Warp) -> RestPositions:
        """Valid measurable nodes of a warp measured at rest."""
        valid = np.zeros(grid.shape, bool)
        valid[grid.inner] = rest.valid[grid.inner]
        valid &= np.isfinite(rest.q).all(axis=-1) & np.isfinite(rest.sigma).all(axis=-1)
        pixel = np.stack(grid.mesh(), axis=-1)
        return cls(pixel[valid], rest.q[valid], rest.sigma[valid])

    @property
    def measured(self) -> Float:
        """(2 m,) LCD px."""
        return self.q.ravel()

    @property
    def sigma(self) -> Float:
        """(2 m,) LCD px."""
        return self.sigma_q.ravel()

    def prepared(self, rig: Rig) -> RestPositions:
        """Nodes well inside the mirror and off seams, evenly thinned out to what a fit needs."""
        inside = np.flatnonzero(well_inside(rig, self.pixel) & off_seams(rig, self.pixel))
        chosen = inside[:: max(1, -(-len(inside) // _MOST_NODES))]
        pixel = self.pixel[chosen]
        teeth = None if rig.prism.teeth is None else seams(Optics(rig), *pixel.T)[1:]
        return replace(self, pixel=pixel, q=self.q[chosen], sigma_q=self.sigma_q[chosen], teeth=teeth)

    def predict(self, rig: Rig) -> Float:
        """(2 m,) LCD px by the exact rays."""
        return UnboundedOptics(rig, self.teeth).rest_map(self.pixel[:, 0], self.pixel[:, 1]).ravel()

    def inflated(self, factor: float) -> RestPositions:
        """The same with a larger sigma."""
        return replace(self, sigma_q=factor * self.sigma_q)

    def misfit(self, normalised: Float, weight: Float) -> float:
        """By how much sigma must grow to hold what no rig explains; 1 where noise explains it.

        normalised: (2 m,) residual / sigma; weight: (m,) of the robust fit. Blocks of the view are averaged:
        noise averages out, a mirror that is not flat or a lens that is not the model's does not, and a fit
        that counts each node as new knowledge would believe it.
        """
        left = normalised.reshape(-1, 2)
        position = (self.pixel - self.pixel.min(axis=0)) / np.ptp(self.pixel, axis=0)
        cell = np.minimum((_BLOCKS * position).astype(int), _BLOCKS - 1)
        block = cell[:, 0] * _BLOCKS + cell[:, 1]
        kept = np.where(weight >= 1.0, 1.0, 0.0)
        count = np.maximum(np.bincount(block, kept, _BLOCKS**2), 1e-9)
        total = np.stack([np.bincount(block, kept * left[:, i], _BLOCKS**2) for i in (0, 1)])
        blocks = float(np.sqrt(np.mean((total**2 / count)[:, count > 0.5])))
        nodes = float(np.sqrt((kept[:, None] * left**2).sum() / (2 * max(kept.sum(), 1.0))))
        found = max(blocks, nodes)
        return found if found > _NOTABLE else 1.0


def well_inside(rig: Rig, pixel: Float) -> Mask:
    """(...) whether camera pixels (..., 2) look at the mirror at least MARGIN_MM from its borders."""
    optics = UnboundedOptics(rig)
    point = mirror_point(optics, pixel[..., 0], pixel[..., 1])
    x, y = point[..., 0], np.abs(point[..., 1])
    with np.errstate(invalid="ignore"):
        inside = (x > MARGIN_MM) & (x < optics.length_mm - MARGIN_MM)
        return np.asarray(inside & (y < optics.prism.half_width_mm - MARGIN_MM))


def off_seams(rig: Rig, pixel: Float) -> Mask:
    """(...) whether camera pixels (..., 2) look well inside a tooth of a saw; all do of a prism."""
    if rig.prism.teeth is None:
        return np.ones(pixel.shape[:-1], bool)
    away_px, pitch_px = tooth_phase(rig, pixel[..., 0], pixel[..., 1])
    return np.asarray(np.abs(away_px) > _SEAM_SHARE * pitch_px)


@dataclass(frozen=True, eq=False)
class MirrorEdge(PixelsOnLine):
    """An edge of the mirror seen in the image.

    edge: "P0" or "R0". pixel: (m, 2) camera px on the edge's image (one to three; their errors count as
    independent). sigma_px: camera px. The numbers are distances from the edge's image, camera px, positive
    towards larger x on the mirror.
    """

    edge: Literal["P0", "R0"]
    pixel: Float
    sigma_px: float
    blind_to: ClassVar[frozenset[str]] = frozenset(
        {"display.along_mm", "display.across_mm", "display.turn_deg", "gap_mm"}
    )

    @property
    def name(self) -> str:
        """Which edge."""
        return f"edge {self.edge}"

    def predict(self, rig: Rig) -> Float:
        """(m,) camera px from the edge's image, to first order."""
        optics = UnboundedOptics(rig)
        u, v = self.pixel.T
        at_mm = 0.0 if self.edge == "P0" else optics.length_mm
        du, dv = (_STEP_PX * np.array(way)[:, None] for way in ((0, 1, -1, 0, 0), (0, 0, 0, 1, -1)))
        x = mirror_point(optics, u + du, v + dv)[..., 0]
        return np.asarray((x[0] - at_mm) * (2 * _STEP_PX) / np.hypot(x[1] - x[2], x[3] - x[4]))


@dataclass(frozen=True, eq=False)
class Direct(SingleNumbers):
    """A parameter measured by itself: the gap by feeler gauge, the LCD's distance from P0 by ruler, ...

    Raises InputError for an unknown parameter or a sigma that is not above 0.
    """

    parameter: str
    value: float
    sigma_value: float

    def __post_init__(self) -> None:
        if self.parameter not in PARAMETERS:
            raise InputError(f"{self.parameter}: not a parameter: one of {', '.join(PARAMETERS)}")
        if not self.sigma_value > 0.0:
            raise InputError(f"{self.parameter}: sigma {self.sigma_value}: a number above 0")

    @property
    def blind_to(self) -> frozenset[str]:
        """Every other parameter."""
        return frozenset(PARAMETERS) - {self.parameter}

    @property
    def name(self) -> str:
        """What was measured."""
        return PARAMETERS[self.parameter].words

    @property
    def measured(self) -> Float:
        """(1,) in the parameter's unit."""
        return np.array([self.value])

    @property
    def sigma(self) -> Float:
        """(1,) in the parameter's unit."""
        return np.array([self.sigma_value])

    def prepared(self, rig: Rig) -> Direct:
        """As it is. Raises InputError where the rig has no such parameter."""
        if self.parameter not in describe(rig):
            raise InputError(f"{rig.name}: {self.parameter}: this rig has none")
        return self

    def predict(self, rig: Rig) -> Float:
        """(1,) in the parameter's unit."""
        return np.array([describe(rig)[self.parameter]])


INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, eq=False)
class Intrinsics(SingleNumbers):
    """A camera calibrated by itself (ChArUco board): values and full covariance, in OpenCV's order and units.

    names: which of `INTRINSICS`. values: (n,). covariance: (n, n), positive definite. The numbers are the
    values in the covariance's own axes, so that their errors are independent, of sigma 1.
    """

    names: Sequence[str]
    values: Float
    covariance: Float
    name: ClassVar[str] = "camera intrinsics"
    blind_to: ClassVar[frozenset[str]] = frozenset(n for n in PARAMETERS if not n.startswith("camera."))
    _whiten: Float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        unknown = [name for name in self.names if name not in INTRINSICS]
        if unknown or len(self.names) != len(self.values):
            raise InputError(f"intrinsics: {list(self.names)}: one value for each of some of {INTRINSICS}")
        try:
            lower = np.linalg.cholesky(np.asarray(self.covariance, dtype=np.float64))
        except np.linalg.LinAlgError:
            raise InputError("intrinsics: covariance: must be symmetric and positive definite") from None
        object.__setattr__(self, "_whiten", np.linalg.inv(lower))

    @classmethod
    def of(cls, names: Sequence[str], values: Float, sigma: Float, correlation: Float) -> Intrinsics:
        """From sigma (n,) and correlation (n, n), as files have them."""
        return cls(names, values, correlation * np.outer(sigma, sigma))

    @property
    def spread(self) -> Float:
        """(n,) standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Float:
        """(n, n) of the values."""
        return self.covariance / np.outer(self.spread, self.spread)

    @property
    def measured(self) -> Float:
        """(n,) whitened."""
        return np.asarray(self._whiten @ np.asarray(self.values, dtype=np.float64))

    @property
    def sigma(self) -> Float:
        """(n,) ones."""
        return np.ones(len(self.names))

    def prepared(self, rig: Rig) -> Intrinsics:
        """As it is. Raises InputError where the rig's camera is not a perspective one."""
        if rig.camera.projection != "perspective":
            raise InputError(f"{rig.name}: camera intrinsics: only for projection 'perspective'")
        return self

    def predict(self, rig: Rig) -> Float:
        """(n,) whitened."""
        camera = rig.camera
        assert camera.focal_px is not None
        known = dict(zip(INTRINSICS, (*camera.focal_px, *camera.centre_px, *camera.distortion), strict=True))
        return np.asarray(self._whiten @ np.array([known[name] for name in self.names]))
