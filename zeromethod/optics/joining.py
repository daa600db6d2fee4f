"""Slopes that make rays from the camera meet LCD positions, in one compiled pass.

The same as `Optics.rubber_direction_to_lcd` and `Optics.normal_between`, node by node (`layers` has the
equation, and why Newton's steps converge). Nodes are taken in blocks, so that the processor works on several
at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.panel import Panel
from zeromethod.optics.prism import Face

_BLOCK = 64
_ITERATIONS = 100
_SETTLED = 1e-8
"""Step of tan(angle), over its square, below which the next one would be less than rounding."""
TOUCHES_MM = 1e-9
"""A panel that touches the slab before it may be this far on its wrong side by rounding."""

# rows of the scratch block
_X, _Y, _Z, _SHIFT, _FIRST, _LAST, _W, _VALUE, _GAIN, _STEP = (_BLOCK * k for k in range(10))
_ROWS = 10


@numba.njit(cache=True, error_model="numpy")
def _offsets(point: Float, q: Float, frame: Float, inner_mm: float, s: Float) -> None:
    """Into the block `s`: way to the LCD across the slabs' normal, thickness of the first and last slab."""
    ox, oy, oz = frame[0]
    cx, cy, cz = frame[1]
    rx, ry, rz = frame[2]
    nx, ny, nz = frame[3]
    ex, ey, ez = frame[4]
    for i in range(point.shape[1]):
        px, py, pz = point[0, i], point[1, i], point[2, i]
        u, v = q[0, i], q[1, i]
        x, y, z = ox + u * cx + v * rx - px, oy + u * cy + v * ry - py, oz + u * cz + v * rz - pz
        along = x * nx + y * ny + z * nz
        rubber = (ex - px) * nx + (ey - py) * ny + (ez - pz) * nz
        last = along - rubber - inner_mm
        last = 0.0 if abs(last) < TOUCHES_MM else last
        x, y, z = x - along * nx, y - along * ny, z - along * nz
        known = rubber >= 0.0 and last >= 0.0
        s[_X + i], s[_Y + i], s[_Z + i] = x, y, z
        s[_SHIFT + i] = np.sqrt(x * x + y * y + z * z)
        s[_FIRST + i] = rubber if known else np.nan
        s[_LAST + i] = last if known else np.nan


@numba.njit(cache=True, error_model="numpy")
def _begin(indices: Float, thicknesses: Float, size: int, s: Float) -> None:
    """Tangents below the root: that of small angles, or that of grazing rays where it is larger."""
    least = indices.min()
    for i in range(size):
        s[_VALUE + i], s[_GAIN + i], s[_STEP + i] = 0.0, 0.0, 0.0
    for k in range(len(indices)):
        n = indices[k]
        b = n * n - least * least
        share = least / n
        steep = least / np.sqrt(b) if b > 0.0 else 0.0
        level = 0.0 if b > 0.0 else 1.0
        row = _FIRST if k == 0 else _LAST
        varies = k == 0 or k == len(indices) - 1
        for i in range(size):
            t = s[row + i] if varies else thicknesses[k]
            s[_VALUE + i] += share * t
            s[_GAIN + i] += steep * t
            s[_STEP + i] += level * t
    for i in range(size):
        w = s[_SHIFT + i] / s[_VALUE + i]
        steep = (s[_SHIFT + i] - s[_GAIN + i]) / s[_STEP + i]
        s[_W + i] = steep if steep > w else w


