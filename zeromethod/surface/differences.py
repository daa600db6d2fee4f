"""Depth differences between neighbouring nodes: the line integral of the slope from one to the next.

Derivatives along a line of nodes and integrals over one interval are exact for the polynomial through as many
neighbouring valid nodes as there are, up to seven (derivative) or six (integral). Next to a border or a hole
the stencils shift to one side, so that they never include a node that was not measured. The trapezoidal rule
would be 0.4 % in error at the peak of a narrow dent.
"""

from __future__ import annotations

from typing import Any

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.kernels import kernel, piece, read
from zeromethod.warp.runs import runs

DERIVATIVE_POINTS = 7
INTEGRAL_POINTS = 6
BORDER_POINTS = 4
"""One-sided integrals use fewer points: six of them would amplify noise by 1.24 instead of 0.9."""


def _weights(points: int, at: int, moments: Float) -> Float:
    """Weights (points,) exact for powers of the offset from `at`, on which the rule gives `moments`."""
    powers = np.vander(np.arange(points) - at, increasing=True).T.astype(np.float64)
    return np.asarray(np.linalg.solve(powers, moments), dtype=np.float64)


def derivative_table() -> Float:
    """Weights [points, position, k] of d/dtau at `position` among `points` nodes one apart."""
    size = DERIVATIVE_POINTS
    table = np.zeros((size + 1, size, size))
    for points in range(2, size + 1):
        for at in range(points):
            table[points, at, :points] = _weights(points, at, np.eye(points)[1])
    return table


def integral_table() -> Float:
    """Weights [points, first, k] of the integral from node `first` to `first + 1` among `points`.

    points 2 is the trapezoid, 4 in the middle (-1, 13, 13, -1)/24, 6 in the middle
    (11, -93, 802, 802, -93, 11)/1440.
    """
    size = INTEGRAL_POINTS
    table = np.zeros((size + 1, size - 1, size))
    for points in range(2, size + 1):
        for first in range(points - 1):
            table[points, first, :points] = _weights(points, first, 1.0 / np.arange(1, points + 1))
    return table


DERIVATIVE = derivative_table()
INTEGRAL = integral_table()


def stencils(valid: Mask) -> tuple[tuple[Ints, Ints], tuple[Ints, Ints]]:
    """Of nodes and of steps, along columns and along rows, that are next to a gap or border.

    Each (n, 4): row, column, first node and number of nodes.
    """
    of_nodes, of_steps = (np.ascontiguousarray(one[:, [1, 0, 2, 3]]) for one in _along_rows(valid.T))
    return (of_nodes, of_steps), _along_rows(valid)


