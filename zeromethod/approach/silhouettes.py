"""Silhouettes of objects before the background, in one view of the watch camera.

The background is a running median: in each frame, each pixel's value moves towards what is seen by a small
fixed step. Where an object is seen the step is a 25th of that: an object that hangs still for a minute
becomes background, one that comes slowly does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single

STEP_GREY, HELD_GREY = 0.5, 0.02
"""Step of the background in a frame, grey levels: where nothing is seen before it, and where something is."""
SIGMAS, LEAST_SHARE = 6.0, 0.07
"""An object differs from the background by at least so many sigmas of the noise, and by at least such a share
of the view's mean."""
LEAST_PX, MOST = 3, 5
"""Pixels of the smallest silhouette; only so many of the largest ones are used."""
RIM_PX = 4
"""Pixels around a silhouette that belong to its window."""
_NEAR = np.ones((5, 5))
SOME = 7
"""Every so many-th pixel is enough for a median of the view."""


@dataclass(frozen=True, slots=True)
class Silhouette:
    """One object before the background, in a window (rows, cols) of the view that is somewhat larger.

    cover: share of each pixel that it covers, roughly. seen_grey: what is seen, less the background, which is
    behind_grey. noise_grey: of one pixel. darker: than the background. cut: it reaches beyond the view;
    aside: beyond its left or right end.
    """

    rows: slice
    cols: slice
    cover: Float
    seen_grey: Float
    behind_grey: Float
    noise_grey: float
    darker: bool
    cut: bool
    aside: bool


class Background:
    """Running median of one view; finds what differs from it."""

    def __init__(self, valid: Mask) -> None:
        """valid: (rows, cols) pixels that see through the mirror."""
        self._valid = valid
        self._sides, self._ends = (_rim(valid, kernel) for kernel in (np.ones((1, 3)), np.ones((3, 1))))
        self._some = np.flatnonzero(valid)[::SOME]
        self._some_steps = np.flatnonzero(valid[:, 1:] & valid[:, :-1])[::SOME]
        self._median: Single | None = None
        self._noise_grey = 3.0

    def look(self, grey: Single) -> list[Silhouette]:
        """Silhouettes; grey: (rows, cols) above black."""
        if self._median is None:
            self._median = grey.copy()
            return []
        mean = max(float(np.median(self._median.ravel()[self._some])), 1.0)
        level = max(float(np.median(grey.ravel()[self._some])) / mean, 0.05)
        off = np.where(self._valid, grey * np.float32(1.0 / level) - self._median, np.float32(0.0))
        noise = 1.48 * float(np.median(np.abs(off.ravel()[self._some])))
        self._noise_grey += 0.05 * (min(noise, 2 * self._noise_grey) - self._noise_grey)
        # differences of neighbours are free of soft shadows: what is left is the noise of a pixel
        steps = np.abs(np.diff(off, axis=1)).ravel()[self._some_steps]
        pixel_noise = max(1.05 * float(np.median(steps)), 0.3)
        least = max(SIGMAS * self._noise_grey / 3.0, LEAST_SHARE * mean)
        # means of 3 x 3 pixels, with a third of the noise
        stands = (np.abs(cv2.blur(off, (3, 3))) > least).astype(np.uint8)
        if not stands.any():
            self._median += np.clip(off, -STEP_GREY, STEP_GREY)
            return []
        step = np.where(cv2.dilate(stands, _NEAR) > 0, np.float32(HELD_GREY), np.float32(STEP_GREY))
        self._median += np.clip(off, -step, step)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(stands, connectivity=8)
        largest = 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:MOST]
        return [
            self._silhouette(off, self._median, least, pixel_noise, labels == k, stats[k])
            for k in largest
            if stats[k, cv2.CC_STAT_AREA] >= LEAST_PX
        ]

    def _silhouette(
        self, off: Single, background: Single, least: float, noise: float, own: Mask, stats: Float
    ) -> Silhouette:
        """Of the pixels `own` (rows, cols). stats: of OpenCV's connected components."""
        left, top, width, height = (int(stats[k]) for k in range(4))
        rows = slice(max(top - RIM_PX, 0), min(top + height + RIM_PX, off.shape[0]))
        cols = slice(max(left - RIM_PX, 0), min(left + width + RIM_PX, off.shape[1]))
        inside, window = own[rows, cols].astype(np.uint8), (rows, cols)
        seen, behind = off[window].astype(np.float64), background[window].astype(np.float64)
        darker = float(seen[inside > 0].mean()) < 0
        core = cv2.erode(inside, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        whole = core if core.sum() >= LEAST_PX else inside > 0
        # the object's own light, by a quantile: a small one covers hardly a pixel as a whole
        share = 0.2 if core.sum() >= LEAST_PX else 0.1
        own_grey = float(np.quantile((seen + behind)[whole], share if darker else 1.0 - share))
        full = np.minimum(own_grey - behind, -least) if darker else np.maximum(own_grey - behind, least)
        # negative shares beside it stay, so that noise averages out; inside it all is covered, in any shade
        cover = np.where(cv2.dilate(inside, _NEAR) > 0, np.minimum(seen / full, 1.0), 0.0)
        aside = bool((own & self._sides).any())
        cut = aside or bool((own & self._ends).any())
        return Silhouette(rows, cols, np.where(core, 1.0, cover), seen, behind, noise, darker, cut, aside)


def _rim(valid: Mask, kernel: Float) -> Mask:
    """Valid pixels next to invalid ones, or to the image's border, within the kernel."""
    inner = cv2.erode(valid.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(valid & (inner == 0))
