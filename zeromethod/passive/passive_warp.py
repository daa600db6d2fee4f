"""From a displacement against the picture at rest to the warp that the bench's reading takes."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Optics
from zeromethod.passive.displacement import Displacement, PointFlag
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import sample
from zeromethod.warp.overlap import overlap_correlation, shared_nodes
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_ROUNDS, _SETTLED_PX = 60, 1e-6
"""Most steps of the fixed point, and the change that ends them."""
_ROUND_IT = 0.8
"""Share of the 5 x 5 points around one that is badly determined which must be valid."""


def _readable(displacement: Displacement) -> Mask:
    """Points (rows, cols) to interpolate between: those valid, and single ones among them that are less sure.

    Without these, each would take a dozen nodes away. What is not sure of them is in their sigma.
    """
    found = displacement.doubts & ~np.uint8(PointFlag.TEXTURE | PointFlag.UNSETTLED)
    around = cv2.blur(displacement.valid.astype(np.float64), (5, 5), borderType=cv2.BORDER_CONSTANT)
    unsure = (found == 0) & (around > _ROUND_IT) & np.isfinite(displacement.sigma)
    return np.asarray(displacement.valid | unsure)


def _differences(q: Float, axis: int) -> Float:
    """Change of q (rows, cols, 2) per node: central, one-sided next to nodes that are NaN."""
    step = np.diff(q, axis=axis)
    edge = np.full_like(np.take(q, [0], axis=axis), np.nan)
    before, after = np.concatenate((edge, step), axis=axis), np.concatenate((step, edge), axis=axis)
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    return np.asarray(0.5 * (before + after))


def rest_pixels(displacement: Displacement, u: Float, v: Float) -> Float:
    """Reference pixel (..., 2) that shows at rest what the image shows at pixel (u, v).

    Solves x + d(x) = (u, v) by fixed point, d being interpolated by the system's cubic. NaN where it leaves
    the valid points, or does not settle because the picture is folded.
    """
    field = np.where(_readable(displacement)[..., None], displacement.field, np.nan)
    # The start may lie where nothing is valid while the answer does not: it follows the smooth guess.
    x, y = u.astype(np.float64), v.astype(np.float64)
    smooth = displacement.field
    limits = smooth.shape[1::-1]
    for _ in range(_ROUNDS):
        # a position is first moved inside what can be interpolated
        inside = (np.clip(at, 1.0, n - 2.0) for at, n in zip(displacement.place(x, y), limits, strict=True))
        shift = sample(smooth, *inside)
        moved = np.hypot(u - shift[..., 0] - x, v - shift[..., 1] - y)
        x, y = u - shift[..., 0], v - shift[..., 1]
        if np.max(moved) < _SETTLED_PX:
            break
    known = np.isfinite(sample(field, *displacement.place(x, y))).all(axis=-1) & (moved < 1e3 * _SETTLED_PX)
    return np.where(known[..., None], np.stack([x, y], axis=-1), np.nan)


def measured_warp(displacement: Displacement, optics: Optics, grid: NodeGrid) -> Warp:
    """Warp that the image shows, by the rig's rest map at the pixels where its parts came from.

    q(u, v) = q_rest(x): an image pixel (u, v) looks where the reference pixel x with x + d(x) = (u, v) did.
    Sigma is such that averages over many nodes come out with the noise they have: the reading counts errors
    as shared by the nodes of one target period, while those of image correlation reach as far as its windows.
    """
    u, v = grid.mesh()
    pixel = rest_pixels(displacement, u, v)
    q = optics.rest_map(pixel[..., 0], pixel[..., 1])
    by_v, by_u = (_differences(q, axis) / grid.spacing_px for axis in (0, 1))
    # as many points as the nodes' own window reaches
    counted_px2 = shared_nodes(overlap_correlation(grid.period_px, grid.spacing_px)) * grid.spacing_px**2
    scale = np.sqrt(displacement.noise_area_px2 / counted_px2)
    spread = np.stack([displacement.sigma_u * scale, displacement.sigma_v * scale], axis=-1)
    noise = np.abs(sample(spread, *displacement.place(pixel[..., 0], pixel[..., 1])))
    sigma = np.sqrt((by_u * noise[..., :1]) ** 2 + (by_v * noise[..., 1:]) ** 2)
    unmatched = np.isnan(pixel[..., 0])
    no_ray = ~unmatched & np.isnan(q[..., 0])
    unknown = unmatched | (~no_ray & np.isnan(sigma).any(axis=-1))
    reasons = (~grid.measurable, Flag.OUTSIDE), (unknown, Flag.MODULATION), (no_ray, Flag.NO_RAY)
    flags = np.select([mask for mask, _ in reasons], [np.uint16(flag) for _, flag in reasons], np.uint16(0))
    return Warp(q, sigma, flags, 0)