def _along_rows(valid: Mask) -> tuple[Ints, Ints]:
    """Of nodes and of steps along rows, see `stencils`."""
    row, start, end = runs(valid)
    i, j, first, last = _at_ends(row, start, end, DERIVATIVE_POINTS // 2)
    points = np.minimum(DERIVATIVE_POINTS, last - first)
    nodes = i, j, np.clip(j - points // 2, first, last - points), points
    i, j, first, last = _at_ends(row, start, end - 1, INTEGRAL_POINTS // 2 - 1)
    points = np.minimum(BORDER_POINTS, last + 1 - first)
    steps = i, j, np.clip(j - points // 2 + 1, first, last + 1 - points), points
    return np.stack(nodes, axis=1), np.stack(steps, axis=1)


def _at_ends(row: Ints, start: Ints, end: Ints, most: int) -> tuple[Ints, Ints, Ints, Ints]:
    """Row and column of places at runs' ends, at most so many at either end; start and end of their runs."""
    k, count = np.arange(2 * most), (end - start)[:, None]
    place = start[:, None] + np.where(k < most, k, np.maximum(count - 2 * most + k, k))
    there = k < count
    row, start, end = (np.repeat(one, there.sum(axis=1)) for one in (row, start, end))
    return row, place[there], start, end


def _spans(near: Ints, table: Float, most: int) -> tuple[Ints, Ints, Ints, Float]:
    """Row and column (n,), the columns (n, most) and weights (n, most) of stencils along rows.

    A stencil of fewer nodes has its last one again, with weight 0.
    """
    i, j, first, points = near.T
    at = first[:, None] + np.minimum(np.arange(most), points[:, None] - 1)
    return i, j, at, table[points, j - first, :most]


def derivatives(x: Any, y: Any, valid: Any) -> tuple[Float, Float]:
    """Derivatives (rows, cols) of x and y (rows, cols) along the rows, at valid nodes; else 0."""
    return _derivatives(x, y, valid, _along_rows(valid)[0])


def _derivatives(x: Float, y: Float, valid: Mask, near: Ints) -> tuple[Float, Float]:
    i, j, at, weights = _spans(near, DERIVATIVE, DERIVATIVE_POINTS)
    centred, found = DERIVATIVE[DERIVATIVE_POINTS, DERIVATIVE_POINTS // 2][None], []
    for field in (x, y):
        along = np.where(valid, cv2.filter2D(field, -1, centred, borderType=cv2.BORDER_CONSTANT), 0.0)
        along[i, j] = np.einsum("nk,nk->n", weights, field[i[:, None], at])
        found.append(along)
    return found[0], found[1]


def _adjoint(weight: Float, x: Float, y: Float, valid: Mask) -> tuple[Float, Float]:
    """Weights (..., rows, cols) of both slopes, from those (..., rows, cols-1) of the steps along rows."""
    of_nodes, of_steps = _along_rows(valid)
    i, j, at, weights = _spans(of_steps, INTEGRAL, BORDER_POINTS)
    inside = np.zeros((*weight.shape[:-2], *valid.shape))
    inside[..., :-1] = np.where(valid[:, :-1] & valid[:, 1:], weight, 0.0)
    of_near = weights * inside[..., i, j, None]
    inside[..., i, j] = 0.0
    before = INTEGRAL_POINTS // 2 - 1
    # the rule is symmetric
    line = cv2.filter2D(
        inside.reshape(-1, valid.shape[1]), -1, INTEGRAL[INTEGRAL_POINTS, before][None],
        anchor=(INTEGRAL_POINTS // 2, 0), borderType=cv2.BORDER_CONSTANT,
    ).reshape(inside.shape)  # fmt: skip
    places: Any = (..., i[:, None], at)
    np.add.at(line, places, of_near)
    dx, dy = _derivatives(x, y, valid, of_nodes)
    return line * dx, line * dy


def depth_differences_adjoint(across: Float, down: Float, x_mm: Float, y_mm: Float, valid: Mask) -> Float:
    """Transpose of `depth_differences`: weights (..., rows, cols, 2), mm, of the slopes in sums over steps.

    across (..., rows, cols-1), down (..., rows-1, cols): the steps' weights; those that touch an invalid node
    count 0. sum(across * steps_across) + sum(down * steps_down) = sum(result * slope).
    """
    along = _adjoint(across, x_mm, y_mm, valid)
    turned = _adjoint(np.swapaxes(down, -1, -2), x_mm.T, y_mm.T, valid.T)
    return np.stack([a + np.swapaxes(b, -1, -2) for a, b in zip(along, turned, strict=True)], axis=-1)


@piece
def _centred(line: Any, at: int, apart: int, weights: Any, out: Any) -> None:
    """Derivatives (n,) at places from `at` on, whose neighbours are so far apart in a lattice as one line."""
    n, w1, w2, w3 = len(out), weights[4], weights[5], weights[6]
    next1, back1 = line[at + apart : at + apart + n], line[at - apart : at - apart + n]
    next2, back2 = line[at + 2 * apart : at + 2 * apart + n], line[at - 2 * apart : at - 2 * apart + n]
    next3, back3 = line[at + 3 * apart : at + 3 * apart + n], line[at - 3 * apart : at - 3 * apart + n]
    for k in range(n):
        out[k] = w1 * (next1[k] - back1[k]) + w2 * (next2[k] - back2[k]) + w3 * (next3[k] - back3[k])


@piece
def _integral(line: Any, at: int, apart: int, weights: Any, out: Any) -> None:
    """Integrals (n,) from places from `at` on to the next."""
    n, w0, w1, w2 = len(out), weights[0], weights[1], weights[2]
    back2, back1 = line[at - 2 * apart : at - 2 * apart + n], line[at - apart : at - apart + n]
    here, next1 = line[at : at + n], line[at + apart : at + apart + n]
    next2, next3 = line[at + 2 * apart : at + 2 * apart + n], line[at + 3 * apart : at + 3 * apart + n]
    for k in range(n):
        far, near = back2[k] + next3[k], back1[k] + next2[k]
        out[k] = w0 * far + w1 * near + w2 * (here[k] + next1[k])


_FIELD, _NEAR = read(numba.float64, 1), read(numba.int64, 2)


@kernel(
    _FIELD, _FIELD, _FIELD, _FIELD, read(numba.boolean, 2), numba.int64, _NEAR, _NEAR,
    read(numba.float64, 3), read(numba.float64, 3), numba.float64[:, ::1], numba.float64[:, ::1],
)  # fmt: skip
def _steps(
    slope_x: Any, slope_y: Any, x: Any, y: Any, valid: Any, axis: int, near_nodes: Any, near_steps: Any,
    derivative: Any, integral: Any, scratch: Any, out: Any,
) -> None:  # fmt: skip
    """Steps along columns (axis 0) or rows (1): of the whole lattice as one line, then again those near gaps.

    slope_x, slope_y, x, y: flat, (rows * cols,). near_nodes, near_steps: `stencils` along the axis. scratch:
    (3, rows * cols).
    """
    size, cols = x.size, valid.shape[1]
    apart = 1 if axis else cols
    product, dx, dy = scratch[0], scratch[1], scratch[2]
    if size > 6 * apart:
        inner, weights = slice(3 * apart, size - 3 * apart), derivative[7, 3]
        _centred(x, 3 * apart, apart, weights, dx[inner])
        _centred(y, 3 * apart, apart, weights, dy[inner])
        for k in range(3 * apart, size - 3 * apart):
            product[k] = slope_x[k] * dx[k] + slope_y[k] * dy[k]
    for i, j, first, points in near_nodes:
        at = (j if axis else i) - first
        place = i * cols + j
        start = place - at * apart
        dx_here = dy_here = 0.0
        for k in range(points):
            weight = derivative[points, at, k]
            dx_here += weight * x[start + k * apart]
            dy_here += weight * y[start + k * apart]
        product[place] = slope_x[place] * dx_here + slope_y[place] * dy_here
    if size > 5 * apart:
        _integral(product, 2 * apart, apart, integral[6, 2], dx[2 * apart : size - 3 * apart])
    for i in range(out.shape[0]):
        here, ahead, line = valid[i], valid[i + 1 - axis, axis:], dx[i * cols :]
        for j in range(out.shape[1]):
            out[i, j] = line[j] if here[j] & ahead[j] else 0.0
    for i, j, first, points in near_steps:
        at = (j if axis else i) - first
        start = i * cols + j - at * apart
        total = 0.0
        for k in range(points):
            total += integral[points, at, k] * product[start + k * apart]
        out[i, j] = total


def depth_differences(
    slope: Any,
    x_mm: Any,
    y_mm: Any,
    valid: Mask,
    near: tuple[tuple[Ints, Ints], tuple[Ints, Ints]] | None = None,
) -> tuple[Any, Any]:
    """Depth step from each node to the next: (rows, cols-1) along rows, (rows-1, cols) along columns, mm.

    slope: (rows, cols, 2), d(depth)/dx and d(depth)/dy at the nodes' mirror points x_mm, y_mm (which may
    lie irregularly but smoothly). The steps have its precision, and are worked out in double. Those that
    touch an invalid node are 0. near: `stencils` of the valid nodes, where they are known.
    """
    rows, cols = valid.shape
    fields = [
        one.astype(np.float64, copy=False).ravel() for one in (slope[..., 0], slope[..., 1], x_mm, y_mm)
    ]
    scratch, found = np.empty((3, valid.size)), []
    for axis, near_gaps in enumerate(stencils(valid) if near is None else near):
        out = np.empty((rows - 1 + axis, cols - axis))
        _steps(*fields, valid, axis, *near_gaps, DERIVATIVE, INTEGRAL, scratch, out)
        found.append(out.astype(slope.dtype, copy=False))
    down, across = found
    return across, down