@numba.njit(cache=True, error_model="numpy")
def _step(indices: Float, thicknesses: Float, size: int, s: Float) -> int:
    """One of Newton's steps; how many nodes it moved. What it left in `_STEP` is NaN where it did, else 0."""
    least = indices.min()
    for i in range(size):
        s[_VALUE + i] = 0.0
        s[_GAIN + i] = 0.0
    for k in range(len(indices)):
        a = indices[k] * indices[k]
        b = a - least * least
        row = _FIRST if k == 0 else _LAST
        varies = k == 0 or k == len(indices) - 1
        for i in range(size):
            t = s[row + i] if varies else thicknesses[k]
            w = s[_W + i]
            square = a + b * w * w
            part = t / np.sqrt(square)
            s[_VALUE + i] += part
            s[_GAIN + i] += a * part / square
    unsettled = 0
    for i in range(size):
        w = s[_W + i]
        step = (s[_SHIFT + i] - least * w * s[_VALUE + i]) / (least * s[_GAIN + i])
        w += step
        s[_W + i] = w
        far = abs(step) > _SETTLED * (1.0 + w) * (1.0 + w)
        s[_STEP + i] = np.nan if far else 0.0
        unsettled += far
    return unsettled


@numba.njit(cache=True, error_model="numpy")
def _add_slopes(direction: Float, normal: Float, indices: Float, s: Float, slope: Float) -> None:
    """Bisect rays and their ways on, which leave at tangents `_W`."""
    nx, ny, nz = normal
    least, first = indices.min(), indices[0]
    b = first * first - least * least
    for i in range(direction.shape[1]):
        w = s[_W + i] + s[_STEP + i]
        scale = 1.0 / (first * np.sqrt(1.0 + w * w))
        cosine = np.sqrt(first * first + b * w * w) * scale
        shift = s[_SHIFT + i]
        heading = least * w * scale / shift if shift > 0.0 else 0.0 * w
        bx = direction[0, i] - heading * s[_X + i] - cosine * nx
        by = direction[1, i] - heading * s[_Y + i] - cosine * ny
        bz = direction[2, i] - heading * s[_Z + i] - cosine * nz
        slope[0, i] += bx / bz
        slope[1, i] += by / bz


@numba.njit(cache=True, error_model="numpy")
def _slopes(
    direction: Float, point: Float, q: Float, frame: Float, indices: Float, thicknesses: Float, slope: Float
) -> None:
    s = np.empty(_ROWS * _BLOCK)
    inner_mm = thicknesses[1:-1].sum()
    for start in range(0, direction.shape[1], _BLOCK):
        part = slice(start, min(start + _BLOCK, direction.shape[1]))
        size = part.stop - part.start
        _offsets(point[:, part], q[:, part], frame, inner_mm, s)
        _begin(indices, thicknesses, size, s)
        for _ in range(_ITERATIONS):
            if _step(indices, thicknesses, size, s) == 0:
                break
        _add_slopes(direction[:, part], frame[3], indices, s, slope[:, part])


@dataclass(frozen=True)
class Joining:
    """The slabs between the mirror and the LCD of one rig.

    frame: (5, 3) LCD position (0, 0), steps of one column and one row, the face's normal and a point of it.
    indices, thicknesses_mm: of the slabs; that of the first depends on the point, the last ends at the LCD.
    """

    frame: Float
    indices: Float
    thicknesses_mm: Float

    @classmethod
    def of(cls, panel: Panel, face: Face, slabs: Sequence[tuple[float, float]], last_index: float) -> Joining:
        """slabs: (index, thickness in mm) from the rubber on, without the last."""
        column, row = panel.pitch_mm * panel.column, panel.pitch_mm * panel.row
        first = panel.lcd_to_world(np.zeros(2))
        frame = np.stack([first, column, row, face.normal, face.edge])
        indices = np.array([*(n for n, _ in slabs), last_index])
        return cls(frame, indices, np.array([*(t for _, t in slabs), 0.0]))

    def add_slope(self, direction: Float, point: Float, q: Float, slope: Float) -> None:
        """Add to `slope` (2, n) the slope against z = const that sends rays on to LCD positions.

        direction, point: (3, n) in the rubber and mm, q: (2, n) LCD px. NaN where no ray joins the two.
        """
        _slopes(direction, point, q, self.frame, self.indices, self.thicknesses_mm, slope)
