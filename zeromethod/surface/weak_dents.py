"""Depth that the anchor may have by dents too weak to show at any single node, and its sigma; compiled.

The dent that a load makes on a deep elastic body falls as 1 / r. Such dents, at some places and of some
sizes, are compared with all slopes at once: a sum over the view shows what no single node does. Each dent
counts by the likelihood of the slopes under it, and all of them against no dent at all. In a layer, or a
prism whose faces are held, depth falls faster: the anchor's depth is taken as half of what 1 / r gives, with
a standard deviation of the same size.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rounding import REORDERED
from zeromethod.surface.far_field_laws import Known, Nodes

_PLACES, _SIZES = (9, 7), (24.0, 12.0, 6.0)
"""Places across and down the view, and its diagonal over sizes, of the dents that are tried."""

_BLOCKS = 150
"""Blocks of nodes whose slopes are summed up first, about: a dent is as steep all over one."""

_ODDS, _FURTHER_ODDS = 0.035, 0.35
"""Prior odds that a mirror which seems at rest is pressed, and that a press hides a further one."""

_DEEPEST = 7.0
"""Prior standard deviation of such a dent's depth, over that which noise alone leaves: a much deeper one is
found by itself."""

_EVERY, _EVERY_QUIET = 2, 4
"""Every so many nodes, and of the anchor, are looked at where dents are found already."""


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _anchor_by(sums: Float, whole: Float, prior: float) -> tuple[float, float]:
    """Mean and standard deviation of the anchor's depth / h, mm, by dents that are tried.

    sums: (12, n) over blocks of nodes: x, y, nodes; weights over scale; along x and y each: 1 / variance, the
    slope less what is contained of the gradient over it, and the gradient over it; and 1 / variance of noise,
    along x and y. whole: over all of gradient times what is left, and of its square. prior: odds of a dent.
    """
    x, y, share = sums[0], sums[1], sums[3]
    left, right, top, bottom = x.min(), x.max(), y.min(), y.max()
    diagonal = math.hypot(right - left, bottom - top)
    count = len(_SIZES) * _PLACES[0] * _PLACES[1]
    gain, deep, open2 = np.zeros(count), np.zeros(count), np.zeros(count)
    for one in range(count):
        size2 = (diagonal / _SIZES[one // (_PLACES[0] * _PLACES[1])]) ** 2
        at_x = left + (right - left) * (one % _PLACES[0]) / (_PLACES[0] - 1)
        at_y = top + (bottom - top) * (one // _PLACES[0] % _PLACES[1]) / (_PLACES[1] - 1)
        border = along = squares = crossed = by_noise = 0.0
        for k in range(len(x)):
            to_x, to_y = x[k] - at_x, y[k] - at_y
            shape = 1.0 / math.sqrt(1.0 + (to_x * to_x + to_y * to_y) / size2)
            steep = -shape * shape * shape / size2
            slope_x, slope_y = steep * to_x, steep * to_y
            border += share[k] * shape
            along += slope_x * sums[5, k] + slope_y * sums[8, k]
            squares += slope_x * slope_x * sums[4, k] + slope_y * slope_y * sums[7, k]
            by_noise += slope_x * slope_x * sums[10, k] + slope_y * slope_y * sums[11, k]
            crossed += slope_x * sums[6, k] + slope_y * sums[9, k]
        # its own depth at the anchor is in the constant
        along -= border * whole[0]
        squares += border * (border * whole[1] - 2.0 * crossed)
        if squares > 0.0 and by_noise > 0.0:
            before = _DEEPEST * _DEEPEST / by_noise
            kept = before * squares / (1.0 + before * squares)
            gain[one] = 0.5 * kept * along * along / squares + 0.5 * math.log(1.0 - kept)
            deep[one], open2[one] = kept * border * along / squares, kept * border * border / squares
    largest = gain.max()
    likely = np.exp(gain - largest)
    # of a dent, against none
    odds = prior * likely.mean() * math.exp(min(largest, 600.0))
    pressed = odds / (1.0 + odds)
    likely /= likely.sum()
    mean = float((likely * deep).sum())
    spread2 = float((likely * (deep * deep + open2)).sum()) - mean * mean
    found_mm = 0.5 * mean
    variance2 = pressed * (spread2 + 0.25 * mean * mean) + pressed * (1.0 - pressed) * found_mm**2
    return pressed * found_mm, math.sqrt(max(variance2, 0.0))


@numba.njit(cache=True, error_model="numpy")
def weak_far_field(
    weights: Float,
    scale: Float,
    slope: Float,
    gradient: Float,
    contained_mm: float,
    variance: Float,
    island: Mask,
    x_mm: Float,
    y_mm: Float,
    shared: float,
) -> tuple[float, float]:
    """Mean of depth / h, mm, that the anchor has by dents that noise hides, and its standard deviation.

    weights: the anchor's (rows, cols); slope, gradient of h, variance: (rows, cols, 2), rad, 1/mm, rad^2.
    contained_mm: multiple of h in the depth. shared: nodes that share a node's noise.
    """
    rows, cols = island.shape
    size = max(1, math.ceil(math.sqrt(rows * cols / _BLOCKS)))
    across = -(-cols // size)
    out, whole = np.zeros((12, -(-rows // size) * across)), np.zeros(2)
    for i in range(rows):
        for j in range(cols):
            if not island[i, j]:
                continue
            block = i // size * across + j // size
            out[0, block] += x_mm[i, j]
            out[1, block] += y_mm[i, j]
            out[2, block] += 1.0
            out[3, block] += weights[i, j] / scale[i, j]
            for axis in range(2):
                per = 1.0 / (shared * variance[i, j, axis])
                left = slope[i, j, axis] - contained_mm * gradient[i, j, axis]
                out[4 + 3 * axis, block] += per
                out[10 + axis, block] += per
                out[5 + 3 * axis, block] += per * left
                out[6 + 3 * axis, block] += per * gradient[i, j, axis]
                whole[0] += per * gradient[i, j, axis] * left
                whole[1] += per * gradient[i, j, axis] ** 2
    for k in range(out.shape[1]):
        out[0, k] /= max(out[2, k], 1.0)
        out[1, k] /= max(out[2, k], 1.0)
    return _anchor_by(out[:, out[2] > 0.0], whole, _ODDS)


@numba.njit(cache=True, error_model="numpy")
def further_far_field(
    left: Float, variance: Float, shared: float, nodes: Nodes, quiet: Nodes, known: Known
) -> tuple[float, float]:
    """The same of dents besides those that are found, by the slopes `left` (2, n) that these leave.

    variance: (2, n). shared: nodes that share a node's error.
    """
    used, still = np.arange(0, len(nodes.x), _EVERY), np.arange(0, len(quiet.x), _EVERY_QUIET)
    sums, whole = np.zeros((12, len(used) + len(still))), np.zeros(2)
    every = max(shared / _EVERY, 1.0)
    for k in range(len(used)):
        i = used[k]
        sums[0, k], sums[1, k] = nodes.x[i], nodes.y[i]
        for axis, gradient in ((0, nodes.gradient_x[i]), (1, nodes.gradient_y[i])):
            per = known.weight[i] / (every * variance[axis, i])
            own = nodes.variance_x[i] if axis == 0 else nodes.variance_y[i]
            sums[10 + axis, k] = known.weight[i] / own
            sums[4 + 3 * axis, k], sums[5 + 3 * axis, k] = per, per * left[axis, i]
            sums[6 + 3 * axis, k] = per * gradient
            whole[0] += per * gradient * left[axis, i]
            whole[1] += per * gradient * gradient
    total = known.share[still].sum()
    for k in range(len(still)):
        i, at = still[k], len(used) + k
        sums[0, at], sums[1, at] = quiet.x[i], quiet.y[i]
        sums[3, at] = known.share[i] / (total * quiet.scale[i])
    return _anchor_by(sums, whole, _FURTHER_ODDS)
