"""One pass over the image: the triangle windows of DC and carrier at every node.

Nodes lie every half period h = P/2, so a window is four blocks of h rows with weights linear in the row,
and the carrier repeats from block to block but for its sign. Per block and column six sums (grey, and grey
times carrier's cosine and sine, each plain and times the row) serve all four windows that share the block.
Every pixel is read once; what follows works on one row per node row.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Flags, Single
from zeromethod.sensing.window import triangle

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Fast-math that still knows infinity and NaN."""

Image = Bytes | Flags | Single
"""Grey levels as the camera gives them, or levelled ones."""

Length = tuple[int, ...]
"""A tuple stands for its length, which the compiler then knows: sums over the window run 4 times faster."""


class Buffers:
    """Tables and work space for one image shape and period; `planes` receives the result.

    planes: (5, node rows, node cols) float32, measurable nodes only. Phases are relative to the node.
    0..3: window sums of grey x carrier: (cos u, sin u, cos v, sin v), or of the diagonal carriers
    (cos(u+v), sin(u+v), cos(u-v), sin(u-v)) where `diagonal`; 4: mean grey.
    clipped: (node rows + 3, node cols + 3) int32, pixels at the ceiling per h x h block.
    """

    def __init__(self, nodes: tuple[int, int], period_px: int, *, diagonal: bool) -> None:
        rows, cols = nodes
        half = period_px // 2
        self.diagonal = diagonal
        width = half * (cols + 3)
        turn = 2 * np.pi * np.arange(half) / period_px
        self.carrier = np.stack([np.cos(turn), np.sin(turn)]).astype(np.float32)
        offset = np.arange(-period_px, period_px)
        tri = np.concatenate([[0.0], triangle(period_px)])
        phase = 2 * np.pi * offset / period_px
        self.taps = np.stack([tri, tri * np.cos(phase), tri * np.sin(phase)]).astype(np.float32)
        self.window: Length = (0,) * (2 * period_px)
        self.signs = np.array([1, -1, -1], np.float32)
        self.blocks = np.zeros((4, 6, width), np.float32)
        self.rows = np.zeros((3, width), np.float32)
        self.peak = np.zeros(width, np.uint16)
        self.planes = np.zeros((5, rows, cols), np.float32)
        self.clipped = np.zeros((rows + 3, cols + 3), np.int32)

    def demodulate(self, image: Image, ceiling: int) -> None:
        """Fill `planes` and `clipped` from an image (rows, cols); `ceiling` = the largest grey level."""
        _demodulate(
            image,
            ceiling,
            self.diagonal,
            self.carrier,
            self.taps,
            self.window,
            self.signs,
            self.blocks,
            self.rows,
            self.peak,
            self.planes,
            self.clipped,
        )


@numba.njit(cache=True, fastmath=FAST)
def accumulate(image: Image, top: int, carrier: Single, sums: Single, peak: Flags) -> None:
    """Sum up one block of rows, two rows per sweep (six accumulators fit the first-level cache)."""
    half, width = carrier.shape[1], sums.shape[1]
    s0, s1, c0, c1, d0, d1 = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    sums[:] = np.float32(0)
    peak[:] = 0
    for y in range(0, half, 2):
        last = min(y + 1, half - 1)
        on = np.float32(last - y)  # an odd block's last sweep has one row only
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
    """Count the pixels at the ceiling per block of one row of blocks; `peak`: each column's brightest."""
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
    a quantity that changes its sign from block to block (the carrier), else 1.
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
def _demodulate(
    image: Image,
    ceiling: int,
    diagonal: bool,
    carrier: Single,
    taps: Single,
    window: Length,
    signs: Single,
    blocks: Single,
    rows: Single,
    peak: Flags,
    planes: Single,
    clipped: NDArray[np.int32],
) -> None:
    half = carrier.shape[1]
    for b in range(clipped.shape[0]):
        accumulate(image, b * half, carrier, blocks[b & 3], peak)
        count_clipped(image, b * half, half, ceiling, peak, clipped[b])
        if b < 3:
            continue
        r = b - 3
        window_rows(blocks[r & 3], blocks[(r + 1) & 3], blocks[(r + 2) & 3], blocks[b & 3], signs, half, rows)
        if diagonal:
            _diagonal_carriers(rows, taps, window, planes, r)
        else:
            _axis_carriers(rows, taps, window, planes, r)
