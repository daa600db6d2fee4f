"""Demodulation: triangle-window sums of grey and grey x carrier at every node, in one pass over the image.

Nodes lie every half period h = P/2, so a window is four blocks of h rows with weights linear in the row,
and the carrier repeats from block to block except for its sign. Per block and column six sums (grey, and grey
times carrier's cosine and sine, each plain and times the row) serve all four windows that share the block.
Every pixel is read once; all further work is on one row per node row.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Image, Ints, Single
from zeromethod.kernels import kernel, piece, read
from zeromethod.sensing.window import triangle

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Fast-math flags that keep infinity and NaN."""

_STRIP_BLOCKS = 16
"""Blocks of rows whose grey levels are converted at a time, so that they stay in the cache."""


class Demodulator:
    """Window sums of grey times the two carriers, of images of one shape.

    nodes: (rows, cols) of measurable nodes. diagonal: carriers along u + v and u - v, else along u and v.
    """

    def __init__(self, nodes: tuple[int, int], period_px: int, *, diagonal: bool) -> None:
        rows, cols = nodes
        half = period_px // 2
        width = half * (cols + 3)
        turn = 2 * np.pi * np.arange(half) / period_px
        phase = 2 * np.pi * np.arange(-period_px, period_px) / period_px
        weight = np.concatenate([[0.0], triangle(period_px)])
        taps = np.stack([weight, weight * np.cos(phase), weight * np.sin(phase)])
        self._taps = taps.astype(np.float32)
        self._carrier = np.stack([np.cos(turn), np.sin(turn)]).astype(np.float32)
        self._diagonal = diagonal
        self._half, self._grey = half, np.zeros((half * _STRIP_BLOCKS, width), np.float32)
        self._blocks = np.zeros((4, 6, width), np.float32)
        self._rows = np.zeros((3, width), np.float32)
        self._planes = np.zeros((5, rows, cols), np.float32)

    def planes(self, image: Image) -> Single:
        """(5, rows, cols) of an image (rows, cols); overwritten by the next call.

        0: mean grey. 1..4: window sums of grey x (cos u, sin u, cos v, sin v), or x (cos(u+v), sin(u+v),
        cos(u-v), sin(u-v)) where diagonal, phases relative to the node.
        """
        out, half, width = self._planes, self._half, self._grey.shape[1]
        tables, count = (self._carrier, self._taps, self._diagonal), out.shape[1] + 3
        for first in range(0, count, _STRIP_BLOCKS):
            last = min(first + _STRIP_BLOCKS, count)
            self._grey[: half * (last - first)] = image[half * first : half * last, :width]
            _demodulate(self._grey, first, last, *tables, self._blocks, self._rows, out)
        if self._diagonal:
            cc, sc, cs, ss = out[1:].copy()
            out[1], out[2], out[3], out[4] = cc - ss, sc + cs, cc + ss, sc - cs
        return out


@piece(fastmath=FAST)
def _accumulate(grey: Single, top: int, carrier: Single, sums: Single) -> None:
    """Sums (6, width) over one block of rows, two rows per sweep (six accumulators fit the L1 cache)."""
    half, width = carrier.shape[1], sums.shape[1]
    s0, s1, c0, c1, d0, d1 = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    sums[:] = np.float32(0)
    for y in range(0, half, 2):
        last = min(y + 1, half - 1)
        on = np.float32(last - y)  # an odd block's last sweep has only one row
        ya, yb = np.float32(y), np.float32(last)
        ca, sa, cb, sb = carrier[0, y], carrier[1, y], carrier[0, last], carrier[1, last]
        row_a, row_b = grey[top + y], grey[top + last]
        for u in range(width):
            a, b = row_a[u], on * row_b[u]
            s0[u] += a + b
            s1[u] += ya * a + yb * b
            c0[u] += ca * a + cb * b
            c1[u] += (ya * ca) * a + (yb * cb) * b
            d0[u] += sa * a + sb * b
            d1[u] += (ya * sa) * a + (yb * sb) * b


