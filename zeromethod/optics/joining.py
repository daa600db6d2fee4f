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
from zeromethod.kernels import kernel, piece, read
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


@piece
def _offsets(point: Float, q: Float, start: int, size: int, frame: Float, inner_mm: float, s: Float) -> None:
    """Into the block `s`: way to the LCD across the slabs' normal, thickness of the first and last slab."""
    ox, oy, oz = frame[0, 0], frame[0, 1], frame[0, 2]
    cx, cy, cz = frame[1, 0], frame[1, 1], frame[1, 2]
    rx, ry, rz = frame[2, 0], frame[2, 1], frame[2, 2]
    nx, ny, nz = frame[3, 0], frame[3, 1], frame[3, 2]
    ex, ey, ez = frame[4, 0], frame[4, 1], frame[4, 2]
    x_mm, y_mm, z_mm, us, vs = (
        point[0, start:],
        point[1, start:],
        point[2, start:],
        q[0, start:],
        q[1, start:],
    )
    for i in range(size):
        px, py, pz, u, v = x_mm[i], y_mm[i], z_mm[i], us[i], vs[i]
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


@piece
def _solve(indices: Float, thicknesses: Float, least: float, size: int, s: Float) -> None:
    """Into `_W`, tangents by Newton's steps from below the root; `_STEP` is NaN where they did not settle.

    They begin with the tangent of small angles, or of grazing rays where that is larger.
    """
    count = len(indices)
    for i in range(size):
        s[_VALUE + i], s[_GAIN + i], s[_STEP + i] = 0.0, 0.0, 0.0
    for k in range(count):
        n = indices[k]
        b = n * n - least * least
        share = least / n
        steep = least / np.sqrt(b) if b > 0.0 else 0.0
        level = 0.0 if b > 0.0 else 1.0
        row, varies = _FIRST if k == 0 else _LAST, k == 0 or k == count - 1
        for i in range(size):
            t = s[row + i] if varies else thicknesses[k]
            s[_VALUE + i] += share * t
            s[_GAIN + i] += steep * t
            s[_STEP + i] += level * t
    for i in range(size):
        w, grazing = s[_SHIFT + i] / s[_VALUE + i], (s[_SHIFT + i] - s[_GAIN + i]) / s[_STEP + i]
        s[_W + i] = grazing if grazing > w else w
    for _ in range(_ITERATIONS):
        for i in range(size):
            s[_VALUE + i], s[_GAIN + i] = 0.0, 0.0
        for k in range(count):
            a = indices[k] * indices[k]
            b = a - least * least
            row, varies = _FIRST if k == 0 else _LAST, k == 0 or k == count - 1
            for i in range(size):
                t = s[row + i] if varies else thicknesses[k]
                w = s[_W + i]
                per = 1.0 / np.sqrt(a + b * w * w)
                part = t * per
                s[_VALUE + i] += part
                s[_GAIN + i] += a * part * per * per
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


@kernel(
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 1),
    read(numba.float64, 1),
    numba.float64,
    numba.float64,
    numba.float64[::1],
    numba.float64[:, ::1],
    numba.float64[:, ::1],
)
def _add_slopes(
    direction: Float,
    point: Float,
    q: Float,
    way: Float,
    frame: Float,
    indices: Float,
    thicknesses: Float,
    least: float,
    inner_mm: float,
    s: Float,
    slope: Float,
    rate: Float,
) -> None:
    """Bisect rays and their ways on; what that changes by as the points move.

    least: of the indices. inner_mm: of all slabs but the first and last. s: room for a block.
    """
    nx, ny, nz = frame[3, 0], frame[3, 1], frame[3, 2]
    first = indices[0]
    b = first * first - least * least
    for start in range(0, direction.shape[1], _BLOCK):
        size = min(_BLOCK, direction.shape[1] - start)
        _offsets(point, q, start, size, frame, inner_mm, s)
        _solve(indices, thicknesses, least, size, s)
        to_x, to_y, to_z = direction[0, start:], direction[1, start:], direction[2, start:]
        way_x, way_y, way_z = way[0, start:], way[1, start:], way[2, start:]
        slope_x, slope_y, rate_x, rate_y = (
            slope[0, start:],
            slope[1, start:],
            rate[0, start:],
            rate[1, start:],
        )
        for i in range(size):
            w, shift = s[_W + i] + s[_STEP + i], s[_SHIFT + i]
            flat, bent = 1.0 / np.sqrt(1.0 + w * w), 1.0 / np.sqrt(first * first + b * w * w)
            sine, cosine = least * w * flat / first, flat / (first * bent)
            per = 1.0 / shift if shift > 0.0 else 0.0 * w
            x, y, z = s[_X + i] * per, s[_Y + i] * per, s[_Z + i] * per
            bx = to_x[i] - sine * x - cosine * nx
            by = to_y[i] - sine * y - cosine * ny
            bz = to_z[i] - sine * z - cosine * nz
            slope_x[i] += bx / bz
            slope_y[i] += by / bz
            # a point that moves has a shorter way through the first slab, and another one across
            mx, my, mz = way_x[i], way_y[i], way_z[i]
            along = mx * nx + my * ny + mz * nz
            mx, my, mz = mx - along * nx, my - along * ny, mz - along * nz
            nearer = mx * x + my * y + mz * z
            turn = (along * least * w * bent - nearer) / (least * s[_GAIN + i])
            steeper, across = turn * least * flat * flat * flat / first, sine * per
            shorter = steeper * sine / cosine
            dx = steeper * x - across * (mx - nearer * x) - shorter * nx
            dy = steeper * y - across * (my - nearer * y) - shorter * ny
            dz = steeper * z - across * (mz - nearer * z) - shorter * nz
            rate_x[i] += (bx / bz * dz - dx) / bz
            rate_y[i] += (by / bz * dz - dy) / bz


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

    def add_slope(
        self, direction: Float, point: Float, q: Float, way: Float, slope: Float, rate: Float
    ) -> None:
        """Add to `slope` (2, n) the slope against z = const that sends rays on to LCD positions.

        And to `rate` (2, n) what it changes by as the points move along their `way` (3, n). direction, point:
        (3, n) in the rubber and mm, q: (2, n) LCD px. NaN where no ray joins the two.
        """
        slabs = (
            self.frame,
            self.indices,
            self.thicknesses_mm,
            self.indices.min(),
            self.thicknesses_mm[1:-1].sum(),
        )
        _add_slopes(direction, point, q, way, *slabs, np.empty(_ROWS * _BLOCK), slope, rate)
