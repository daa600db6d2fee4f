"""How deep the deepest of many nodes seems where nothing presses."""

from __future__ import annotations

import math

_ALIKE_NODES2 = 1.5
"""Squared length, nodes, of noise whose correlation exp(-r^2 / 2 length^2) is that of overlapping windows at
half a period per node, 0.72 from node to node (`zeromethod.warp.overlap`). That of depth is longer."""


def by_chance_mm(depth_mm: float, sigma_mm: float, nodes: int) -> float:
    """Standard deviation of a peak's depth because it is the largest of many nodes', mm.

    In a smooth random field of that length, 2 nodes / length^2 (2 pi)^-1.5 z exp(-z^2 / 2) peaks and dips are
    expected beyond z sigma. With the probability that there is one where nothing presses, it is all of depth.
    """
    if not sigma_mm > 0.0:
        return 0.0
    z = max(abs(depth_mm) / sigma_mm, 1.0)
    expected = 2.0 * nodes / _ALIKE_NODES2 * (2.0 * math.pi) ** -1.5 * z * math.exp(-0.5 * z * z)
    return math.sqrt(-math.expm1(-expected)) * abs(depth_mm)
