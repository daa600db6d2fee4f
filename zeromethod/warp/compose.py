"""Composition of the shown warp with the residual: the measured warp."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.warp.interpolant import keys_weights, sample_pair

_FAST = {"contract"}


@numba.njit(cache=True, fastmath=_FAST, inline="always")
def _taps(t: float) -> tuple[float, float, float, float, float]:
    """Weights of the nodes two before to two behind at t, -1 < t < 1: the interpolant's four and 0."""
    before = t < 0.0
    w0, w1, w2, w3 = keys_weights(t + 1.0 if before else t)
    return (
        w0 if before else 0.0,
        w1 if before else w0,
        w2 if before else w1,
        w3 if before else w2,
        0.0 if before else w3,
    )


@numba.njit(cache=True, fastmath=_FAST)
def _near(a: Float, b: Float, c: Float, d: Float, e: Float, along: Float, across: Float, out: Float) -> None:
    """Values less than a node away from the nodes of a row (n,), both components in turn, as lines.

    a to e: (n + 8,) the rows two before to two behind, from two nodes before on. along, across: (n,) nodes.
    """
    for n in range(out.size):
        h0, h1, h2, h3, h4 = _taps(along[n])
        v0, v1, v2, v3, v4 = _taps(across[n])
        first = h0 * a[n] + h1 * a[n + 2] + h2 * a[n + 4] + h3 * a[n + 6] + h4 * a[n + 8]
        second = h0 * b[n] + h1 * b[n + 2] + h2 * b[n + 4] + h3 * b[n + 6] + h4 * b[n + 8]
        third = h0 * c[n] + h1 * c[n + 2] + h2 * c[n + 4] + h3 * c[n + 6] + h4 * c[n + 8]
        fourth = h0 * d[n] + h1 * d[n + 2] + h2 * d[n + 4] + h3 * d[n + 6] + h4 * d[n + 8]
        fifth = h0 * e[n] + h1 * e[n + 2] + h2 * e[n + 4] + h3 * e[n + 6] + h4 * e[n + 8]
        out[n] = v0 * first + v1 * second + v2 * third + v3 * fourth + v4 * fifth


@numba.njit(cache=True)
def _displacements(d_px: Float, scale: float, along: Float, across: Float) -> bool:
    """Displacements, nodes, of a row's nodes, (n,) each component twice; whether all are less than one."""
    for i in range(along.size // 2):
        along[2 * i] = along[2 * i + 1] = scale * d_px[i, 0]
        across[2 * i] = across[2 * i + 1] = scale * d_px[i, 1]
    far = 0
    for n in range(along.size):
        far += not ((abs(along[n]) < 1.0) & (abs(across[n]) < 1.0))  # NaN is far
    return far == 0


@numba.njit(cache=True, fastmath=_FAST)
def _compose(q_shown: Float, d_px: Float, scale: float, out: Float) -> None:
    rows, cols = out.shape[0], out.shape[1]
    flat, width, size = q_shown.reshape(2 * rows * cols), 2 * cols, max(2 * cols - 8, 0)
    along, across = np.empty(size), np.empty(size)
    for j in range(rows):
        near = 2 <= j < rows - 2 and _displacements(d_px[j, 2 : cols - 2], scale, along, across)
        if near:
            to, k = out[j].reshape(width)[4 : 4 + size], (j - 2) * width
            a, b, c = flat[k:], flat[k + width :], flat[k + 2 * width :]
            _near(a, b, c, flat[k + 3 * width :], flat[k + 4 * width :], along, across, to)
        for i in range(cols):
            # the five taps meet nodes that are not among the four of the interpolant
            if not (near and 2 <= i < cols - 2 and math.isfinite(out[j, i, 0] + out[j, i, 1])):
                at = i + scale * d_px[j, i, 0], j + scale * d_px[j, i, 1]
                out[j, i, 0], out[j, i, 1] = sample_pair(q_shown, at[0], at[1])


def compose(q_shown: Float, d_px: Float, spacing_px: float) -> Float:
    """Measured warp q(u, v) = q_shown((u, v) + d) at every node.

    q_shown: (rows, cols, 2) LCD px, the warp shown during the exposure. d_px: (rows, cols, 2) residual in
    camera px. spacing_px: camera px between nodes. Returns (rows, cols, 2) LCD px; NaN where (u, v) + d
    leaves the interpolable region (one node inside the grid's edge) or d is NaN. With d = 0 the inner nodes
    come back bit for bit.

    Convention: the residual is where on the target the node looks, observed(u, v) = T((u, v) + d).
    """
    out = np.empty_like(q_shown)
    _compose(q_shown, d_px, 1.0 / spacing_px, out)
    return out
