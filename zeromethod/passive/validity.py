"""Which points of a matched field may be trusted, and why not the others."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Float, Mask
from zeromethod.passive.cells import XX, XY, YY, X, Y
from zeromethod.passive.displacement import PointFlag
from zeromethod.passive.matching import LIGHT_PX, CellMatches
from zeromethod.passive.moving_fit import blur, moving_moments
from zeromethod.surface.integrate import largest_island
from zeromethod.warp.continuation import continue_smoothly

WEAK_PX = 0.25
"""Largest standard deviation of a point that still counts as measured."""

UNSETTLED_PX = 0.2
"""Last change of the field up to which grey levels are straight enough between the two (or `_SIGMAS`)."""

_SIGMAS = 3.0
"""Standard deviations beyond which a difference is no noise."""

ASIDE = 1.3
"""Distance to the middle of the texture near a point, per width of the window: 7 px outside of an edge."""

_AREA_PX = 15.0
"""Side of the squares that have texture or have none."""

_ENDS_PX = 15.0
"""Distance from the ends of the texture within which a frame that stands still may be in the window."""
REST_PX = 0.05
"""Displacement (or 3 sigma) up to which a point is at rest in any case: far less than a period."""

_LINEAR_PX = 4.0
"""Motion up to which gradients predict the difference that a content at rest shows; beyond, it does not
match."""
_EMPTY = 0.05
"""Squared gradients around a point, over their upper quartile, below which there is no texture."""

LEAST_STRETCH, MOST_STRETCH = 0.3, 3.0
"""Local magnifications beyond these are a fold, or a jump to another period, rather than a picture."""


def stretch(field: Float, spacing_px: float) -> tuple[Float, Float]:
    """Least and largest magnification (rows, cols) from reference to image, by the field's differences.

    They are the singular values of I + grad d; the least is negative where the picture is turned over.
    """
    by_row = np.asarray(np.gradient(field, spacing_px, axis=0))
    by_col = np.asarray(np.gradient(field, spacing_px, axis=1))
    a, b, c, d = 1.0 + by_col[..., 0], by_row[..., 0], by_col[..., 1], 1.0 + by_row[..., 1]
    both = 0.5 * np.hypot(a + d, b - c)
    apart = 0.5 * np.hypot(a - d, b + c)
    return both - apart, both + apart


def _next_to_jump(field: Float, spacing_px: float) -> Mask:
    """Points (rows, cols) that differ from a neighbour by more than the distance to it."""
    out = np.zeros(field.shape[:2], dtype=bool)
    down = np.abs(np.diff(field, axis=0)).max(axis=-1) > spacing_px
    across = np.abs(np.diff(field, axis=1)).max(axis=-1) > spacing_px
    out[:-1] |= down
    out[1:] |= down
    out[:, :-1] |= across
    out[:, 1:] |= across
    return out


def unsettled(sigma: Float, step: Float) -> Mask:
    """Points (rows, cols) whose last change, step (rows, cols) px, was too large for their sigma (..., 2)."""
    return np.asarray(~(step <= np.maximum(UNSETTLED_PX, _SIGMAS * _worst(sigma))))


def _worst(sigma: Float) -> Float:
    return np.asarray(np.where(np.isfinite(sigma).all(axis=-1), sigma.max(axis=-1), np.inf))


def weak(sigma: Float) -> Mask:
    """Points (rows, cols) whose sigma (rows, cols, 2) px is too large, or not known."""
    return np.asarray(~(_worst(sigma) <= WEAK_PX))


def featureless(comparison: CellMatches, noise: Float, spacing_px: float) -> Mask:
    """Cells (rows, cols) in an area without more squared gradients than `noise` (rows, cols) makes.

    They say nothing of the displacement, but far from a window's middle their noise would weigh heavily.
    """
    around = 2 * max(round(0.5 * (_AREA_PX / spacing_px - 1.0)), 0) + 1
    found, made, pixels = (
        cv2.boxFilter(np.nan_to_num(field), -1, (around, around), normalize=False)
        for field in (comparison.sums[..., XX] + comparison.sums[..., YY], 2.0 * noise, comparison.pixels)
    )
    # The sum of so many squares, along both axes and shared by neighbours, scatters by sqrt(2 / pixels).
    return np.asarray(found < (1.0 + _SIGMAS * np.sqrt(2.0 / np.maximum(pixels, 1.0))) * made)


def ends(texture: Float, shown: Mask, spacing_px: float) -> Mask:
    """Points (rows, cols) less than `_ENDS_PX` inside of the texture's ends, or outside of it.

    texture: see `aside`. shown: cells that both images show.
    """
    window = (LIGHT_PX / spacing_px, LIGHT_PX / spacing_px)
    seen = np.maximum(blur(shown.astype(np.float64), window), 1e-9)
    near = blur(np.where(shown, texture, 0.0), window) / seen
    empty = shown & (near < _EMPTY * np.percentile(near[shown], 75.0)) if shown.any() else shown
    # The window itself reaches 20 px beyond the texture.
    reach = round((2.0 * LIGHT_PX + _ENDS_PX) / spacing_px)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(cv2.dilate(empty.astype(np.uint8), disc) > 0)


def standing(
    comparison: CellMatches, field: Float, sigma: Float, textured: Mask, of_noise: Float, spacing_px: float
) -> tuple[Mask, Mask]:
    """Cells (rows, cols) at the texture's `ends` whose content stands still, as a frame's edge does.

    And those that say nothing of the light, either: they, and what a frame covers or uncovers.

    field, sigma: (rows, cols, 2) px, of the comparison and of the fit before. textured: cells with texture.
    of_noise: (rows, cols) squared gradients that noise makes. What gradients g leave of a content at rest,
    compared as if it had moved by d as the texture inside has, is -g d: projected on g d it is 1 there, and
    0 where the content has moved. Cells are judged each, and, as an edge is faint, with those around.
    """
    sums = comparison.sums
    texture = sums[..., XX] + sums[..., YY] - 2.0 * of_noise
    close = ends(np.where(comparison.alike, texture, 0.0), comparison.shown, spacing_px)
    inside = textured & ~close
    if not inside.any():
        return np.zeros_like(close), np.zeros_like(close)
    moved = continue_smoothly(field, inside)
    (x, y), (dx, dy) = np.moveaxis(moved, -1, 0), np.moveaxis(moved - field, -1, 0)
    xx, xy, yy = (sums[..., k] for k in (XX, XY, YY))
    energy = xx * x**2 + 2.0 * xy * x * y + yy * y**2
    left = x * (xx * dx + xy * dy - sums[..., X]) + y * (xy * dx + yy * dy - sums[..., Y])
    noise = energy * comparison.grey_variance
    size = np.hypot(x, y)
    # Without what has been found to stand still, the fit next to it hardly knows how far all has moved.
    known = continue_smoothly(sigma, inside & np.isfinite(sigma).all(axis=-1)).max(axis=-1)
    matters = (size > np.maximum(REST_PX, _SIGMAS * known)) & (size < _LINEAR_PX)
    around = 2 * max(round(0.5 * (_AREA_PX / spacing_px - 1.0)), 0) + 1
    # What clearly moves, as a dot, would hide a frame's fainter edge next to it.
    moves = energy - left > np.maximum(_SIGMAS * np.sqrt(np.maximum(noise, 0.0)), 0.5 * energy)
    unclear = [
        np.asarray(
            cv2.boxFilter(np.nan_to_num(np.where(moves, 0.0, one)), -1, (around, around), normalize=False),
            np.float64,
        )
        for one in (energy, left, noise)
    ]
    still = close & matters & (_stands(energy, left, noise) | _stands(*unclear))
    covered = close & (size >= _LINEAR_PX) & comparison.shown & ~comparison.alike
    return np.asarray(still), np.asarray(still | covered)


def _stands(energy: Float, left: Float, noise: Float) -> Mask:
    """Where what is left is that of a content at rest, rather than of one that moves: see `standing`."""
    return np.asarray((left > _SIGMAS * np.sqrt(np.maximum(noise, 0.0))) & (left > 0.5 * energy))


def at_ends(field: Float, close: Mask, spacing_px: float) -> Float:
    """Standard deviation (rows, cols) px to add close to the `ends` of the texture; 0 elsewhere.

    There an edge may stand still (a frame's) while the texture moves, or the field be carried on from one
    side: how the field (rows, cols, 2) px differs from a plane within `_ENDS_PX` may not be the picture's.
    """
    size = 2 * round(_ENDS_PX / spacing_px) + 1
    out: Float = np.zeros(field.shape[:2])
    for c in range(2):
        component = np.ascontiguousarray(field[..., c])
        trend = cv2.blur(component, (size, size), borderType=cv2.BORDER_REPLICATE)
        out = np.maximum(out, np.abs(component - trend))
    return np.where(close, cv2.dilate(out, np.ones((size, size), np.uint8)), 0.0)


def aside(texture: Float, spacing_px: float) -> Mask:
    """Points (rows, cols) that lie outside of all texture: nothing, or only what is on one side, is near.

    texture: (rows, cols) squared gradients of the cells, noise taken out.
    """
    window = (LIGHT_PX / spacing_px, LIGHT_PX / spacing_px)
    moments = np.empty((2, 2, *texture.shape))
    moving_moments(texture, window, 1, moments)
    total = np.where(moments[0, 0] > 0.0, moments[0, 0], np.nan)
    middle = np.hypot(moments[1, 0] / total, moments[0, 1] / total)
    return np.asarray(~(middle * spacing_px < ASIDE * LIGHT_PX))


def doubts(field: Float, sigma: Float, step: Float, shown: Mask, alike: Mask, spacing_px: float) -> Bytes:
    """`PointFlag` bits (rows, cols) of a field (rows, cols, 2) px with points spacing_px apart.

    sigma (rows, cols, 2) px. step (rows, cols) px: the last change of the field. shown: cells that both
    images show. alike: cells whose grey levels match.
    """
    least, most = stretch(field, spacing_px)
    found = {
        PointFlag.OUTSIDE: ~shown,
        PointFlag.MISMATCH: shown & ~alike,
        PointFlag.TEXTURE: shown & weak(sigma),
        PointFlag.UNSETTLED: shown & unsettled(sigma, step),
        PointFlag.ORDER: (least < LEAST_STRETCH) | (most > MOST_STRETCH) | _next_to_jump(field, spacing_px),
    }
    out = np.zeros(shown.shape, dtype=np.uint8)
    for doubt, where in found.items():
        out[where] |= np.uint8(doubt)
    sound = out == 0
    out[sound & ~largest_island(sound)] |= np.uint8(PointFlag.ORDER)
    return out
