"""What a zero leaves open of depth: rig errors that explain what it put away as well as an LCD that slid.

A zero subtracts the rest's displacement, which is exact for an LCD that slid in its plane. The same
displacement may come from a camera that stands elsewhere, a wrong index or angle: then the lever is wrong,
and depth with it. Each parameter of `[priors]` is tried by itself, beside an LCD that slid and turned: how
much of the displacement may be its doing, but no more than its prior or the displacement allows. What
parameters do to depth follows from the rays alone, in milliseconds: the mirror is read meanwhile.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.depth_modes import SIGMA_PX, DepthError
from zeromethod.calibration.fitting import jacobian
from zeromethod.calibration.measurements import RestPositions, off_seams, well_inside
from zeromethod.calibration.parameters import Priors
from zeromethod.calibration.rays import UnboundedOptics, mirror_point
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

_NODES = 400
"""Nodes that are looked at, about: more would count as independent that share a window."""
_STEP = 0.05
"""Of differences, in prior sigmas: depth is linear in them to 1 %."""
_PLACES = 60
"""Nodes at which depth's error is worked out, about: six terms in x and y are fitted to it."""
_ALIKE = 1e-12
"""Square of a pattern's share of the largest from which it is rounding."""
_SLIDES = "display.along_mm", "display.across_mm", "display.turn_deg"
"""Motion of the LCD that a zero takes out exactly."""


class LeftOpen:
    """What zeros of a rig leave open; rest: the rig's."""

    def __init__(self, rig: Rig, rest: Rest) -> None:
        self._priors = Priors.of(rig)
        pixel = np.stack(rest.grid.mesh(), axis=-1).reshape(-1, 2)
        kept = np.flatnonzero(rest.visible)
        kept = kept[:: max(1, len(kept) // _NODES)]
        self._nodes = kept[well_inside(rig, pixel[kept]) & off_seams(rig, pixel[kept])]
        q = rest.q.reshape(-1, 2)[self._nodes]
        self._data = RestPositions(pixel[self._nodes], q, np.full_like(q, SIGMA_PX)).prepared(rig)

    @cached_property
    def _shifts(self) -> Float:
        """(2 nodes, parameters) by which a prior sigma of each moves the rest, LCD px."""
        none = np.zeros(len(self._priors.names))
        return np.nan_to_num(jacobian(self._priors, none, self._data) * SIGMA_PX)

    @cached_property
    def _gram(self) -> tuple[Float, Float]:
        """Products (parameters, parameters) of the shifts, LCD px^2, and their inverse."""
        gram = self._shifts.T @ self._shifts
        return gram, np.asarray(np.linalg.pinv(gram, rcond=_ALIKE, hermitian=True), np.float64)

    @cached_property
    def _unit(self) -> DepthError:
        """Error of depth, and of places, per prior sigma of each parameter."""
        few = slice(None, None, max(1, len(self._nodes) // _PLACES))
        pixel, teeth = self._data.pixel[few], self._data.teeth
        teeth = None if teeth is None else (teeth[0][few], teeth[1][few])
        u, v = pixel.T

        def rays(rig: Rig) -> tuple[Float, Float, Float]:
            optics = UnboundedOptics(rig, teeth)
            beside = ((0.5, 0.0), (0.0, 0.5))
            steps = [
                mirror_point(optics, u + a, v + b) - mirror_point(optics, u - a, v - b) for a, b in beside
            ]
            return mirror_point(optics, u, v), np.stack(steps, axis=-2), optics.sensitivity(u, v)

        point, step, lever = rays(self._priors.rig)
        inverse = np.linalg.inv(lever)
        depth, place = [], []
        for own in np.eye(len(self._priors.names)):
            point_k, step_k, lever_k = rays(self._priors.at(_STEP * own))
            # steps of depth from pixel to pixel as read, of those that are, alike along both axes
            ratio = step @ inverse @ lever_k @ np.linalg.inv(step_k)
            depth.append((0.5 * np.trace(ratio, axis1=-2, axis2=-1) - 1.0) / _STEP)
            place.append((point_k - point) / _STEP)
        known = np.isfinite(depth).all(axis=0) & np.isfinite(place).all(axis=(0, 2))
        x, y = point[known].T
        names, none = ("",) * len(x), np.zeros((len(depth), len(depth)))
        return DepthError(names, x, y, np.array(depth).T[known], none, np.array(place).T[:, known])

    def geometry(self, zero: Float) -> GeometrySpec:
        """Modes that are open after a zero (rows, cols, 2), LCD px."""
        names, nodes = self._priors.names, len(self._nodes)
        gram, inverse = self._gram
        pulls = self._shifts.T @ zero.reshape(-1, 2)[self._nodes].ravel()
        # of the zero only what parameters can make: noise of single nodes is no error of a rig
        seen = np.sqrt(max(float(pulls @ inverse @ pulls), 0.0) / nodes)
        size = np.sqrt(np.diag(gram) / nodes)
        most = np.minimum(1.0, seen / np.maximum(size, 1e-9))
        slides = [k for k, name in enumerate(names) if name in _SLIDES]
        open2 = np.zeros(len(names))
        for k in range(len(names)):
            terms, wide = [*slides, k], np.append(seen / size[slides], most[k]) / SIGMA_PX
            covariance = np.linalg.inv(np.eye(len(terms)) + gram[np.ix_(terms, terms)] * np.outer(wide, wide))
            mean = covariance @ (pulls[terms] * wide) / SIGMA_PX
            open2[k] = most[k] ** 2 * min(1.0, mean[-1] ** 2 + covariance[-1, -1])
        unit = self._unit
        left = DepthError(unit.names, unit.x_mm, unit.y_mm, unit.sensitivity, np.diag(open2), unit.place)
        return GeometrySpec(**left.modes)
