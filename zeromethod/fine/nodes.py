"""Nodes read by windows in space and time: the coarse reading's lattice, at the last frames' noise."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.signal import savgol_filter

from zeromethod.arrays import Float, Mask, Single
from zeromethod.fine.blend import blend, blended_variance, fine_share
from zeromethod.fine.demodulate import END_FRAMES, Design
from zeromethod.fine.frames import FineFrame, FrameSequence, matvec
from zeromethod.fine.lattice import PixelLattice
from zeromethod.fine.motion import seen_motion
from zeromethod.sensing.window import triangle
from zeromethod.warp.compose import compose
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import MEAN_LOSS, keys
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Role, Warp

_WHOLE_WINDOW = 0.9
"""The same from which pixels alone make a node."""
_SEEN_BY_PIXELS = np.uint16(
    Flag.MODULATION | Flag.LIGHT_LOST | Flag.FOLDED | Flag.UNDRAWABLE | Flag.AMBIGUOUS | Flag.BESIDE_DARK
)
"""Reasons for which a node is left out that need not concern its pixels."""
_PARTS = slice(None), slice(END_FRAMES), slice(-END_FRAMES, None), slice(-1, None)
"""All frames, and those of `Demodulated.ends`."""
_LEAST_WINDOW = 0.3
"""Share of a sensing window's pixels that must be usable for its mean to count."""
_SHOWN_NOISE2, _POOL_NODES = 0.11, 9
"""Variance of the shown warp over that of one frame at rest (`control.composition`), and the nodes along each
side over which it is judged."""
_SMOOTH_NODES, _SMOOTH_DEGREE = 17, 2
"""Nodes, and degree of the polynomial, by which the shown warp is smoothed: waves of 16 nodes pass whole."""


@dataclass(frozen=True, slots=True)
class NodeWindows:
    """Nodes (rows, cols) by both windows, and what the pixels are seen against.

    warp: measured, blended. shown: (rows, cols, 2) the frames' mean. offset: (rows, cols, 2) LCD px to add to
    shown o (id + d), with the pixels' d. window: (rows, cols, 2) their mean over each node's window, LCD px,
    the blended one where there is none. share: (rows, cols) of what pixels see beyond the nodes, as they see
    it in the mean of the frames. bending: (rows, cols, 2, 2) Jacobian of the shown warp. moved2: (4, rows,
    cols, 2) variance of where they saw the picture, camera px^2: in all frames, and where those of
    `Demodulated.ends` are further off in these; 0 where it was not seen.
    """

    warp: Warp
    shown: Float
    offset: Float
    window: Float
    share: Float
    bending: Float
    moved2: Float


def read_nodes(
    lattice: PixelLattice,
    frames: Sequence[FineFrame],
    sequence: FrameSequence,
    design: Design,
    late_s: Float,
    d: Single,
    variance: Single,
    usable: Mask,
    standing: Mask,
) -> NodeWindows:
    """Blend of the newest frame's nodes with window means of the fit of all frames, and what has moved since.

    sequence, design: of the frames, whose pictures came late by late_s (N, image rows). d, variance: (rows,
    cols, 2) of the pixels between the nodes, camera px and px^2, of which `usable` (rows, cols) are;
    `standing`: whose frames agree with each other.
    """
    grid, newest = lattice.grid, frames[-1].measured
    per_rad = grid.period_px / (2 * np.pi)
    shown, bending = sequence.shown, sequence.bending
    # what the fit took for the mean: displacements against each frame's own warp and phases
    excess = np.einsum("kt,trck->rck", design.weights, sequence.apart)
    added = sum(frame.measured.q - compose(frame.shown, frame.d, grid.spacing_px) for frame in frames)
    added_mean = np.nan_to_num(np.asarray(added) / len(frames))
    means, part = lattice.window_means(d, usable)
    inner_d = np.where((part > _LEAST_WINDOW)[..., None], means - excess[grid.inner], np.nan)
    fine = compose(shown, grid.padded(inner_d, np.nan), grid.spacing_px) + added_mean
    noise2 = np.mean([frame.measured.sigma**2 for frame in frames], axis=0)
    fine -= _remembered(shown - matvec(bending, excess), noise2, grid)
    rows = np.clip(grid.v_px, 0, grid.image_shape[0] - 1).astype(int)
    per_late = per_rad * np.stack([frame.node_late_rad_per_s for frame in frames])
    coarse = np.stack([frame.measured.q for frame in frames])
    coarse -= matvec(bending, late_s[:, rows, None, None] * per_late)
    valid = np.logical_and.reduce([frame.measured.valid for frame in frames])
    across = np.asarray(np.linalg.inv(bending), np.float64)
    turns = np.stack([one.phase_rad[rows] for one in sequence.steps])
    d_variance = matvec(across * across, noise2)
    times = np.array([frame.measured.time_ns for frame in frames], np.float64)
    places = matvec(across, coarse - shown)
    seen, motion = seen_motion(places, per_late, d_variance, valid, turns, times, design.weights)
    moved2 = _moved2(
        places + sequence.apart, np.stack([frame.measured.valid for frame in frames]), d_variance
    )
    known = np.isfinite(fine).all(axis=-1)
    # the pixels' mean is late by what the nodes' fit is ahead of it
    share, fitted = (np.where(known, fine_share(seen, degree), 0.0) for degree in (0, motion.degree))
    # what is too fine or steep for a window may still be seen pixel by pixel
    still, _ = lattice.window_means(standing[..., None].astype(np.float32), usable)
    by_pixels = grid.padded((part > _WHOLE_WINDOW) & (still[..., 0] > _WHOLE_WINDOW), False)
    by_pixels &= ~valid & (newest.flags & _SEEN_BY_PIXELS == newest.flags) & known
    share[by_pixels] = 1.0
    pixels2, _ = lattice.window_means(variance, usable)
    gain = float((triangle(grid.period_px) ** 2).sum()) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        window2 = grid.padded(gain * pixels2 / part[..., None], np.nan)
        fine2 = matvec(bending * bending, window2)
        now2 = fine2 + matvec(bending * bending, motion.excess * d_variance)
    q = blend(coarse[-1], fine + matvec(bending, motion.ahead), fitted)
    sigma = np.sqrt(blended_variance(newest.sigma**2, now2, fitted, float(motion.ends[-1])))
    flags = np.where(by_pixels, np.uint16(0), newest.flags)
    sigma = np.where(by_pixels[..., None], np.sqrt(np.maximum(fine2, 0.0)), sigma)
    q = np.where(by_pixels[..., None], fine, q)
    warp = replace(newest, q=q, sigma=sigma, flags=flags, role=Role.MEASURED, left=None)
    offset = added_mean - matvec(bending, excess)
    return NodeWindows(warp, shown, offset, np.where(np.isfinite(fine), fine, q), share, bending, moved2)


