"""Figures of a run's fine surfaces, and their errors where the truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.fine.surface import FineSurface
from zeromethod.surface.comparison import TruthSource, true_peak_mm


@dataclass(frozen=True, slots=True)
class FineFigures:
    """The figures of one fine surface; errors are NaN where the truth is not known."""

    time_ns: int
    phase: str
    rows: int
    cols: int
    depth_peak_mm: float
    depth_peak_sigma_mm: float
    depth_peak_error_percent: float = float("nan")
    depth_rms_error_um: float = float("nan")


def figures_of(surface: FineSurface, phase: str, truth: TruthSource | None) -> FineFigures:
    """Figures of a fine surface; errors against the mirror itself, at the pixels' own points."""
    rows, cols = surface.depth_mm.shape
    peak_mm, x_mm, y_mm = surface.peak
    own = surface.time_ns, phase, rows, cols, peak_mm, surface.sigma_near(x_mm, y_mm)
    if truth is None or not surface.valid.any():
        return FineFigures(*own)
    mirror = truth(surface.time_ns)
    x, y = (one[surface.valid].astype(np.float64) for one in (surface.x_mm, surface.y_mm))
    error = surface.depth_mm[surface.valid] - mirror.depth(x, y)
    true_mm = true_peak_mm(mirror, x, y)
    percent = 100 * (peak_mm - true_mm) / true_mm if true_mm else float("nan")
    rms_um = 1e3 * float(np.sqrt(np.mean(error**2)))
    return FineFigures(*own, percent, rms_um)
