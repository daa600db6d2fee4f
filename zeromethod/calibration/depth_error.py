"""What the unknown part of the geometry does to depth: in percent, region by region.

A reference press in each region is read through rigs a little off the fitted one, as any measured press
would be; the posterior of the fit, carried through these derivatives, is the standard deviation that depth
owes to geometry alone. Noise, the anchor and the far field come on top, in `Surface.sigma_depth_mm`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.fit import Fit, jacobian
from zeromethod.calibration.presses import KnownPress, Presses, RestReading
from zeromethod.calibration.rays import UnboundedOptics
from zeromethod.errors import MeasurementError
from zeromethod.optics import Dented
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest_pixels import rest_pixels
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_X_SHARES, _Y_SHARES = (0.2, 0.5, 0.8), (0.25, 0.5, 0.75)
"""Where the regions' middles lie in what is seen of the mirror."""
_X_NAMES, _Y_NAMES = ("near P0", "middle", "near R0"), ("low y", "mid y", "high y")
_WIDTH_SHARE = 0.1
_MOST_SLOPE = 0.012
_SIGMA_PX = 0.02
_LEAST_NODES = 64


@dataclass(frozen=True, eq=False)
class DepthError:
    """Depth's dependence on the geometry.

    names: (regions,). x_mm, y_mm: (regions,) middles on the mirror. sensitivity: (regions, parameters)
    relative change of a press's depth per prior sigma of a parameter. covariance: the fit's, in these units.
    """

    names: tuple[str, ...]
    x_mm: Float
    y_mm: Float
    sensitivity: Float
    covariance: Float = field(repr=False)

    @property
    def percent(self) -> Float:
        """(regions,) standard deviation of depth, percent."""
        return self.percent_with(self.covariance)

    def percent_with(self, covariance: Float) -> Float:
        """(regions,) the same for another covariance (parameters, parameters) of z."""
        return _percent(self.sensitivity, covariance)

    def percent_at(self, x_mm: Float, y_mm: Float) -> Float:
        """(...) standard deviation of depth, percent, at mirror points: a quadratic fit of the regions."""
        coefficients = np.linalg.lstsq(_powers(self.x_mm, self.y_mm), self.sensitivity, rcond=None)[0]
        return _percent(_powers(x_mm, y_mm) @ coefficients, self.covariance)


def _percent(sensitivity: Float, covariance: Float) -> Float:
    return np.asarray(100.0 * np.sqrt(np.einsum("...i,ij,...j->...", sensitivity, covariance, sensitivity)))


def _powers(x: Float, y: Float) -> Float:
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def depth_error(fitted: Fit, grid: NodeGrid, reading: RestReading | None = None) -> DepthError:
    """Carry a fit's posterior to depth.

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
    sigma_mm = _WIDTH_SHARE * float(np.ptp(point[:, :2], axis=0).min())
    depth_mm = _MOST_SLOPE * sigma_mm * float(np.exp(0.5))
    names, presses = [], []
    for x_name, x_mm in zip(_X_NAMES, x, strict=True):
        for y_name, y_mm in zip(_Y_NAMES, y, strict=True):
            pad = Mirror((Dent(Shape.GAUSSIAN, float(x_mm), float(y_mm), depth_mm, sigma_mm),))
            seen = optics.trace(pixel[..., 0], pixel[..., 1], Dented(optics.rest, pad))
            flags = np.where(known & np.isfinite(seen.q[..., 0]), 0, int(Flag.NO_RAY)).astype(np.uint16)
            warp = Warp(seen.q, np.full(seen.q.shape, _SIGMA_PX), flags, 0)
            names.append(f"{x_name}, {y_name}")
            presses.append(KnownPress(names[-1], warp, depth_mm, depth_mm))
    data = Presses.of(chosen, presses).prepared(rig)
    relative = jacobian(fitted.priors, fitted.z, data) * data.sigma[:, None] / depth_mm
    x_all, y_all = np.repeat(x, len(y)), np.tile(y, len(x))
    return DepthError(tuple(names), x_all, y_all, relative, fitted.covariance)


def _between(values: Float, shares: tuple[float, ...]) -> Float:
    low, high = float(values.min()), float(values.max())
    return low + (high - low) * np.asarray(shares)
