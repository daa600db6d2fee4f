"""Figures of all nodes of a frame: left to null, seen, away from rest."""

from __future__ import annotations

import math

import cv2
import numpy as np

from zeromethod.arrays import Flags, Float, Mask
from zeromethod.warp.components import largest_change, squared_length
from zeromethod.warp.validity import Flag

_LIGHT_LOST, _CODED = np.uint16(Flag.LIGHT_LOST), np.uint16(Flag.CODED)


def node_figures(d: Float, nulled: Mask, valid: Mask, seen: Mask, flags: Flags) -> tuple[float, float, float]:
    """(mean square length of d over nulled nodes; valid share of the seen ones, and that without light).

    flags: of the measured warp. A node that sees coded pictures may look dark and be lit.
    """
    squares = squared_length(d)[nulled]
    dark = flags & (_LIGHT_LOST | _CODED) == _LIGHT_LOST
    wanted = max(int(np.count_nonzero(seen)), 1)
    shares = int(np.count_nonzero(valid & seen)) / wanted, int(np.count_nonzero(dark & seen)) / wanted
    return float(squares.mean()) if len(squares) else math.nan, *shares


def quiet_share(q: Float, before: Float, flags: Flags, apart: Mask, within: float) -> float:
    """Share of the valid nodes not apart that have moved by less, LCD px; 0 where there are none."""
    nodes = (flags == 0) & ~apart
    quiet = nodes & (largest_change(q, before) < within)
    return int(np.count_nonzero(quiet)) / max(int(np.count_nonzero(nodes)), 1)


def block_sums(values: Float, side: int, step: int) -> Float:
    """Sums of nodes (rows, cols) or (rows, cols, 2) in blocks of `side` that begin every `step` nodes."""
    size, beyond = (side, side), cv2.BORDER_CONSTANT
    sums = cv2.boxFilter(values, -1, size, anchor=(0, 0), normalize=False, borderType=beyond)
    return np.asarray(sums[::step, ::step], np.float64)


def at_rest(
    q: Float, q_rest: Float, sigma: Float, valid: Mask, half: int, sigmas: float, within: float
) -> bool:
    """Whether displacements, LCD px, are noise: in every block, without the largest quarter of its nodes.

    That leaves out dirt, which moves fewer nodes than a press of rubber does. A block, 2 `half` nodes on a
    side and `half` from the next, is off where the root of its mean square per component is above so many
    sigmas and `within`.
    """
    squares = np.where(valid, 0.5 * squared_length(q - q_rest), 0.0)
    noise = 0.5 * squared_length(sigma)[valid].sum() / max(np.count_nonzero(valid), 1)
    limit = (sigmas * math.sqrt(noise) + within) ** 2
    nodes = block_sums(valid.astype(float), 2 * half, half)
    off = (block_sums(squares, 2 * half, half) > limit * nodes) & (nodes > 0)
    down, across = (max(size - 1, 1) for size in off.shape)  # the last one lies within the one before
    for top, left in half * np.argwhere(off[:down, :across]):
        here = slice(top, top + 2 * half), slice(left, left + 2 * half)
        least = np.sort(squares[here][valid[here]])
        if least[: len(least) - len(least) // 4].mean() > limit:
            return False
    return True
