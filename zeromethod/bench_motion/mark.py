"""Where one printed mark is in an image: a least-squares fit of its reference, shifted, to a small window."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import spline_filter

from zeromethod.arrays import Float, Image
from zeromethod.rig.model import MARK_HALF_PX

SEARCH_PX = 16
"""How far from where it was a mark is looked for that is no longer where it was seen last."""

MOST_SIGMA_PX = 0.1
"""Noise of a mark's place in one frame above which it has too little contrast."""

_SIDE = 2 * MARK_HALF_PX + 1
_MARGIN = 3
"""Pixels at the window's border that the quintic spline needs to shift the rest; they have no weight."""

_ROUNDS = 6
"""Steps of a fit at most."""
_NEAR_PX = 0.1
"""Shift from where the fit is linear, below which one step is exact to 0.003 px."""

_NOISE_SPREAD = 1.3
"""Square of what a fit leaves over that of noise, which noise alone does not pass (four sigma)."""

_GAIN = 0.3, 3.0
_LIKE = 0.8
"""Brightness and correlation against the reference outside of which something covers the mark."""

_POWERS = np.array([1, -6, 15, -20, 15, -6, 1]) / 120
"""Of the quintic basis spline: sum of these times (x + 3 - k)^5 where that is positive."""


def _taper() -> Float:
    """(pixels,) weights of the window, falling to 0 at its border; sum 1."""
    half = MARK_HALF_PX - _MARGIN + 1
    one = np.maximum(np.cos(0.5 * np.pi * np.arange(-MARK_HALF_PX, MARK_HALF_PX + 1) / half), 0.0)
    one[:_MARGIN] = one[-_MARGIN:] = 0.0
    both = np.outer(one, one).ravel()
    return np.asarray(both / both.sum(), np.float64)


_WEIGHT = _taper()
_AXIS = np.arange(-MARK_HALF_PX, MARK_HALF_PX + 1) / MARK_HALF_PX
_PLANE = np.stack([np.ones(_SIDE**2), np.tile(_AXIS, _SIDE), np.repeat(_AXIS, _SIDE)], axis=-1)


def _quintic(x: Float) -> tuple[Float, Float]:
    """The quintic basis spline and its slope at x (n,); its knots are -3, -2, ... 3."""
    reach = np.maximum(x[:, None] + 3.0 - np.arange(7), 0.0)
    return reach**5 @ _POWERS, 5.0 * reach**4 @ _POWERS


def _shifted(spline: Float, u_px: float, v_px: float) -> list[Float]:
    """Picture shifted by less than a pixel, and its slopes along u and v, each (pixels,)."""
    at = np.arange(-3.0, 4.0)
    (value_u, value_v), (slope_u, slope_v) = zip(*(_quintic(at + by) for by in (u_px, v_px)), strict=True)
    # filters run backwards through the spline, whose slope is odd
    pairs = (value_u, value_v), (-slope_u, value_v), (value_u, -slope_v)
    return [np.asarray(cv2.sepFilter2D(spline, cv2.CV_64F, u, v), np.float64).ravel() for u, v in pairs]


@dataclass(frozen=True, slots=True)
class SeenMark:
    """A mark in one frame: shift (u, v) from its reference, and shift that other light could feign, px."""

    shift_px: Float
    feigned_px: float


