"""What the unknown part of the geometry does to depth and to places on the mirror, region by region.

A reference press in each region is read through rigs a little off the fitted one, as any measured press
would be; the posterior of the fit, carried through these derivatives, is the standard deviation that the
peak's depth and place owe to geometry alone. As modes over the view it goes into the rig file, from where
every reading states it (`Surface.sigma_depth_mm`), with noise, the anchor and the far field on top.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.fitting import Fit, jacobian
from zeromethod.calibration.presses import KnownPress, Presses, RestReading
from zeromethod.calibration.rays import UnboundedOptics
from zeromethod.errors import MeasurementError
from zeromethod.optics import Dented
from zeromethod.rig.geometry import powers
from zeromethod.rig.model import Rig
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest_pixels import rest_pixels
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_X_SHARES, _Y_SHARES = (0.2, 0.5, 0.8), (0.25, 0.5, 0.75)
"""Where the regions' middles lie in what is seen of the mirror."""
_X_NAMES, _Y_NAMES = ("near P0", "middle", "near R0"), ("low y", "mid y", "high y")
_WIDTH_SHARE, _DEPTH_OVER_WIDTH = 0.07, 0.028
"""Width of the reference load over what is seen of the mirror; its depth over its width: 12 mrad at most."""
SIGMA_PX = 0.02
"""Standard deviation of a node of a rest map, LCD px."""
_LEAST_NODES = 64
_LEFT_OUT = 1e-3
"""Share of the variance, of depth and place alike, that the modes left out may have together."""


@dataclass(frozen=True, eq=False)
class DepthError:
    """Depth's dependence on the geometry.

    names: (regions,). x_mm, y_mm: (regions,) middles on the mirror. sensitivity: (regions, parameters)
    relative change of a press's depth per prior sigma of a parameter. covariance: the fit's, in these units.
    place: (2, regions, parameters) change of the peak's x and y, mm, likewise.
    """

    names: tuple[str, ...]
    x_mm: Float
    y_mm: Float
    sensitivity: Float
    covariance: Float = field(repr=False)
    place: Float = field(repr=False)

    @property
    def percent(self) -> Float:
        """(regions,) standard deviation of depth, percent."""
        return self.percent_with(self.covariance)

    def percent_with(self, covariance: Float) -> Float:
        """(regions,) the same for another covariance (parameters, parameters) of z."""
        return 100.0 * _spread(self.sensitivity, covariance)

    @property
    def place_mm(self) -> Float:
        """(2, regions) standard deviation of the peak's x and y, mm."""
        return _spread(self.place, self.covariance)

    @property
    def modes(self) -> dict[str, Any]:
        """The same over the whole view, as keys of a rig's `GeometrySpec`.

        Derivatives are continued between the regions by a quadratic in x and y; the covariance is resolved
        into as few independent modes as hold nearly all of what depth and place have of it.
        """
        x_mm, y_mm = self.x_mm, self.y_mm
        centre_mm = float(np.mean(x_mm)), float(np.mean(y_mm))
        reach_mm = 0.5 * float(np.ptp(x_mm)), 0.5 * float(np.ptp(y_mm))
        one_each = np.concatenate([self.sensitivity[None], self.place])
        values, vectors = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        root = vectors * np.sqrt(np.maximum(values, 0.0))  # below 0 by rounding only
        terms = powers(x_mm, y_mm, centre_mm, reach_mm)
        carried = one_each @ root
        size = np.sqrt((carried**2).sum(axis=(1, 2), keepdims=True))
        _, spread, ways = np.linalg.svd((carried / np.where(size > 0.0, size, 1.0)).reshape(-1, len(root)))
        left = np.cumsum((spread**2)[::-1])[::-1] / max(float((spread**2).sum()), 1e-300)
        kept = ways[: int(np.count_nonzero(left > _LEFT_OUT / 3.0))]
        coefficients = np.linalg.lstsq(terms, np.moveaxis(carried @ kept.T, 1, 0).reshape(len(terms), -1))[0]
        depth, x, y = np.moveaxis(coefficients.reshape(6, 3, -1), 0, -1)
        found = {"centre_mm": centre_mm, "reach_mm": reach_mm, "depth": depth, "x_mm": x, "y_mm": y}
        return {key: _digits(one) for key, one in found.items()}