@piece(fastmath=FAST)
def _sum_down(a: Single, b: Single, c: Single, d: Single, half: int, out: Single) -> None:
    """Vertical windows (3, width) of grey and of grey x cosine and sine from four blocks' sums.

    Weights are P - |k|; the node is at the third block's first row. A carrier changes its sign from block to
    block.
    """
    h, scale = np.float32(half), np.float32(1.0 / (4 * half * half))
    for k in range(3):
        sign = np.float32(1.0 if k == 0 else -1.0)
        a1, b0, b1 = a[2 * k + 1], b[2 * k], b[2 * k + 1]
        c0, c1, d0, d1 = c[2 * k], c[2 * k + 1], d[2 * k], d[2 * k + 1]
        row = out[k]
        for u in range(row.size):
            other = sign * (h * (b0[u] + d0[u]) + b1[u] - d1[u])
            row[u] = scale * (a1[u] - c1[u] + other + (h + h) * c0[u])


@piece(fastmath=FAST)
def _sum_across(rows: Single, taps: Single, diagonal: bool, planes: Single, r: int) -> None:
    """Horizontal windows of one node row; of grey x one carrier's cosine and sine where not diagonal."""
    weight, cosine, sine = taps[0], taps[1], taps[2]
    first, second, third = rows[0], rows[1] if diagonal else rows[0], rows[2] if diagonal else rows[1]
    by_second, by_third = (cosine, sine) if diagonal else (weight, weight)
    mean, p, q, s, t = planes[0, r], planes[1, r], planes[2, r], planes[3, r], planes[4, r]
    # unsigned: an index that might be negative would not be vectorised
    count = np.uintp(taps.shape[1])
    for j in range(mean.size):
        begin = np.uintp(j) * (count // np.uintp(4))
        a = b = c = d = e = np.float32(0)
        for k in range(count):
            u = begin + k
            a += weight[k] * first[u]
            b += cosine[k] * second[u]
            c += sine[k] * second[u]
            d += by_second[k] * third[u]
            e += by_third[k] * rows[2, u]
        mean[j], p[j], q[j], s[j], t[j] = a, b, c, d, e


@kernel(
    read(numba.float32, 2),
    numba.int64,
    numba.int64,
    read(numba.float32, 2),
    read(numba.float32, 2),
    numba.boolean,
    numba.float32[:, :, ::1],
    numba.float32[:, ::1],
    numba.float32[:, :, ::1],
    fastmath=FAST,
)
def _demodulate(
    grey: Single,
    first: int,
    last: int,
    carrier: Single,
    taps: Single,
    diagonal: bool,
    blocks: Single,
    rows: Single,
    planes: Single,
) -> None:
    """Take in blocks of rows from `first` to before `last`; fill the planes of the nodes that they complete.

    grey: (px, px) begins at the first block. Tables and work space, which is to stay until the last block:
    see `Demodulator`.
    """
    half = carrier.shape[1]
    for block in range(first, last):
        _accumulate(grey, (block - first) * half, carrier, blocks[block & 3])
        if block >= 3:
            r = block - 3
            a, b, c, d = blocks[r & 3], blocks[(r + 1) & 3], blocks[(r + 2) & 3], blocks[block & 3]
            _sum_down(a, b, c, d, half, rows)
            _sum_across(rows, taps, diagonal, planes, r)


def clipped_pixels(image: Image, ceiling: int, nodes: tuple[int, int], half: int) -> Ints | int:
    """Pixels of every node's window, 4 `half` wide, that are at the ceiling: (rows, cols), or 0 of all."""
    rows, cols = nodes[0] + 3, nodes[1] + 3
    above = image[: half * rows]
    if above.max() < ceiling:
        return 0
    v, u = np.divmod(np.flatnonzero(above >= ceiling), image.shape[1])
    block = (v // half * cols + u // half)[u < half * cols]
    blocks = np.bincount(block, minlength=rows * cols).reshape(rows, cols)
    across = np.sum([blocks[:, k : cols - 3 + k] for k in range(4)], axis=0)
    return np.asarray(np.sum([across[k : rows - 3 + k] for k in range(4)], axis=0))
