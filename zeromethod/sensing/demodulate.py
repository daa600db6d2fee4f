"""Demodulation: triangle-window sums of grey and grey x carrier at every node, in one pass over the image.

Nodes lie every half period h = P/2, so a window is four blocks of h rows with weights linear in the row,
and the carrier repeats from block to block except for its sign. Per block and column six sums (grey, and grey
times carrier's cosine and sine, each plain and times the row) serve all four windows that share the block.
Every pixel is read once; all further work is on one row per node row.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Flags, Single
from zeromethod.sensing.window import triangle

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Fast-math flags that keep infinity and NaN."""

Image = Bytes | Flags | Single
"""Grey levels from the camera, or levelled ones."""

Length = tuple[int, ...]
"""A tuple used for its length, which the compiler then knows: sums over the window run 4 times faster."""


class Buffers(NamedTuple):
    """Tables and work space for one image shape and period; `planes` and `clipped` receive the results.

    carrier: (2, h) cosine and sine per row of a block. taps: (3, 2 P) window weights, plain and times cosine
    and sine. planes: (quantities, node rows, node cols), measurable nodes only. clipped: (node rows + 3,
    node cols + 3) pixels at the ceiling per h x h block.
    """

    carrier: Single
    taps: Single
    window: Length
    signs: Single
    blocks: Single
    rows: Single
    peak: Flags
    planes: Single
    clipped: NDArray[np.int32]

    @classmethod
    def of(cls, nodes: tuple[int, int], period_px: int, signs: tuple[int, ...], planes: int) -> Buffers:
        """Buffers for `nodes` (rows, cols); signs: see `window_rows`; planes: window sums per node."""
        rows, cols = nodes
        half = period_px // 2
        width = half * (cols + 3)
        turn = 2 * np.pi * np.arange(half) / period_px
        phase = 2 * np.pi * np.arange(-period_px, period_px) / period_px
        weight = np.concatenate([[0.0], triangle(period_px)])
        return cls(
            carrier=np.stack([np.cos(turn), np.sin(turn)]).astype(np.float32),
            taps=np.stack([weight, weight * np.cos(phase), weight * np.sin(phase)]).astype(np.float32),
            window=(0,) * (2 * period_px),
            signs=np.array(signs, np.float32),
            blocks=np.zeros((4, 2 * len(signs), width), np.float32),
            rows=np.zeros((len(signs), width), np.float32),
            peak=np.zeros(width, np.uint16),
            planes=np.zeros((planes, rows, cols), np.float32),
            clipped=np.zeros((rows + 3, cols + 3), np.int32),
        )


@numba.njit(cache=True, fastmath=FAST)
def accumulate(image: Image, top: int, carrier: Single, sums: Single, peak: Flags) -> None:
    """Sums (6, width) over one block of rows, two rows per sweep (six accumulators fit the L1 cache)."""
    half, width = carrier.shape[1], sums.shape[1]
    s0, s1, c0, c1, d0, d1 = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    sums[:] = np.float32(0)
    peak[:] = 0
    for y in range(0, half, 2):
        last = min(y + 1, half - 1)
        on = np.float32(last - y)  # an odd block's last sweep has only one row
        ya, yb = np.float32(y), np.float32(last)
        ca, sa, cb, sb = carrier[0, y], carrier[1, y], carrier[0, last], carrier[1, last]
        row_a, row_b = image[top + y], image[top + last]
        for u in range(width):
            peak[u] = max(peak[u], max(row_a[u], row_b[u]))  # noqa: PLW3301 - pairs vectorise
            a, b = np.float32(row_a[u]), on * np.float32(row_b[u])
            s0[u] += a + b
            s1[u] += ya * a + yb * b
            c0[u] += ca * a + cb * b
            c1[u] += (ya * ca) * a + (yb * cb) * b
            d0[u] += sa * a + sb * b
            d1[u] += (ya * sa) * a + (yb * sb) * b


