"""How an edge seen line by line departs from where it was predicted: a robust parabola."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float

STRAY_PX = 1.5
"""Distance from the common curve from which a line shows something else."""

MOST_SCATTER_PX = 1.0
"""Rms of the lines on the curve, beyond which there is none."""

_BLOCKS = 8
_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class EdgeCurve:
    """How far an edge lies from where it was predicted, as a parabola of s = (line - middle) / half.

    coefficients: of 1, s, s^2. sigma_px: of the middle, from the scatter of blocks of lines, which counts
    what neighbouring lines share. share: of the lines that lie on it.
    """

    coefficients: Float
    middle: float
    half: float
    sigma_px: float
    share: float

    @classmethod
    def of(cls, line: Float, away: Float) -> EdgeCurve | None:
        """Fit robustly (Tukey's biweight from the median on); None where lines scatter too much."""
        middle, half = 0.5 * float(line.min() + line.max()), max(0.5 * float(np.ptp(line)), 1.0)
        s = (line - middle) / half
        columns = np.stack([np.ones_like(s), s, s * s], axis=-1)
        coefficients = np.array([*_repeated_line(s, away), 0.0])
        for _ in range(_ROUNDS):
            left = away - columns @ coefficients
            scale = max(1.4826 * float(np.median(np.abs(left))), 0.1)
            weight = np.clip(1.0 - (left / (4.685 * scale)) ** 2, 0.0, None)
            normal = (columns * (weight**2)[:, None]).T @ columns
            if np.linalg.cond(normal) > 1e10:
                return None
            step = np.linalg.solve(normal, (columns * (weight**2)[:, None]).T @ away) - coefficients
            coefficients = coefficients + step
            if np.abs(step).max() < 1e-4:
                break
        left = away - columns @ coefficients
        on = np.abs(left) < STRAY_PX
        if not on.any() or float(np.sqrt(np.mean(left[on] ** 2))) > MOST_SCATTER_PX:
            return None
        block = np.minimum((0.5 * (s + 1.0) * _BLOCKS).astype(int), _BLOCKS - 1)
        means = [float(left[on & (block == b)].mean()) for b in range(_BLOCKS) if (on & (block == b)).any()]
        sigma = float(np.std(means) / np.sqrt(max(len(means) - 3, 1)))
        return cls(coefficients, middle, half, sigma, float(np.mean(on)))

    @property
    def tilt(self) -> float:
        """Px per line."""
        return float(self.coefficients[1] / self.half)

    @property
    def bend_px(self) -> float:
        """Sagitta beyond the predicted one."""
        return float(self.coefficients[2])

    def at(self, line: Float) -> Float:
        """Distance at lines."""
        s = (line - self.middle) / self.half
        return np.asarray(np.stack([np.ones_like(s), s, s * s], axis=-1) @ self.coefficients)


def _repeated_line(s: Float, away: Float) -> tuple[float, float]:
    """Value at 0 and slope of a line that up to half of the points do not lie on (Siegel's medians)."""
    few = np.arange(len(s))[:: max(1, len(s) // 150)]
    s, away = s[few], away[few]
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = (away[:, None] - away) / (s[:, None] - s)
    slope = float(np.median(np.nanmedian(np.where(np.isfinite(slopes), slopes, np.nan), axis=1)))
    return float(np.median(away - slope * s)), slope
