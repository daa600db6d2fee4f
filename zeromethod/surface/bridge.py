"""Depth of nodes that a gap cuts off: parts behind a fold, tied by the slopes on either side.

The rim of a ball's contact bends the rubber so much that the image folds back along a closed ring. No picture
nulls a folded node, so that none is measured there; inside the ring all are, and their depth follows from the
steps over the gap (`zeromethod.surface.gaps`). The sigma of these counts as fully correlated around the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from zeromethod.arrays import Float, Mask
from zeromethod.surface.gaps import Gaps, gaps_between
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.rays import MirrorRays

_LEAST_NODES, _MOST_PARTS = 12, 3
"""Nodes of the smallest part that is tied, and how many parts are: smaller ones are specks at the fold."""
_LEAST_GAPS = 3
"""Gaps by which a part must be tied: their scatter is in its sigma."""
_PASSES, _SETTLED_MM = 20, 1e-7
"""Most passes of slope and depth, and the change of depth that ends them."""


@dataclass(frozen=True, slots=True)
class ReadNodes:
    """Depth (rows, cols) in mm, slope (rows, cols, 2) and mirror points (rows, cols, 3) of all nodes."""

    depth: Float
    slope: Float
    point: Float

    def copy(self) -> ReadNodes:
        """Copy of all arrays."""
        return ReadNodes(self.depth.copy(), self.slope.copy(), self.point.copy())


@dataclass(frozen=True, slots=True)
class CutOff:
    """Nodes (rows, cols) behind gaps and the lattice as read there.

    sigma_mm: (rows, cols) due to the gap, noise not included.
    """

    nodes: Mask
    read: ReadNodes
    sigma_mm: Float


def cut_off_parts(usable: Mask, island: Mask) -> list[Mask]:
    """Up to three largest sets of connected usable nodes (rows, cols) off the largest, the `island`."""
    off = usable & ~island
    if np.count_nonzero(off) < _LEAST_NODES:
        return []
    labels, count = ndimage.label(off)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    largest = np.argsort(sizes)[::-1][:_MOST_PARTS]
    return [labels == k + 1 for k in largest if sizes[k] >= _LEAST_NODES]


def bridge(
    rays: MirrorRays,
    q: Float,
    variance: Float,
    scale: Float,
    island: Mask,
    others: list[Mask],
    read: ReadNodes,
) -> CutOff | None:
    """Depth of the `others`, tied over their gaps to the island as read; None where no gap is narrow enough.

    q: (rows, cols, 2) LCD px. variance: (rows, cols, 2) of slope. scale: h (rows, cols).
    """
    read = read.copy()
    nodes, sigma = np.zeros(island.shape, bool), np.zeros(island.shape)
    for other in others:
        sigma_mm = _tie(rays, q, variance, scale, other, gaps_between(island, other), read)
        if sigma_mm is not None:
            nodes |= other
            sigma[other] = sigma_mm
    return CutOff(nodes, read, sigma) if nodes.any() else None


def _tie(
    rays: MirrorRays, q: Float, variance: Float, scale: Float, other: Mask, gaps: Gaps, read: ReadNodes
) -> float | None:
    """Read one part, tied over its gaps, into `read`; returns its sigma in mm, None where nothing ties it."""
    box = ndimage.find_objects(other.astype(np.intp))[0]
    if len(gaps) < _LEAST_GAPS or min(other[box].shape) < 2:
        return None
    depth, slope, point = read.depth, read.slope, read.point
    mine, own_rays = other[box], rays.part(box)
    integrator = SlopeIntegrator(point[box][..., 0], point[box][..., 1], scale[box])
    integrator.prepare(mine, variance[box])
    depth[other] = float(np.mean(depth[gaps.near]))
    sigma_mm = np.inf
    for _ in range(_PASSES):
        inside = np.where(mine, depth[box], 0.0)
        slopes, points = own_rays.slope(inside, q[box])
        if not np.isfinite(slopes[mine]).all():
            return None
        slope[box][mine], point[box][mine] = slopes[mine], points[mine]
        new = np.zeros_like(depth)
        new[box] = scale[box] * integrator.integrate(slopes, points[..., 0], points[..., 1], inside)
        offset, sigma_mm = _offset(gaps, depth + new, scale, slope, point)
        change = (new + scale * offset)[other]
        depth[other] += change
        if float(np.max(np.abs(change))) < _SETTLED_MM:
            break
    return sigma_mm


def _offset(gaps: Gaps, depth: Float, scale: Float, slope: Float, point: Float) -> tuple[float, float]:
    """Multiple of h by which the far nodes must move, and the standard deviation of their depth, mm."""
    step, spread = gaps.steps(slope, point)
    weight = 1.0 / spread**2
    wanted = (depth[gaps.near] + step - depth[gaps.far]) / scale[gaps.far]
    offset = float((weight * wanted).sum() / weight.sum())
    scatter = float((weight * (wanted - offset) ** 2).sum() / weight.sum())
    return offset, float(np.sqrt(len(weight) / weight.sum() + scatter))