class Mark:
    """One mark, from the frames at rest on.

    Parameters
    ----------
    column, row : int
        Camera pixel of its window's middle.
    windows : (frames, side, side) array
        Grey levels around it at rest, as `window` cuts them; four frames or more.

    Attributes
    ----------
    sigma_px : float
        Noise of its place in one frame by that of the pixels; infinite where there is nothing to see.
    """

    def __init__(self, column: int, row: int, windows: Float) -> None:
        self._column, self._row = column, row
        self._noise2 = float(_WEIGHT @ windows.var(axis=0, ddof=1).ravel())
        self._picture = windows.mean(axis=0)
        self._spline = spline_filter(self._picture, order=5)
        # slopes of different frames, whose noise is not the same and does not pass for a mark
        first, second = (
            np.stack(_shifted(spline_filter(half.mean(axis=0), order=5), 0.0, 0.0)[1:])
            for half in (windows[::2], windows[1::2])
        )
        steep = (first * _WEIGHT) @ second.T
        self._steep = max(float(np.linalg.eigvalsh(0.5 * (steep + steep.T))[0]), 1e-12)
        # of weighted least squares; pixels' noise is independent
        self.sigma_px = float(np.sqrt(max(self._noise2, 1e-6) * (_WEIGHT**2).sum() / self._steep))
        self._shift = np.zeros(2)
        self._linear_at(self._shift)

    @staticmethod
    def window(image: Image, column: int, row: int) -> Float:
        """Grey levels (side, side) around a pixel of the image."""
        half = MARK_HALF_PX
        cut = image[row - half : row + half + 1, column - half : column + half + 1]
        return np.asarray(cut, np.float64)

    def see(self, image: Image) -> SeenMark | None:
        """The mark near where it was seen last; None where it is covered, or further away."""
        shift = self._shift
        for _ in range(_ROUNDS):
            window = self._cut(image)
            if window is None:
                break
            step, seen = self._fit(window)
            if seen is None:
                break
            if np.abs(step).max() < _NEAR_PX:
                return seen
            self._linear_at(self._at + np.clip(step, -1.0, 1.0))
        if self._at is not shift:
            self._linear_at(shift)
        return None

    def search(self, image: Image) -> None:
        """Look for the mark all round its place at rest; the next `see` starts from what is most alike."""
        half = MARK_HALF_PX + SEARCH_PX
        top, left = max(self._row - half, 0), max(self._column - half, 0)
        part = image[top : self._row + half + 1, left : self._column + half + 1].astype(np.float32)
        inner = slice(_MARGIN, -_MARGIN)
        alike = cv2.matchTemplate(part, self._picture[inner, inner].astype(np.float32), cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(int(np.argmax(alike)), alike.shape)
        home = self._column - MARK_HALF_PX + _MARGIN - left, self._row - MARK_HALF_PX + _MARGIN - top
        self._linear_at(np.array([column - home[0], row - home[1]], np.float64))
        self._shift = self._at

    def _linear_at(self, shift: Float) -> None:
        """Make the fit linear in small shifts from here."""
        self._at, self._whole = shift, np.rint(shift)
        picture, slope_u, slope_v = _shifted(self._spline, *(shift - self._whole))
        self._mean = float(_WEIGHT @ picture)
        picture = picture - self._mean
        self._terms = np.column_stack([slope_u, slope_v, picture, _PLANE])
        weighted = (self._terms * _WEIGHT[:, None]).T
        self._solve = np.linalg.pinv(weighted @ self._terms, hermitian=True) @ weighted
        self._contrast2 = float(_WEIGHT @ picture**2)

    def _cut(self, image: Image) -> Float | None:
        """Window (pixels,) at the present shift; None where it leaves the image."""
        column, row = (int(at + by) for at, by in zip((self._column, self._row), self._whole, strict=True))
        rows, columns = image.shape
        half = MARK_HALF_PX
        if not (half <= column < columns - half and half <= row < rows - half):
            return None
        return self.window(image, column, row).ravel()

    def _fit(self, window: Float) -> tuple[Float, SeenMark | None]:
        """Step from the present shift, and the mark as seen; None where it is covered."""
        found = self._solve @ window
        gain = found[2]
        left = window - self._terms @ found
        left2 = float(_WEIGHT @ left**2)
        beyond2 = max(left2 - _NOISE_SPREAD * self._noise2, 0.0)
        contrast2 = gain**2 * self._contrast2
        if not _GAIN[0] < gain < _GAIN[1] or beyond2 > (1.0 / _LIKE**2 - 1.0) * contrast2:
            return np.zeros(2), None
        step = -found[:2] / gain
        shift = self._at + step
        if np.abs(step).max() < _NEAR_PX:
            self._shift = self._at
        return step, SeenMark(shift, float(np.sqrt(beyond2 / self._steep)) / gain)