def _moved2(places: Float, valid: Mask, variance: Float) -> Float:
    """`NodeWindows.moved2` of places (N, rows, cols, 2) in the frames where they are valid, (N, rows, cols).

    variance: (rows, cols, 2) of one frame's; as much as two standard deviations of a usual node is no motion.
    """
    off = np.where(valid[..., None], places, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # nodes that were never valid
        off2 = (off - np.nanmean(off, axis=0)) ** 2
        each = [np.nanmean(off2[part], axis=0) for part in _PARTS]
    usual = variance[np.isfinite(variance).all(axis=-1)]
    noise2 = 4.0 * np.median(usual, axis=0) if len(usual) else 0.0
    return np.asarray(np.nan_to_num(np.maximum(np.maximum(each, each[0]) - noise2, 0.0)), np.float64)


def _remembered(shown: Float, noise2: Float, grid: NodeGrid) -> Float:
    """Noise of earlier frames that nodes have from the shown warp, LCD px; all (rows, cols, 2).

    Of what is shown only the window's mean, W, is measured against it: the rest, 1 - W, stays. That is noise
    where the shown warp is no rougher than the loop leaves it under noise, else the mirror's own shape.

    noise2: variance of one frame's nodes.
    """
    rows, cols = (2 * ((min(_SMOOTH_NODES, n) - 1) // 2) + 1 for n in shown.shape[:2])
    smooth = savgol_filter(shown, rows, min(_SMOOTH_DEGREE, rows - 1), axis=0)
    rough = shown - savgol_filter(smooth, cols, min(_SMOOTH_DEGREE, cols - 1), axis=1)
    taps = _window_taps(grid.period_px, grid.spacing_px)
    left = rough - np.asarray(cv2.sepFilter2D(rough, -1, taps, taps, borderType=cv2.BORDER_REFLECT))
    sums = ((rough**2).sum(axis=-1), _SHOWN_NOISE2 * noise2.sum(axis=-1))
    seen2, likely2 = (np.where(np.isfinite(sums[1]), one, 0.0) for one in sums)
    pooled = (np.asarray(cv2.blur(one, (_POOL_NODES, _POOL_NODES))) for one in (likely2, seen2))
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.minimum(np.nan_to_num(np.divide(*pooled)), 1.0)
    return np.asarray(left * share[..., None])


def _window_taps(period_px: int, spacing_px: int) -> Float:
    """Weights of nodes in the window's mean of the picture that is drawn of them, along one axis."""
    reach = (period_px - 1) // spacing_px + 4
    taps = np.zeros(2 * reach + 1)
    for offset, weight in zip(range(1 - period_px, period_px), triangle(period_px), strict=True):
        node, within = divmod(offset, spacing_px)
        taps[reach + node - 1 : reach + node + 3] += weight * np.array(keys(within / spacing_px))
    fourth = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    return np.asarray(taps + MEAN_LOSS * np.convolve(taps, fourth, "same"))