@numba.njit(cache=True, fastmath=FAST)
def count_clipped(
    image: Image, top: int, half: int, ceiling: int, peak: Flags, counts: NDArray[np.int32]
) -> None:
    """Count the pixels at the ceiling in each block of a row of blocks; peak: each column's brightest."""
    counts[:] = 0
    if peak.max() < ceiling:
        return
    for u in range(peak.shape[0]):
        if peak[u] >= ceiling:
            for y in range(half):
                counts[u // half] += image[top + y, u] >= ceiling


@numba.njit(cache=True, fastmath=FAST)
def window_rows(a: Single, b: Single, c: Single, d: Single, signs: Single, half: int, out: Single) -> None:
    """Vertical windows of several quantities (each per column) from four blocks' sums, weights P - |k|.

    The node is at the third block's first row. Sums come in pairs: plain and times the row. signs: -1 for
    a quantity whose sign changes from block to block (the carrier), else 1.
    """
    h, scale = np.float32(half), np.float32(1.0 / (4 * half * half))
    for k in range(len(signs)):
        sign = signs[k]
        a1, b0, b1 = a[2 * k + 1], b[2 * k], b[2 * k + 1]
        c0, c1, d0, d1 = c[2 * k], c[2 * k + 1], d[2 * k], d[2 * k + 1]
        row = out[k]
        for u in range(row.shape[0]):
            other = sign * (h * (b0[u] + d0[u]) + b1[u] - d1[u])
            row[u] = scale * (a1[u] - c1[u] + other + (h + h) * c0[u])


@numba.njit(cache=True, fastmath=FAST)
def _axis_carriers(rows: Single, taps: Single, window: Length, planes: Single, r: int) -> None:
    """Horizontal windows of one node row: carrier along u from DC, carrier along v from cosine and sine."""
    zero, half = np.float32(0), len(window) // 4
    for j in range(planes.shape[2]):
        cu, su, cv, sv, mean = zero, zero, zero, zero, zero
        first = half * j
        for k in range(len(window)):
            grey = rows[0, first + k]
            mean += taps[0, k] * grey
            cu += taps[1, k] * grey
            su += taps[2, k] * grey
            cv += taps[0, k] * rows[1, first + k]
            sv += taps[0, k] * rows[2, first + k]
        planes[0, r, j], planes[1, r, j] = cu, su
        planes[2, r, j], planes[3, r, j], planes[4, r, j] = cv, sv, mean


@numba.njit(cache=True, fastmath=FAST)
def _diagonal_carriers(rows: Single, taps: Single, window: Length, planes: Single, r: int) -> None:
    """Horizontal windows of one node row: the two carriers along u + v and u - v."""
    zero, half = np.float32(0), len(window) // 4
    for j in range(planes.shape[2]):
        cc, sc, cs, ss, mean = zero, zero, zero, zero, zero
        first = half * j
        for k in range(len(window)):
            mean += taps[0, k] * rows[0, first + k]
            cc += taps[1, k] * rows[1, first + k]
            sc += taps[2, k] * rows[1, first + k]
            cs += taps[1, k] * rows[2, first + k]
            ss += taps[2, k] * rows[2, first + k]
        planes[0, r, j], planes[1, r, j] = cc - ss, sc + cs
        planes[2, r, j], planes[3, r, j], planes[4, r, j] = cc + ss, sc - cs, mean


@numba.njit(cache=True, fastmath=FAST)
def demodulate(image: Image, ceiling: int, diagonal: bool, buffers: Buffers) -> None:
    """Fill `planes` and `clipped` from an image (rows, cols); ceiling: the largest grey level.

    planes 0..3: window sums of grey x (cos u, sin u, cos v, sin v), or x (cos(u+v), sin(u+v), cos(u-v),
    sin(u-v)) where `diagonal`, phases relative to the node; 4: mean grey.
    """
    carrier, blocks, signs, rows = buffers.carrier, buffers.blocks, buffers.signs, buffers.rows
    half = carrier.shape[1]
    for b in range(buffers.clipped.shape[0]):
        accumulate(image, b * half, carrier, blocks[b & 3], buffers.peak)
        count_clipped(image, b * half, half, ceiling, buffers.peak, buffers.clipped[b])
        if b < 3:
            continue
        r = b - 3
        window_rows(blocks[r & 3], blocks[(r + 1) & 3], blocks[(r + 2) & 3], blocks[b & 3], signs, half, rows)
        if diagonal:
            _diagonal_carriers(rows, buffers.taps, buffers.window, buffers.planes, r)
        else:
            _axis_carriers(rows, buffers.taps, buffers.window, buffers.planes, r)
