"""Slopes that make rays from the camera meet LCD positions, in one compiled pass.

The same as `Optics.rubber_direction_to_lcd` and `Optics.normal_between`, node by node (`layers` has the
equation and why Newton's steps converge); nodes are taken in blocks, so that the processor works on several at
a time.
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
_SETTLED = 1e-9
"""Step of tan(angle), over its square, below which the next one would be less than rounding."""
TOUCHES_MM = 1e-9
"""A panel that touches the slab before it may be this far on its wrong side by rounding."""

# rows of the scratch block
_X, _Y, _Z, _SHIFT, _FIRST, _LAST, _W, _VALUE, _GAIN, _STEP = (_BLOCK * k for k in range(10))
_ROWS = 10


@numba.njit(cache=True, error_model="numpy")
def _slopes(
    direction: Float,
    point: Float,
    q: Float,
    frame: Float,
    indices: Float,
    thicknesses: Float,
    slope: Float,
) -> None:
    """direction, point: (3, n). q: (2, n). slope: (2, n), to which the turn of the normal is added.

    frame: (5, 3) LCD position (0, 0), its columns' and rows' steps, the face's normal and edge. thicknesses:
    mm of the slabs, of which the first's and the last's are found here.
    """
    s = np.empty(_ROWS * _BLOCK)
    count = len(indices)
    ox, oy, oz = frame[0]
    cx, cy, cz = frame[1]
    rx, ry, rz = frame[2]
    nx, ny, nz = frame[3]
    ex, ey, ez = frame[4]
    least = indices.min()
    inner = thicknesses[1:-1].sum()
    first = indices[0]
    b_first = first * first - least * least
    for start in range(0, direction.shape[1], _BLOCK):
        size = min(_BLOCK, direction.shape[1] - start)
        for i in range(size):
            px, py, pz = point[0, start + i], point[1, start + i], point[2, start + i]
            u, v = q[0, start + i], q[1, start + i]
            x, y, z = ox + u * cx + v * rx - px, oy + u * cy + v * ry - py, oz + u * cz + v * rz - pz
            along = x * nx + y * ny + z * nz
            rubber = (ex - px) * nx + (ey - py) * ny + (ez - pz) * nz
            last = along - rubber - inner
            last = 0.0 if abs(last) < TOUCHES_MM else last
            x, y, z = x - along * nx, y - along * ny, z - along * nz
            s[_X + i], s[_Y + i], s[_Z + i] = x, y, z
            s[_SHIFT + i] = np.sqrt(x * x + y * y + z * z)
            known = rubber >= 0.0 and last >= 0.0
            s[_FIRST + i] = rubber if known else np.nan
            s[_LAST + i] = last if known else np.nan
            s[_VALUE + i], s[_GAIN + i], s[_STEP + i] = 0.0, 0.0, 0.0
        for k in range(count):
            n = indices[k]
            b = n * n - least * least
            share = least / n
            steep = least / np.sqrt(b) if b > 0.0 else 0.0
            level = 0.0 if b > 0.0 else 1.0
            for i in range(size):
                t = thicknesses[k]
                if k == 0:
                    t = s[_FIRST + i]
                elif k == count - 1:
                    t = s[_LAST + i]
                s[_VALUE + i] += share * t
                s[_GAIN + i] += steep * t
                s[_STEP + i] += level * t
        for i in range(size):
            w = s[_SHIFT + i] / s[_VALUE + i]
            steep = (s[_SHIFT + i] - s[_GAIN + i]) / s[_STEP + i]
            s[_W + i] = steep if steep > w else w
        for _ in range(_ITERATIONS):
            for i in range(size):
                s[_VALUE + i] = 0.0
                s[_GAIN + i] = 0.0
            for k in range(count):
                a = indices[k] * indices[k]
                b = a - least * least
                for i in range(size):
                    t = thicknesses[k]
                    if k == 0:
                        t = s[_FIRST + i]
                    elif k == count - 1:
                        t = s[_LAST + i]
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
            if unsettled == 0:
                break
        for i in range(size):
            w = s[_W + i] + s[_STEP + i]
            scale = 1.0 / (first * np.sqrt(1.0 + w * w))
            cosine = np.sqrt(first * first + b_first * w * w) * scale
            shift = s[_SHIFT + i]
            heading = least * w * scale / shift if shift > 0.0 else 0.0 * w
            bx = direction[0, start + i] - heading * s[_X + i] - cosine * nx
            by = direction[1, start + i] - heading * s[_Y + i] - cosine * ny
            bz = direction[2, start + i] - heading * s[_Z + i] - cosine * nz
            slope[0, start + i] += bx / bz
            slope[1, start + i] += by / bz


@dataclass(frozen=True)
class Joining:
    """The slabs between the mirror and the LCD of one rig; see `Optics.joining`."""

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
