"""Smooth continuation of a displacement into nodes that could not be measured.

A node drawn grey has no carrier and could never be measured again, so unmeasured nodes are drawn by
prediction from their neighbours. Both the displacement f and its gradient g are continued: g as a membrane
between the plane fits at the rim of the valid nodes, f by averaging its neighbours' linear predictions f_j +
(g_i + g_j)/2 . (x_i - x_j). That is exact for planes, needs no boundary condition (neighbours outside the
grid are left out), and every step is a mean and thus stable; g fades over `REACH_NODES`, so that f stays
bounded too. A pyramid of 2 x 2 means carries values across large gaps, a few sweeps per level smooth them.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Float, Mask
from zeromethod.kernels import kernel, piece, read

REACH_NODES = 40.0
"""Distance over which a continued gradient fades, so f moves by about slope x this at most."""

RIM_RADIUS = 2
"""The rim's gradient is fitted over (2 r + 1)^2 nodes: 5 x 5 halves the noise of three-node slopes."""

LEAST_SPREAD = 2.0
"""Smallest principal moment (nodes^2) of the fitted nodes for which a gradient is used."""

SWEEPS = 3

_F, _X, _G = 0, 2, 4  # a cell: f (2), position (2), gradient of f_0 (2) and f_1 (2)
_SIZE = 8


@piece
def _fit_gradient(field: Float, valid: Mask, j: int, i: int, cell: Float) -> None:
    """Least-squares plane through the valid nodes around (j, i); gradient 0 where they are too few."""
    rows, cols = valid.shape
    n = sx = sy = sxx = sxy = syy = 0.0
    f0 = f1 = xf0 = xf1 = yf0 = yf1 = 0.0
    for b in range(max(0, j - RIM_RADIUS), min(rows, j + RIM_RADIUS + 1)):
        for a in range(max(0, i - RIM_RADIUS), min(cols, i + RIM_RADIUS + 1)):
            if valid[b, a]:
                x, y = float(a - i), float(b - j)
                v0 = field[b, a, 0] - field[j, i, 0]
                v1 = field[b, a, 1] - field[j, i, 1]
                n, sx, sy = n + 1.0, sx + x, sy + y
                sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
                f0, xf0, yf0 = f0 + v0, xf0 + x * v0, yf0 + y * v0
                f1, xf1, yf1 = f1 + v1, xf1 + x * v1, yf1 + y * v1
    mx, my = sx / n, sy / n
    cxx, cxy, cyy = sxx - mx * sx, sxy - mx * sy, syy - my * sy
    least = 0.5 * (cxx + cyy) - math.hypot(0.5 * (cxx - cyy), cxy)
    for k in range(_G, _SIZE):
        cell[k] = 0.0
    if least >= LEAST_SPREAD:
        inverse = 1.0 / (cxx * cyy - cxy * cxy)
        x0, y0 = xf0 - mx * f0, yf0 - my * f0
        x1, y1 = xf1 - mx * f1, yf1 - my * f1
        cell[_G] = inverse * (cyy * x0 - cxy * y0)
        cell[_G + 1] = inverse * (cxx * y0 - cxy * x0)
        cell[_G + 2] = inverse * (cyy * x1 - cxy * y1)
        cell[_G + 3] = inverse * (cxx * y1 - cxy * x1)


@kernel(read(numba.float64, 3), read(numba.boolean, 2), numba.float64[:, :, ::1], numba.uint8[:, ::1])
def _finest(field: Float, valid: Mask, cells: Float, known: Bytes) -> None:
    """Cells of the node level. known: 0 unknown, 1 value, 2 value and gradient."""
    rows, cols = valid.shape
    for j in range(rows):
        for i in range(cols):
            known[j, i] = valid[j, i]
            cells[j, i, _X], cells[j, i, _X + 1] = i, j
            cells[j, i, _F], cells[j, i, _F + 1] = field[j, i, 0], field[j, i, 1]
    for j in range(rows):
        for i in range(cols):
            if not valid[j, i]:
                for b in range(max(0, j - 1), min(rows, j + 2)):
                    for a in range(max(0, i - 1), min(cols, i + 2)):
                        if known[b, a] == 1:
                            known[b, a] = 2
                            _fit_gradient(field, valid, b, a, cells[b, a])


@kernel(
    read(numba.float64, 3), read(numba.uint8, 2), numba.float64,
    numba.float64[:, :, ::1], numba.uint8[:, ::1],
)  # fmt: skip
def _coarser(fine: Float, known: Bytes, step: float, cells: Float, above: Bytes) -> None:
    """Means of 2 x 2 known cells, of the level above; step: nodes between its cells."""
    for j in range(above.shape[0]):
        for i in range(above.shape[1]):
            cell, values, gradients = cells[j, i], 0, 0
            for k in range(_SIZE):
                cell[k] = 0.0
            for b in range(2 * j, min(2 * j + 2, known.shape[0])):
                for a in range(2 * i, min(2 * i + 2, known.shape[1])):
                    if known[b, a] > 0:
                        values += 1
                        for k in range(_G):
                            cell[k] += fine[b, a, k]
                    if known[b, a] > 1:
                        gradients += 1
                        for k in range(_G, _SIZE):
                            cell[k] += fine[b, a, k]
            for k in range(_G):
                cell[k] *= 1.0 / max(values, 1)
                cell[_G + k] *= 1.0 / max(gradients, 1)
            if values == 0:
                cell[_X], cell[_X + 1] = (i + 0.5) * step - 0.5, (j + 0.5) * step - 0.5
            above[j, i] = min(values, 1) + min(gradients, 1)


