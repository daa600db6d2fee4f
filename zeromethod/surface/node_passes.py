"""Passes over all nodes of one reading, compiled: which nodes are used, arrays of its surface, sums."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask, Single
from zeromethod.rounding import REORDERED


@numba.njit(cache=True, error_model="numpy")
def use_nodes(q: Float, sigma: Float, flags: Flags, usable: Mask, out_q: Float, out: Mask) -> None:
    """Usable nodes that were measured, and their q (2, rows, cols), NaN at the others."""
    for i in range(usable.shape[0]):
        for j in range(usable.shape[1]):
            x, y, of_x, of_y = q[i, j, 0], q[i, j, 1], sigma[i, j, 0], sigma[i, j, 1]
            used = usable[i, j] and flags[i, j] == 0 and np.isfinite(x + y + of_x + of_y)
            out[i, j] = used = used and of_x > 0.0 and of_y > 0.0
            out_q[0, i, j], out_q[1, i, j] = (x, y) if used else (np.nan, np.nan)


@numba.njit(cache=True, error_model="numpy")
def at_rest_where_unknown(bending: Float, at_rest: Float) -> None:
    """Put that of the warp at rest where a Jacobian (rows, cols, 2, 2) is not finite."""
    for i in range(bending.shape[0]):
        row, unknown = bending[i].reshape(4 * bending.shape[1]), 0
        for k in range(len(row)):
            unknown += not np.isfinite(row[k])
        if unknown == 0:
            continue
        for j in range(bending.shape[1]):
            if not np.isfinite(bending[i, j].sum()):
                bending[i, j] = at_rest[i, j]


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def sum_on(values: Float, nodes: Mask) -> float:
    """Sum over nodes (rows, cols) of both components of values (rows, cols, 2)."""
    total = 0.0
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            total += values[i, j, 0] + values[i, j, 1] if nodes[i, j] else 0.0
    return total


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def dot(one: Float, other: Float | Mask) -> float:
    """Sum of products of values (rows, cols).

    In the same order on every machine's threads, which sums by a library are not; and it starts none.
    """
    total = 0.0
    for i in range(one.shape[0]):
        for j in range(one.shape[1]):
            total += one[i, j] * other[i, j]
    return total


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def squares_apart(one: Float, other: Float, nodes: Mask) -> float:
    """Sum over nodes (rows, cols) of the squared difference of vectors (rows, cols, 2)."""
    total = 0.0
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            x, y = one[i, j, 0] - other[i, j, 0], one[i, j, 1] - other[i, j, 1]
            total += x * x + y * y if nodes[i, j] else 0.0
    return total


@numba.njit(cache=True, error_model="numpy")
def mean_square(vectors: Single, flags: Flags) -> float:
    """Mean square of finite vectors (rows, cols, 2) of nodes without a flag; 0 where there is none.

    Of every second node along both axes: more say little new.
    """
    total, count = 0.0, 0
    for i in range(0, flags.shape[0], 2):
        for j in range(0, flags.shape[1], 2):
            x, y = np.float64(vectors[i, j, 0]), np.float64(vectors[i, j, 1])
            square = x * x + y * y
            if flags[i, j] == 0 and np.isfinite(square):
                total += square
                count += 1
    return total / max(count, 1)


@numba.njit(cache=True, error_model="numpy")
def diagonal(x: Float, y: Float, nodes: Mask) -> float:
    """Diagonal of the rectangle that holds all points (rows, cols) of these nodes."""
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            if nodes[i, j]:
                low_x, high_x = min(low_x, x[i, j]), max(high_x, x[i, j])
                low_y, high_y = min(low_y, y[i, j]), max(high_y, y[i, j])
    return float(np.hypot(high_x - low_x, high_y - low_y))


@numba.njit(cache=True, error_model="numpy")
def deepest_node(depth: Float, nodes: Mask) -> tuple[int, int]:
    """Row and column of the largest |depth| of these nodes, (rows, cols)."""
    deepest, row, col = -1.0, 0, 0
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            if nodes[i, j] and abs(depth[i, j]) > deepest:
                deepest, row, col = abs(depth[i, j]), i, j
    return row, col


@numba.njit(cache=True, error_model="numpy")
def step_of(scale: Float, error: Float, constant: float, nodes: Mask) -> Float:
    """Step of depth (rows, cols), mm, by its error over h, less a constant; 0 off the nodes."""
    out = np.empty(error.shape)
    for i in range(error.shape[0]):
        for j in range(error.shape[1]):
            out[i, j] = scale[i, j] * (error[i, j] - constant) if nodes[i, j] else 0.0
    return out


@numba.njit(cache=True, error_model="numpy")
def together(scale: Float, of_frame: Float, share: Float, depth: Float, systematic: Float) -> Float:
    """Sigma (rows, cols) of depth by variance of depth / h, a share of depth, systematic errors (n, ...)."""
    out = np.empty(depth.shape)
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            total = scale[i, j] ** 2 * of_frame[i, j] + (share[i, j] * depth[i, j]) ** 2
            for k in range(len(systematic)):
                total += systematic[k, i, j] ** 2
            out[i, j] = np.sqrt(total)
    return out


@numba.njit(cache=True, error_model="numpy")
def moved_on(depth: Float, before: Float, earlier: Float, share: float, ahead: float) -> None:
    """Continue in depth (rows, cols) what it did since `before`, as far as it did so since `earlier`.

    share: time from `before` to depth over that from `earlier` to `before`; ahead: time to go on over the
    former. A steady motion goes on, one back and forth turns, a jump stays, noise goes halfway back. NaN
    stands still.
    """
    both = step2 = back2 = 0.0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            step, back = depth[i, j] - before[i, j], share * (before[i, j] - earlier[i, j])
            if not np.isnan(step + back):
                both += step * back
                step2 += step * step
                back2 += back * back
    likeness = both / max(step2, back2) if both != 0.0 else 0.0
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            step = depth[i, j] - before[i, j]
            if not np.isnan(step):
                depth[i, j] += ahead * likeness * step


@numba.njit(cache=True, error_model="numpy")
def _fill(
    at: int, nodes: Mask, depth: Float, slope: Float, sigma: Float, variance: Float, point: Float,
    out: Float, vectors: Float, on_mirror: Mask,
) -> None:  # fmt: skip
    for i in range(out.shape[1]):
        for j in range(out.shape[2]):
            k, m = i - at, j - at
            inside = 0 <= k < nodes.shape[0] and 0 <= m < nodes.shape[1]
            if inside and nodes[k, m]:
                out[0, i, j], out[1, i, j] = depth[k, m], sigma[k, m]
                for axis in range(2):
                    vectors[0, i, j, axis] = slope[k, m, axis]
                    vectors[1, i, j, axis] = np.sqrt(variance[k, m, axis])
            else:
                out[0, i, j] = out[1, i, j] = np.nan
                vectors[:, i, j] = np.nan
            on_mirror[i, j] = inside and np.isfinite(point[k, m, 0] + point[k, m, 1])
            if on_mirror[i, j]:
                out[2, i, j], out[3, i, j] = point[k, m, 0], point[k, m, 1]


def surface_arrays(
    padding: int,
    rest_xy: Float,
    nodes: Mask,
    depth: Float,
    slope: Float,
    sigma: Float,
    variance: Float,
    point: Float,
) -> dict[str, Float | Mask]:
    """Arrays of a `Surface` on the full grid: NaN off the nodes, points of the mirror at rest off the mirror.

    padding: nodes on each side that nothing measures. rest_xy: (rows, cols, 2) mm, of the full grid.
    nodes: (rows, cols) with a depth, its slope (..., 2), their sigma and variance; points (..., 2 or more).
    """
    shape = rest_xy.shape[:2]
    out, vectors = np.empty((4, *shape)), np.empty((2, *shape, 2))
    out[2], out[3] = rest_xy[..., 0], rest_xy[..., 1]
    on_mirror = np.empty(shape, bool)
    _fill(padding, nodes, depth, slope, sigma, variance, point, out, vectors, on_mirror)
    return {
        "depth_mm": out[0],
        "slope": vectors[0],
        "x_mm": out[2],
        "y_mm": out[3],
        "sigma_depth_mm": out[1],
        "sigma_slope": vectors[1],
        "on_mirror": on_mirror,
    }
