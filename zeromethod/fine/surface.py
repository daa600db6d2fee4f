"""The fine surface: slope and depth on every camera pixel between the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.surface import Surface

_SMOOTH_PX = 5
_FIT_PX = 4
"""Half width of the square whose quartic gives the peak: a fifth of a millimetre on the packaged bench."""
_PLACES = 41
"""Places along each side at which the quartic is looked at."""


@dataclass(frozen=True, slots=True, repr=False)
class FineSurface:
    """Slope and depth of the mirror on every camera pixel between the measurable nodes; NaN where not read.

    Attributes
    ----------
    depth_mm : (rows, cols) float32
        Positive into the rubber, at the pixel's own mirror point; anchored as the coarse surface.
    slope : (rows, cols, 2) float32
        (dd/dx, dd/dy) of depth, rad.
    x_mm, y_mm : (rows, cols) float32
        The mirror point.
    sigma_depth_mm : (rows, cols) float32
        Standard deviation of depth against the mirror as the pupil and the lens show it (and, where `share`
        is below 1, as the sensing window does).
    sigma_slope : (rows, cols, 2) float32
        Standard deviation of slope, rad.
    valid : (rows, cols) bool
        Pixels that were read.
    share : (rows, cols) float32
        1 where each pixel's own frames in time count, 0 where the mirror moves and nodes are interpolated.
    first_px : (int, int)
        Camera row and column of pixel (0, 0).
    time_ns : int
        Mid-exposure of the newest frame.
    frames : int
        Frames read together.
    coarse : Surface
        The nodes, from the same windows in space and time.
    footprint_divided : bool
        Whether the pupil's footprint and the lens's blur are divided out.
    spacing_px : int
        Pixels from one node of `coarse` to the next.
    """

    depth_mm: Single
    slope: Single
    x_mm: Single
    y_mm: Single
    sigma_depth_mm: Single
    sigma_slope: Single
    valid: Mask
    share: Single
    first_px: tuple[int, int]
    time_ns: int
    frames: int
    coarse: Surface
    footprint_divided: bool = False
    spacing_px: int = 8

    @property
    def peak(self) -> tuple[float, float, float]:
        """(depth, x, y) in mm of the deepest place, bulges included; NaN where nothing was read.

        Of the mean over 5 x 5 pixels, then by the quartic through 9 x 9 around.
        """
        known = self.valid.astype(np.float64)
        size = _SMOOTH_PX, _SMOOTH_PX
        depth = np.where(self.valid, self.depth_mm, 0.0).astype(np.float64)
        count = np.asarray(cv2.boxFilter(known, -1, size, borderType=cv2.BORDER_CONSTANT))
        smooth = np.asarray(cv2.boxFilter(depth, -1, size, borderType=cv2.BORDER_CONSTANT))
        whole = count > 0.999
        if not whole.any():
            return float("nan"), float("nan"), float("nan")
        row, col = np.unravel_index(int(np.argmax(np.where(whole, np.abs(smooth), -1.0))), whole.shape)
        part = tuple(slice(max(int(at) - _FIT_PX, 0), int(at) + _FIT_PX + 1) for at in (row, col))
        return _summit(*(one[part].astype(np.float64) for one in (self.depth_mm, self.x_mm, self.y_mm)))

    def sigma_near(self, x_mm: float, y_mm: float) -> float:
        """Standard deviation of depth, mm, at the pixel next to a place; NaN where none was read there.

        Parameters
        ----------
        x_mm, y_mm : float
            World place on the mirror, mm.

        Returns
        -------
        float
            The standard deviation.
        """
        away = np.hypot(self.x_mm - np.float32(x_mm), self.y_mm - np.float32(y_mm))
        away[~np.isfinite(away)] = np.inf
        return float(self.sigma_depth_mm.flat[int(np.argmin(away))])

    def __repr__(self) -> str:
        rows, cols = self.depth_mm.shape
        depth_mm, x_mm, y_mm = self.peak
        return (
            f"<FineSurface {cols} x {rows} pixels, {100 * float(np.mean(self.valid)):.1f} % valid, "
            f"peak {1e3 * depth_mm:.3f} µm at ({x_mm:.2f}, {y_mm:.2f}) mm, {self.frames} frames>"
        )


def _summit(depth: Float, x: Float, y: Float) -> tuple[float, float, float]:
    """Depth and place of the largest depth of the quartic through the points, in the middle half of them."""
    known = np.isfinite(depth)
    middle = depth.shape[0] // 2, depth.shape[1] // 2
    x0, y0 = float(x[middle]), float(y[middle])
    half_x, half_y = max(float(np.ptp(x)) / 2, 1e-9), max(float(np.ptp(y)) / 2, 1e-9)
    terms = _powers((x[known] - x0) / half_x, (y[known] - y0) / half_y)
    if len(terms) < 2 * terms.shape[1]:
        return float(depth[middle]), x0, y0
    fit = np.linalg.lstsq(terms, depth[known], rcond=None)[0]
    s, t = np.meshgrid(*(np.linspace(-0.5, 0.5, _PLACES),) * 2)
    values = _powers(s.ravel(), t.ravel()) @ fit
    at = int(np.argmax(np.abs(values)))
    return float(values[at]), x0 + half_x * float(s.ravel()[at]), y0 + half_y * float(t.ravel()[at])


def _powers(s: Float, t: Float) -> Float:
    """(n, 15) products of powers up to the fourth."""
    return np.stack([s**i * t**j for i in range(5) for j in range(5 - i)], axis=-1)
