"""The fine surface: slope and depth on every camera pixel between the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Mask, Single
from zeromethod.fine.summit import summit
from zeromethod.surface import Surface


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
        Standard deviation of each pixel's own slope, rad, before what smoothing and division make of it.
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

        Of the quartic through the top of the dent (`fine.summit`).
        """
        return summit(self.depth_mm, self.x_mm, self.y_mm, self.valid)

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
