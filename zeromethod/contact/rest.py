"""The picture that the camera sees in the null, as frames without contact show it.

In the null the camera sees the target whatever presses, so that one picture per pixel serves every press;
what is dark or flat in it for good (dust, scratches, bubbles) is known from it, too. A moving target evens
out in the mean of frames, so that what is flat is then judged in each of them.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.contact.flat import local_deviation
from zeromethod.contact.median import median
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag

FRAMES = 8
"""Nulled frames that make the picture."""
BINS = 48
"""Grey levels, up to 2.4 times the mean, whose frequency in the picture is known."""
_FLAT_SHARE = 0.06
"""Deviation over 7 x 7 px, over the mean light, below which a pixel shows no picture at rest."""
_UNLIKE_SHARE = 0.15
"""Difference from the pixels a period away, over the mean light, from which a pixel has dirt on it."""
_DRIFT_EVERY = 4
"""Of the nodes every such one is enough for the drift of all light."""
_DARK_SHARE = 0.5
"""Mean light over its surroundings' below which a place is dark at rest."""


class RestPicture:
    """The picture in the null, gathered from frames until it is known."""

    def __init__(self, rig: Rig, grid: NodeGrid) -> None:
        self._black = rig.camera.noise.black_grey
        self._period = grid.period_px
        self._periodic = rig.target.kind != "noise"
        self._frames = self._exposure_ns = 0
        self._sum: Single | None = np.zeros(grid.image_shape, np.float32)
        self._square: Single | None = np.zeros(grid.image_shape, np.float32) if rig.target.step else None
        self._amplitude = np.zeros((*grid.shape, 2))
        self._light = np.zeros(grid.shape)
        self._seen: Mask = np.zeros(grid.shape, np.bool_)
        self.mean: Single = np.zeros(grid.image_shape, np.float32)
        self.static: Mask = np.zeros(grid.image_shape, np.bool_)
        self.levels: Float = np.linspace(0.0, 2.4, BINS + 1)[:-1] + 1.2 / BINS
        self.shares: Float = np.zeros(BINS)

    @property
    def known(self) -> bool:
        """Whether enough frames have been seen."""
        return self._frames >= FRAMES

    def add(self, image: Image, residual: Residual) -> None:
        """Take a nulled frame."""
        if self._sum is None:
            return
        cv2.accumulate(image if image.dtype == np.uint8 else image.astype(np.float32), self._sum)
        if self._square is not None:
            self._square += local_deviation(image.astype(np.float32))[1] ** 2
        self._amplitude += np.where(residual.valid[..., None], residual.modulation, 0.0)
        self._light += np.where(residual.valid, residual.mean - self._black, 0.0)
        self._frames += 1
        if self.known:
            picture = (self._sum / self._frames - self._black).astype(np.float32)
            if self._square is None:
                self._finish(picture, local_deviation(picture)[1], picture)
            else:
                last = (image - np.float32(self._black)).astype(np.float32)
                self._finish(picture, np.sqrt(self._square / self._frames), last)
            self._sum = self._square = None

    def _finish(self, picture: Single, deviation: Single, single: Single) -> None:
        """picture: the mean. deviation: over 7 x 7 px. single: a picture that shows the target."""
        self._amplitude /= self._frames
        self._light /= self._frames
        self._seen = np.asarray((self._amplitude > 0).all(axis=-1))
        side = 2 * self._period
        # two passes: the mean of a picture with a hole is not the hole's
        mean = np.maximum(cv2.boxFilter(picture, -1, (side, side)), 1e-3)
        flat = deviation < _FLAT_SHARE * mean
        if self._periodic:
            flat |= _unlike(picture, mean, self._period)
        dark = cv2.boxFilter(picture, -1, (self._period, self._period)) < _DARK_SHARE * mean
        self.static = flat | dark
        self.mean = mean
        share = (single / mean)[~self.static]
        counts = np.histogram(share, bins=BINS, range=(0.0, 2.4))[0]
        self.shares = counts / max(counts.sum(), 1)

    def expose(self, exposure_ns: int) -> None:
        """Expect the light that another exposure brings; a first one is that of the picture at rest."""
        if self._exposure_ns not in (0, exposure_ns):
            ratio = exposure_ns / self._exposure_ns
            self._amplitude *= ratio
            self._light *= ratio
            self.mean *= np.float32(ratio)
            if self._sum is not None:
                self._sum *= np.float32(ratio)
        self._exposure_ns = exposure_ns

    def lost(self, residual: Residual, least: float, least_light: float) -> Mask:
        """(rows, cols) nodes that have lost their carrier: amplitude below `least` of that at rest.

        One of the two: bars as far apart as fringes look like the other. And nodes far from these with less
        than `least_light` of their light: what is as small as a dark spot of the picture, and lies in one,
        takes little of the carrier.
        """
        seen = self._seen & (residual.flags & np.uint16(Flag.OUTSIDE | Flag.NO_RAY) == 0)
        weak = residual.modulation < least * self._amplitude
        lost = np.asarray(seen & (weak[..., 0] | weak[..., 1]))
        dim = seen & (residual.mean - self._black < least_light * self.drift(residual) * self._light)
        if dim.any():
            lost |= dim & (cv2.dilate(lost.view(np.uint8), np.ones((9, 9), np.uint8)) == 0)
        return lost

    def left(self, residual: Residual) -> Single:
        """(rows, cols) mean amplitude of both carriers over that at rest; 1 where none was seen.

        All light may drift: the median is 1.
        """
        seen = self._seen & (residual.flags & np.uint16(Flag.OUTSIDE | Flag.NO_RAY) == 0)
        ratio = (residual.modulation / np.where(seen[..., None], self._amplitude, 1.0)).mean(axis=-1)
        usual = float(np.median(ratio[seen])) if seen.any() else 1.0
        return np.where(seen, ratio / max(usual, 1e-3), 1.0).astype(np.float32)

    def drift(self, residual: Residual) -> float:
        """Light of the nodes that are measured over theirs at rest."""
        few = slice(None, None, _DRIFT_EVERY), slice(None, None, _DRIFT_EVERY)
        light = self._light[few]
        both = (residual.flags[few] == 0) & (light > 0)
        if not both.any():
            return 1.0
        return median((residual.mean[few][both] - self._black) / light[both])


def _unlike(picture: Single, mean: Single, period_px: int) -> Mask:
    """Pixels unlike those a period away along rows and columns, and the pixels next to them."""
    away = [np.roll(picture / mean, step, axis) for axis in (0, 1) for step in (-period_px, period_px)]
    # the middle two of four, so that dirt a period away does not count
    low, high = np.minimum(away[0], away[1]), np.maximum(away[0], away[1])
    other_low, other_high = np.minimum(away[2], away[3]), np.maximum(away[2], away[3])
    middle = 0.5 * (np.maximum(low, other_low) + np.minimum(high, other_high))
    unlike = np.abs(picture / mean - middle) > _UNLIKE_SHARE
    return np.asarray(cv2.dilate(unlike.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
