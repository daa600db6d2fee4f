"""Passes over all nodes of one reading: which nodes are used, arrays of its surface, sums."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Flags, Float, Mask, Single


def use_nodes(q: Float, sigma: Float, flags: Flags, usable: Mask, out_q: Float, out: Mask) -> None:
    """Usable nodes that were measured, and their q (2, rows, cols), NaN at the others."""
    x, y, of_x, of_y = q[..., 0], q[..., 1], sigma[..., 0], sigma[..., 1]
    known = np.isfinite(x + y + of_x + of_y) & (of_x > 0.0) & (of_y > 0.0)
    out[:] = usable & (flags == 0) & known
    out_q[0], out_q[1] = np.where(out, x, np.nan), np.where(out, y, np.nan)


def at_rest_where_unknown(bending: Float, at_rest: Float) -> None:
    """Put that of the warp at rest where a Jacobian (rows, cols, 2, 2) is not finite."""
    finite = np.isfinite(bending)
    if not finite.all():
        unknown = np.nonzero(~(finite[..., 0, 0] & finite[..., 0, 1] & finite[..., 1, 0] & finite[..., 1, 1]))
        bending[unknown] = at_rest[unknown]


def sum_on(values: Float, nodes: Mask) -> float:
    """Sum over nodes (rows, cols) of both components of values (rows, cols, 2)."""
    return float(np.where(nodes, values[..., 0] + values[..., 1], 0.0).sum())


def dot(one: Float, other: Float | Mask) -> float:
    """Sum of products of values (rows, cols).

    In the same order whatever the number of threads, which products by BLAS are not; and it starts none.
    """
    return float(np.einsum("ij,ij->", one, other))


def squares_apart(one: Float, other: Float, nodes: Mask) -> float:
    """Sum over nodes (rows, cols) of the squared difference of vectors (rows, cols, 2)."""
    x, y = one[..., 0] - other[..., 0], one[..., 1] - other[..., 1]
    return float(np.where(nodes, x * x + y * y, 0.0).sum())


def mean_square(vectors: Single, flags: Flags) -> float:
    """Mean square of finite vectors (rows, cols, 2) of nodes without a flag; 0 where there is none.

    Of every second node along both axes: more say little new.
    """
    some = vectors[::2, ::2].astype(np.float64)
    squares = some[..., 0] ** 2 + some[..., 1] ** 2
    known = squares[(flags[::2, ::2] == 0) & np.isfinite(squares)]
    return float(known.sum()) / max(len(known), 1)


def diagonal(x: Float, y: Float, nodes: Mask) -> float:
    """Diagonal of the rectangle that holds all points (rows, cols) of these nodes, at least one."""
    return float(np.hypot(np.ptp(x[nodes]), np.ptp(y[nodes])))


def deepest_node(depth: Float, nodes: Mask) -> tuple[int, int]:
    """Row and column of the largest |depth| of these nodes, (rows, cols)."""
    size = np.abs(depth)
    row, col = np.unravel_index(np.argmax(np.where(nodes & ~np.isnan(size), size, -1.0)), depth.shape)
    return int(row), int(col)


def step_of(scale: Float, error: Float, constant: float, nodes: Mask) -> Float:
    """Step of depth (rows, cols), mm, by its error over h, less a constant; 0 off the nodes."""
    return np.where(nodes, scale * (error - constant), 0.0)


def together(scale: Float, of_frame: Float, share: Float, depth: Float, systematic: Float) -> Float:
    """Sigma (rows, cols) of depth by variance of depth / h, a share of depth, systematic errors (n, ...)."""
    total = scale**2 * of_frame + (share * depth) ** 2
    for one in systematic:
        total += one**2
    return np.asarray(np.sqrt(total))


def moved_on(depth: Float, before: Float, earlier: Float, share: float, ahead: float) -> None:
    """Continue in depth (rows, cols) what it did since `before`, as far as it did so since `earlier`.

    share: time from `before` to depth over that from `earlier` to `before`; ahead: time to go on over the
    former. A steady motion goes on, one back and forth turns, a jump stays, noise goes halfway back. NaN
    stands still.
    """
    step, back = depth - before, share * (before - earlier)
    known = ~np.isnan(step + back)
    one, other = step[known], back[known]
    both = float((one * other).sum())
    likeness = both / max(float((one * one).sum()), float((other * other).sum())) if both != 0.0 else 0.0
    step *= ahead * likeness
    step[np.isnan(step)] = 0.0
    depth += step


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
    shape, inner = rest_xy.shape[:2], (slice(padding, -padding), slice(padding, -padding))
    depth_mm, sigma_depth_mm = np.full((2, *shape), np.nan)
    slopes, sigma_slope = np.full((2, *shape, 2), np.nan)
    np.copyto(depth_mm[inner], depth, where=nodes)
    np.copyto(sigma_depth_mm[inner], sigma, where=nodes)
    on_mirror = np.zeros(shape, bool)
    on_mirror[inner] = np.isfinite(point[..., 0] + point[..., 1])
    places = np.empty((2, *shape))
    for k in range(2):
        np.copyto(slopes[(*inner, k)], slope[..., k], where=nodes)
        np.sqrt(variance[..., k], out=sigma_slope[(*inner, k)], where=nodes)
        places[k] = rest_xy[..., k]
        np.copyto(places[k][inner], point[..., k], where=on_mirror[inner])
    return {
        "depth_mm": depth_mm,
        "slope": slopes,
        "x_mm": places[0],
        "y_mm": places[1],
        "sigma_depth_mm": sigma_depth_mm,
        "sigma_slope": sigma_slope,
        "on_mirror": on_mirror,
    }