@piece
def _predict(cell: Float, source: Float, share: float) -> tuple[float, float]:
    """Value at `cell` from `source`, with gradient share x source's + (1 - share) x cell's own."""
    dx, dy = cell[_X] - source[_X], cell[_X + 1] - source[_X + 1]
    own = 1.0 - share
    return (
        source[_F]
        + (share * source[_G] + own * cell[_G]) * dx
        + (share * source[_G + 1] + own * cell[_G + 1]) * dy,
        source[_F + 1]
        + (share * source[_G + 2] + own * cell[_G + 2]) * dx
        + (share * source[_G + 3] + own * cell[_G + 3]) * dy,
    )


@piece
def _relax(flat: Float, todo: NDArray[np.int32], count: int, fade: float) -> None:
    """Sweeps over the unknown cells, forwards and backwards in turn: first g, then f."""
    for stage in range(2):
        for sweep in range(SWEEPS):
            for n in range(count):
                row = todo[np.uintp(n if sweep % 2 == 0 else count - 1 - n)]
                cell = flat[np.uintp(row[0])]
                s0 = s1 = s2 = s3 = neighbours = 0.0
                for side in range(1, 5):
                    if row[side] < 0:
                        continue
                    # unsigned, as each index that may be negative is checked for that
                    near = flat[np.uintp(row[side])]
                    neighbours += 1.0
                    if stage == 0:
                        s0, s1 = s0 + near[_G], s1 + near[_G + 1]
                        s2, s3 = s2 + near[_G + 2], s3 + near[_G + 3]
                    else:
                        p0, p1 = _predict(cell, near, 0.5)
                        s0, s1 = s0 + p0, s1 + p1
                if stage == 0:
                    weight = fade / neighbours
                    cell[_G], cell[_G + 1] = weight * s0, weight * s1
                    cell[_G + 2], cell[_G + 3] = weight * s2, weight * s3
                else:
                    cell[_F], cell[_F + 1] = s0 / neighbours, s1 / neighbours


@kernel(
    numba.float64[:, ::1], read(numba.uint8, 2), read(numba.float64, 2), numba.float64, numba.int32[:, ::1]
)
def _fill(flat: Float, known: Bytes, parents: Float, fade: float, todo: NDArray[np.int32]) -> None:
    """Unknown cells from the completed level above, then smoothed.

    flat: (cells, _SIZE), parents: those of the level above. todo: (cells, 5) to be filled with the number of
    each unknown cell and of its neighbours, -1 beyond the grid.
    """
    rows, cols = known.shape
    count = 0
    for j in range(rows):
        for i in range(cols):
            if known[j, i] == 0:
                here = j * cols + i
                cell, parent = flat[here], parents[j // 2 * ((cols + 1) // 2) + i // 2]
                for k in range(_G, _SIZE):
                    cell[k] = parent[k]
                cell[_F], cell[_F + 1] = _predict(cell, parent, 1.0)
                todo[count, 0] = here
                todo[count, 1] = here - cols if j > 0 else -1
                todo[count, 2] = here + cols if j < rows - 1 else -1
                todo[count, 3] = here - 1 if i > 0 else -1
                todo[count, 4] = here + 1 if i < cols - 1 else -1
                count += 1
    _relax(flat, todo, count, fade)


def _cells(rows: int, cols: int) -> tuple[Float, Bytes]:
    """Cells of a level, and which are known, still empty."""
    return np.empty((rows, cols, _SIZE)), np.empty((rows, cols), np.uint8)


def continued(values: Float, x: Float, y: Float) -> Float:
    """Values (rows, cols, 2) with NaN replaced by a plane through the others and what they differ from it.

    x, y: (rows, cols) coordinates of the plane. The difference is continued smoothly.
    """
    known: Mask = np.asarray(np.isfinite(values).all(axis=-1))
    plane = np.stack([np.ones_like(x), x, y], axis=-1)
    affine = plane @ np.linalg.lstsq(plane[known], values[known], rcond=None)[0]
    whole = affine + continue_smoothly(np.where(known[..., None], values - affine, 0.0), known)
    return np.where(known[..., None], values, whole)


def continue_smoothly(field: Float, valid: Mask, out: Float | None = None) -> Float:
    """Displacement with its invalid nodes filled by a smooth continuation of value and gradient.

    field: (rows, cols, 2), any unit, finite where `valid` (rows, cols). Valid nodes are returned bit for
    bit; the values of invalid ones (NaN too) have no influence. Zeros when nothing is valid. `out` may be
    `field`.
    """
    if out is None:
        out = np.empty_like(field)
    known = int(np.count_nonzero(valid))
    if known in (0, valid.size):
        out[:] = field if known else 0.0
    else:
        # the cells of valid nodes keep their values
        out[:] = _completed(field, valid, valid.size - known)[..., _F : _F + 2]
    return out


def _completed(field: Float, valid: Mask, count: int) -> Float:
    """Finest cells (rows, cols, _SIZE) of a pyramid; count: how many nodes are not valid."""
    levels = [_cells(*valid.shape)]
    _finest(field, valid, *levels[0])
    while not levels[-1][1].all():
        rows, cols = levels[-1][1].shape
        levels.append(_cells((rows + 1) // 2, (cols + 1) // 2))
        _coarser(*levels[-2], 2.0 ** (len(levels) - 1), *levels[-1])
    todo = np.empty((count, 5), np.int32)
    for n in range(len(levels) - 2, -1, -1):
        (cells, known), (parents, _) = levels[n : n + 2]
        fade = 1.0 / (1.0 + 0.25 * (2.0**n / REACH_NODES) ** 2)
        _fill(cells.reshape(-1, _SIZE), known, parents.reshape(-1, _SIZE), fade, todo)
    return levels[0][0]
