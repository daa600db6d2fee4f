"""Depth modes to what a person reads: the peak, and a map of slope and depth, with sigma."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter

from zeromethod.arrays import Float
from zeromethod.light_array.estimate import Model
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.optics import ArrayOptics
from zeromethod.light_array.rig import SIDE, LightArrayRig
from zeromethod.surface import Anchor, Peak, Surface

_STEP_MM = 1.0
"""Pitch on which the peak is looked for; between points it is a parabola's."""

_BY_NOISE = 4.5
"""Mean square over 3 x 3 detectors, in sigmas, that noise alone exceeds once in 100,000."""

_OPTICS = 0.004
"""Share of depth by which the optics may be off: a bent mirror widens what a detector sees, uncounted."""

_ALL = 1024
"""Modes that stand for every surface there may be."""


class DepthReader:
    """Reads modes of one rig. points_mm: (256, 2) where detectors look, rows along y, columns along x."""

    def __init__(self, rig: LightArrayRig, model: Model) -> None:
        modes = Modes.of(rig)
        # columns so that x rises
        order = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)[:, ::-1].ravel()
        self.points_mm = ArrayOptics.of(rig).mirror_mm[order, :2]
        self._fields = modes.derivatives(self.points_mm)[:3]
        low, high = self.points_mm.min(axis=0), self.points_mm.max(axis=0)
        counts = np.ceil((high - low) / _STEP_MM).astype(int) + 1
        self._x, self._y = (np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True))
        grid = np.stack([part.ravel() for part in np.meshgrid(self._x, self._y)], axis=1)
        self._grid = modes.depth(grid)
        # what the shortest third of the waves shows of a dent, longer and shorter waves show in proportion: a
        # dent as narrow as any expected has this much more in the waves that are left out
        count = len(modes.size_mm)
        size = Modes.of(rig, _ALL).size_mm
        self._short = slice(count - count // 3, count)
        # and what is left over in readings is light that waves left out have moved
        pattern, blur = rig.pattern, float(np.mean(model.blur))
        wave = 2 * np.pi / pattern.period_pitches
        flank = pattern.mean * pattern.contrast * wave * np.exp(-((wave * blur) ** 2) / 2) / np.sqrt(2)
        shift = np.sqrt(np.mean(model.by_mode[:, :, self._short] ** 2))
        depth = np.sqrt(np.mean(modes.depth(self.points_mm)[:, self._short] ** 2))
        self._seen_per_mm = float(np.sqrt(2) * flank * shift / depth / model.sigma)
        self._steepest = float(np.sqrt(np.max(np.sum(modes.wave**2, axis=0))))
        self._left_out = float(size[count:].sum() / size[self._short].sum())

    def depth_map(self, modes: Float) -> tuple[Float, Float, Float]:
        """Places x (n,), y (m,) and depth (m, n), mm, on points 1 mm apart."""
        return self._x, self._y, (self._grid @ modes).reshape(len(self._y), len(self._x))

    def depth_of(self, modes: Float) -> Float:
        """(k, n) depth of several readings (k, modes) at all points of `depth_map`."""
        return np.asarray(modes @ self._grid.T)

    def _strange_mm(self, left: Float) -> Float:
        """(256,) depth that may hide in what is left over around each point; left: (256,) in sigmas."""
        square = (left**2).reshape(SIDE, SIDE)[:, ::-1]
        excess = np.maximum(uniform_filter(square, 3).ravel() - _BY_NOISE, 0.0)
        return np.asarray(np.sqrt(excess) / self._seen_per_mm)

    def _sigma_mm(self, fields: Float, modes: Float, covariance: Float, strange: Float, frames: int) -> Float:
        """(n,) standard deviation of what fields (n, modes) read: noise, waves left out, what is strange."""
        count = fields.shape[-1]
        noise = np.sum((fields @ covariance[:count, :count]) * fields, axis=1) / frames
        left_out = self._left_out * (fields[:, self._short] @ modes[self._short])
        return np.asarray(np.sqrt(noise + left_out**2 + strange**2 + (_OPTICS * (fields @ modes)) ** 2))

    def peak(self, modes: Float, covariance: Float, left: Float, frames: int) -> Peak:
        """Point of largest |depth|."""
        x, y, depth = self.depth_map(modes)
        row, col = np.unravel_index(int(np.argmax(np.abs(depth))), depth.shape)
        top = depth[row, col]
        dx, raised_x = _parabola(depth[row], int(col))
        dy, raised_y = _parabola(depth[:, col], int(row))
        at = int(row) * len(x) + int(col)
        # wherever something is left over, a deeper peak may hide
        strange = self._strange_mm(left).max(keepdims=True)
        sigma = self._sigma_mm(self._grid[at : at + 1], modes, covariance, strange, frames)[0]
        return Peak(
            float(top + raised_x + raised_y),
            float(x[col] + dx * (x[1] - x[0])),
            float(y[row] + dy * (y[1] - y[0])),
            float(sigma),
        )

    def surface(self, modes: Float, covariance: Float, left: Float, frames: int, time_ns: int) -> Surface:
        """Map at the detectors' points, (16, 16)."""
        shape = (SIDE, SIDE)
        depth, by_x, by_y = (field @ modes for field in self._fields)
        strange = self._strange_mm(left)
        sigmas = [
            self._sigma_mm(field, modes, covariance, strange * per_mm, frames).reshape(shape)
            for field, per_mm in zip(self._fields, (1.0, self._steepest, self._steepest), strict=True)
        ]
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
    """Offset and rise of the summit of a parabola through three values around `at`; 0 at the ends."""
    if not 0 < at < len(values) - 1:
        return 0.0, 0.0
    left, middle, right = values[at - 1 : at + 2]
    bend = left - 2 * middle + right
    if bend == 0:
        return 0.0, 0.0
    off = 0.5 * (left - right) / bend
    return float(off), float(-((left - right) ** 2) / (8 * bend))
