"""Depth modes to what a person reads: the peak, and a map of slope and depth, with sigma."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.light_array.finer import Finer, FinerDents
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.optics import ArrayOptics
from zeromethod.light_array.rig import SIDE, LightArrayRig
from zeromethod.surface import Anchor, Peak, Surface

_STEP_MM = 1.0
"""Pitch of the points on which the peak is looked for; between them it is a parabola's."""

_ELSEWHERE = 8.0
"""A peak of so many sigmas of its noise is not mistaken for noise at another place."""

_OPTICS, _AT_BORDER, _BORDER_MM = 0.004, 0.02, 5.0
"""Standard deviation of depth that the optics leave open, as a share of the greatest depth: in the view, and
within so many mm of its border. A bent mirror widens what a detector sees, which the model leaves out, and
light from beyond the LEDs is known less well."""

_ALL = 1024
"""So many modes stand for every surface there may be."""


class DepthReader:
    """Reads modes of one rig. points_mm: (256, 2) where detectors look, row by row along y, x rising."""

    def __init__(self, rig: LightArrayRig, finer: FinerDents) -> None:
        self._finer = finer
        modes = Modes.of(rig)
        # along the camera face x falls
        order = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)[:, ::-1].ravel()
        self.points_mm = ArrayOptics.of(rig).mirror_mm[order, :2]
        self._fields = modes.derivatives(self.points_mm)[:3]
        low, high = self.points_mm.min(axis=0), self.points_mm.max(axis=0)
        counts = np.ceil((high - low) / _STEP_MM).astype(int) + 1
        self._x, self._y = (np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True))
        grid = np.stack([part.ravel() for part in np.meshgrid(self._x, self._y)], axis=1)
        self._grid = modes.derivatives(grid)[0]
        self._share, self._shares = self._optics(grid), self._optics(self.points_mm)
        # what the modes leave out of a dent is estimated from the shortest third of their waves: in the
        # narrowest dent expected, the waves left out have so many times its size
        count = len(modes.size_mm)
        size = Modes.of(rig, _ALL).size_mm
        self._short = slice(count - count // 3, count)
        self._left_out = float(size[count:].sum() / size[self._short].sum())

    def _optics(self, points_mm: Float) -> Float:
        """(n,) standard deviation that the optics leave open at points (n, 2), as a share of depth."""
        low, high = self.points_mm.min(axis=0), self.points_mm.max(axis=0)
        inside = np.minimum(points_mm - low, high - points_mm).min(axis=1)
        return np.where(inside < _BORDER_MM, _AT_BORDER, _OPTICS)

    def depth_map(self, modes: Float) -> tuple[Float, Float, Float]:
        """Places x (n,), y (m,) and depth (m, n), mm, on points 1 mm apart."""
        return self._x, self._y, (self._grid @ modes).reshape(len(self._y), len(self._x))

    def depth_of(self, modes: Float) -> Float:
        """(k, n) depth of several readings (k, modes) at all points of `depth_map`."""
        return np.asarray(modes @ self._grid.T)

    def _variances(
        self, fields: Float, share: Float, modes: Float, covariance: Float, frames: int
    ) -> tuple[Float, Float]:
        """(n,) variances of what fields (n, modes) read: by noise; by waves left out and the optics.

        share: (n,) see `_optics`. frames: how many the reading is the mean of.
        """
        count = fields.shape[-1]
        noise = np.sum((fields @ covariance[:count, :count]) * fields, axis=1) / frames
        left_out = self._left_out * (fields[:, self._short] @ modes[self._short])
        return noise, left_out**2 + (share * np.abs(fields @ modes)).max() ** 2

    def peak(self, modes: Float, covariance: Float, finer: Finer, frames: int) -> tuple[Peak, float]:
        """Point of largest |depth|, and the part of its sigma that noise makes, mm."""
        x, y, depth = self.depth_map(modes)
        row, col = np.unravel_index(int(np.argmax(np.abs(depth))), depth.shape)
        top = depth[row, col]
        dx, raised_x = _parabola(depth[row], int(col))
        dy, raised_y = _parabola(depth[:, col], int(row))
        at = int(row) * len(x) + int(col)
        here = slice(at, at + 1)
        parts = self._variances(self._grid[here], self._share[here], modes, covariance, frames)
        noise, more = (float(part[0]) for part in parts)
        if top**2 < _ELSEWHERE**2 * noise:  # the true peak may be elsewhere
            odds = np.exp((depth**2 - top**2) / (2 * noise))
            more += float(np.sum(odds * (depth - top) ** 2) / np.sum(odds))
        peak = Peak(
            float(top + raised_x + raised_y),
            float(x[col] + dx * (x[1] - x[0])),
            float(y[row] + dy * (y[1] - y[0])),
            float(np.sqrt(noise + more + finer.hidden_mm**2)),
        )
        return peak, float(np.sqrt(noise))

    def surface(self, modes: Float, covariance: Float, finer: Finer, frames: int, time_ns: int) -> Surface:
        """Map at the points where the detectors look, (16, 16)."""
        shape = (SIDE, SIDE)
        depth, by_x, by_y = (field @ modes for field in self._fields)
        sigmas = []
        missed = self._finer.hidden(finer, self.points_mm, self._fields)
        for field, hidden in zip(self._fields, missed, strict=True):
            noise, more = self._variances(field, self._shares, modes, covariance, frames)
            sigmas.append(np.sqrt(noise + more + hidden**2).reshape(shape))
        everywhere = np.ones(shape, bool)
        return Surface(
            depth_mm=depth.reshape(shape),
            slope=np.stack([by_x, by_y], axis=-1).reshape(*shape, 2),
            x_mm=self.points_mm[:, 0].reshape(shape).copy(),
            y_mm=self.points_mm[:, 1].reshape(shape).copy(),
            sigma_depth_mm=sigmas[0],
            sigma_slope=np.stack(sigmas[1:], axis=-1),
            valid=everywhere,
            contact=~everywhere,
            anchor=Anchor("known", ~everywhere, 0.0),
            time_ns=time_ns,
            iterations=1,
        )


def _parabola(values: Float, at: int) -> tuple[float, float]:
    """Offset, in points, and rise of the summit of a parabola through three values around `at`; 0 at ends."""
    if not 0 < at < len(values) - 1:
        return 0.0, 0.0
    left, middle, right = values[at - 1 : at + 2]
    bend = left - 2 * middle + right
    if bend == 0:
        return 0.0, 0.0
    off = 0.5 * (left - right) / bend
    return float(off), float(-((left - right) ** 2) / (8 * bend))