def _spread(sensitivity: Float, covariance: Float) -> Float:
    return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", sensitivity, covariance, sensitivity)))


def _digits(values: Any) -> Any:
    """Nested lists, to six digits."""
    return [_digits(one) for one in values] if np.ndim(values) else float(f"{values:.6g}")


@dataclass(frozen=True, eq=False)
class _Peaks:
    """Depth over the true one, x and y (mm) of presses as read through a rig, one kind after the other."""

    presses: Presses
    sigma: Float
    costly: ClassVar[bool] = True
    step: ClassVar[float] = Presses.step
    group: ClassVar[int] = 1
    name: ClassVar[str] = "peaks"

    @property
    def measured(self) -> Float:
        """(3 n,) as any measurement has it; only derivatives are asked for."""
        return np.zeros(len(self.sigma))

    @property
    def blind_to(self) -> frozenset[str]:
        """As the presses."""
        return self.presses.blind_to

    def prepared(self, rig: Rig) -> _Peaks:
        """With the presses prepared."""
        return _Peaks(self.presses.prepared(rig), self.sigma)

    def predict(self, rig: Rig) -> Float:
        """(3 n,) as read through `rig`."""
        peaks = self.presses.peaks(rig, with_sigma=False)
        depth = np.array([peak.depth_mm for peak in peaks]) / self.presses.measured
        return np.concatenate([depth, [peak.x_mm for peak in peaks], [peak.y_mm for peak in peaks]])


def depth_error(fitted: Fit, grid: NodeGrid, reading: RestReading | None = None) -> DepthError:
    """Carry a fit's posterior to depth and place.

    reading: the measured rest that presses will be read on; without one the fitted rig's own rest is taken.

    Raises
    ------
    MeasurementError
        Too little of the mirror is seen.
    """
    rig = fitted.rig
    optics = UnboundedOptics(rig)
    nodes = np.stack(grid.mesh(), axis=-1)
    if reading is None:
        q_rest = optics.rest_map(nodes[..., 0], nodes[..., 1])
        outside = np.ones(grid.shape, bool)
        outside[grid.inner] = False
        reading = RestReading(grid, np.where(outside[..., None], np.nan, q_rest))
    chosen = reading.prepared(rig)
    known = np.isfinite(chosen.q_rest).all(axis=-1)
    if np.count_nonzero(known) < _LEAST_NODES:
        raise MeasurementError("depth error: too little of the mirror is seen at rest")
    pixel = rest_pixels(optics, nodes, chosen.q_rest)
    point = optics.trace(pixel[..., 0], pixel[..., 1], optics.rest).point[known]
    x, y = (_between(point[:, axis], shares) for axis, shares in ((0, _X_SHARES), (1, _Y_SHARES)))
    width_mm = _WIDTH_SHARE * float(np.ptp(point[:, :2], axis=0).min())
    depth_mm = _DEPTH_OVER_WIDTH * width_mm
    names, presses = [], []
    for x_name, x_mm in zip(_X_NAMES, x, strict=True):
        for y_name, y_mm in zip(_Y_NAMES, y, strict=True):
            pad = Mirror((load(float(x_mm), float(y_mm), depth_mm, width_mm, rig.rubber),))
            seen = optics.trace(pixel[..., 0], pixel[..., 1], Dented(optics.rest, pad))
            flags = np.where(known & np.isfinite(seen.q[..., 0]), 0, int(Flag.NO_RAY)).astype(np.uint16)
            warp = Warp(seen.q, np.full(seen.q.shape, SIGMA_PX), flags, 0)
            names.append(f"{x_name}, {y_name}")
            presses.append(KnownPress(names[-1], warp, depth_mm, depth_mm))
    data = _Peaks(Presses.of(chosen, presses), np.ones(3 * len(presses))).prepared(rig)
    depth, *place = np.split(jacobian(fitted.priors, fitted.z, data), 3)
    x_all, y_all = np.repeat(x, len(y)), np.tile(y, len(x))
    return DepthError(tuple(names), x_all, y_all, depth, fitted.covariance, np.stack(place))


def _between(values: Float, shares: tuple[float, ...]) -> Float:
    low, high = float(values.min()), float(values.max())
    return low + (high - low) * np.asarray(shares)
