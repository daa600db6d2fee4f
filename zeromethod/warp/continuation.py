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

REACH_NODES = 40.0
"""Distance over which a continued gradient fades, so f moves by about slope x this at most."""

RIM_RADIUS = 2
"""The rim's gradient is fitted over (2 r + 1)^2 nodes: 5 x 5 halves the noise of three-node slopes."""

LEAST_SPREAD = 2.0
"""Smallest principal moment (nodes^2) of the fitted nodes for which a gradient is used."""

SWEEPS = 3

_F, _X, _G = 0, 2, 4  # a cell: f (2), position (2), gradient of f_0 (2) and f_1 (2)
_SIZE = 8


@numba.njit(cache=True, error_model="numpy")
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
                n += 1.0
                sx += x
                sy += y
                sxx += x * x
                sxy += x * y
                syy += y * y
                f0 += v0
                f1 += v1
                xf0 += x * v0
                xf1 += x * v1
                yf0 += y * v0
                yf1 += y * v1
    mx, my = sx / n, sy / n
    cxx, cxy, cyy = sxx - mx * sx, sxy - mx * sy, syy - my * sy
    least = 0.5 * (cxx + cyy) - math.hypot(0.5 * (cxx - cyy), cxy)
    cell[_G : _G + 4] = 0.0
    if least >= LEAST_SPREAD:
        inverse = 1.0 / (cxx * cyy - cxy * cxy)
        x0, y0 = xf0 - mx * f0, yf0 - my * f0
        x1, y1 = xf1 - mx * f1, yf1 - my * f1
        cell[_G] = inverse * (cyy * x0 - cxy * y0)
        cell[_G + 1] = inverse * (cxx * y0 - cxy * x0)
        cell[_G + 2] = inverse * (cyy * x1 - cxy * y1)
        cell[_G + 3] = inverse * (cxx * y1 - cxy * x1)


@numba.njit(cache=True, error_model="numpy")
def _finest(field: Float, valid: Mask, cells: Float, known: Bytes) -> None:
    """Cells of the node level. known: 0 unknown, 1 value, 2 value and gradient."""
    rows, cols = valid.shape
    for j in range(rows):
        for i in range(cols):
            known[j, i] = valid[j, i]
            cells[j, i, _X] = i
            cells[j, i, _X + 1] = j
            cells[j, i, _F] = field[j, i, 0]
            cells[j, i, _F + 1] = field[j, i, 1]
    for j in range(rows):
        for i in range(cols):
            if not valid[j, i]:
                for b in range(max(0, j - 1), min(rows, j + 2)):
                    for a in range(max(0, i - 1), min(cols, i + 2)):
                        if known[b, a] == 1:
                            known[b, a] = 2
                            _fit_gradient(field, valid, b, a, cells[b, a])


@numba.njit(cache=True, error_model="numpy", inline="always")
def _merge(fine: Float, known: Bytes, j: int, i: int, cell: Float) -> int:
    """Coarse cell (j, i) as the mean of its known fine cells; returns 0, 1 or 2 as in `_finest`."""
    cell[:] = 0.0
    values = gradients = 0
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
    share = 1.0 / max(values, 1)
    for k in range(_G):
        cell[k] *= share
    if gradients > 0:
        share = 1.0 / gradients
        for k in range(_G, _SIZE):
            cell[k] *= share
    return min(values, 1) + min(gradients, 1)


@numba.njit(cache=True, error_model="numpy")
def _coarser(fine: Float, known: Bytes, step: float, cells: Float, above: Bytes) -> bool:
    """Merge 2 x 2 cells into the level above; True when all cells there are known."""
    complete = True
    for j in range(above.shape[0]):
        for i in range(above.shape[1]):
            above[j, i] = _merge(fine, known, j, i, cells[j, i])
            if above[j, i] == 0:
                cells[j, i, _X] = (i + 0.5) * step - 0.5
                cells[j, i, _X + 1] = (j + 0.5) * step - 0.5
                complete = False
    return complete


@numba.njit(cache=True, error_model="numpy")
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


@numba.njit(cache=True, error_model="numpy")
def _relax(flat: Float, todo: NDArray[np.int32], count: int, fade: float) -> None:
    """Sweeps over the unknown cells, forwards and backwards in turn: first g, then f.

    todo: (count, 5) number of each cell in `flat` (cells, _SIZE) and of its neighbours, -1 beyond the grid.
    """
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
                        s0 += near[_G]
                        s1 += near[_G + 1]
                        s2 += near[_G + 2]
                        s3 += near[_G + 3]
                    else:
                        p0, p1 = _predict(cell, near, 0.5)
                        s0 += p0
                        s1 += p1
                if stage == 0:
                    weight = fade / neighbours
                    cell[_G] = weight * s0
                    cell[_G + 1] = weight * s1
                    cell[_G + 2] = weight * s2
                    cell[_G + 3] = weight * s3
                else:
                    cell[_F] = s0 / neighbours
                    cell[_F + 1] = s1 / neighbours


@numba.njit(cache=True, error_model="numpy")
def _fill(cells: Float, known: Bytes, parents: Float, step: float) -> None:
    """Unknown cells of a level from the completed level above, then smoothed."""
    rows, cols = known.shape
    todo = np.empty((rows * cols, 5), dtype=np.int32)
    count = 0
    for j in range(rows):
        for i in range(cols):
            if known[j, i] == 0:
                cell, parent = cells[j, i], parents[j // 2, i // 2]
                for k in range(_G, _SIZE):
                    cell[k] = parent[k]
                cell[_F], cell[_F + 1] = _predict(cell, parent, 1.0)
                here = j * cols + i
                todo[count, 0] = here
                todo[count, 1] = here - cols if j > 0 else -1
                todo[count, 2] = here + cols if j < rows - 1 else -1
                todo[count, 3] = here - 1 if i > 0 else -1
                todo[count, 4] = here + 1 if i < cols - 1 else -1
                count += 1
    _relax(cells.reshape(rows * cols, _SIZE), todo, count, 1.0 / (1.0 + 0.25 * (step / REACH_NODES) ** 2))


@numba.njit(cache=True, error_model="numpy")
def _continue(field: Float, valid: Mask, out: Float) -> None:
    rows, cols = valid.shape
    count = 0
    for j in range(rows):
        for i in range(cols):
            count += valid[j, i]
    if count == rows * cols or count == 0:
        for j in range(rows):
            for i in range(cols):
                for k in range(2):
                    out[j, i, k] = field[j, i, k] if count > 0 else 0.0
        return
    levels = [np.empty((rows, cols, _SIZE))]
    knowns = [np.empty((rows, cols), dtype=np.uint8)]
    _finest(field, valid, levels[0], knowns[0])
    step = 1.0
    complete = False
    while not complete:
        step *= 2.0
        rows, cols = (rows + 1) // 2, (cols + 1) // 2
        levels.append(np.empty((rows, cols, _SIZE)))
        knowns.append(np.empty((rows, cols), dtype=np.uint8))
        complete = _coarser(levels[-2], knowns[-2], step, levels[-1], knowns[-1])
    for n in range(len(levels) - 2, -1, -1):
        step *= 0.5
        _fill(levels[n], knowns[n], levels[n + 1], step)
    finest = levels[0]
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            for k in range(2):
                out[j, i, k] = field[j, i, k] if valid[j, i] else finest[j, i, _F + k]


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
    _continue(field, valid, out)
    return out
