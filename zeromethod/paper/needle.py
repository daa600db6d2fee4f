"""Section 3.1 of the paper: a needle-shaped surface and what its method makes of it.

The paper shows the shape only as a drawing. A tent is taken: straight flanks from d = 0 at both ends to a
peak in the middle. "Approximately 1 percent" of error and "under 0.4 pixel" make the peak 40 px.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.paper.forward import exact_picks, printed_picks
from zeromethod.paper.series import Inverse, Rim, Series, Step, reconstruct

PAPER_THETA_ERROR_RAD = 0.0008
PAPER_DEPTH_ERROR_PX = 0.4
"""Figures 8 and 9: "suppressed under"."""
SPACING_PX = 2.0
"""Distance of points along the mirror, if nothing else is asked for."""


@dataclass(frozen=True, slots=True)
class Needle:
    """The tent: d = peak_px at l = length_px / 2, 0 at both ends; all in px, angles in rad."""

    length_px: float = 1637.0
    peak_px: float = 40.0
    alpha0: float = np.pi / 4
    beta0: float = np.pi / 4

    @property
    def tip_px(self) -> float:
        """Where the tip lies, l."""
        return self.length_px / 2

    def depth(self, l: Float) -> Float:  # noqa: E741
        """Depth (...) in px at l (...) px; the flanks go on beyond the ends."""
        return np.asarray(self.peak_px * (1.0 - np.abs(l - self.tip_px) / self.tip_px))

    def theta(self, l: Float) -> Float:  # noqa: E741
        """Slope angle (...) in rad at l (...) px."""
        angle = np.arctan(self.peak_px / self.tip_px)
        return np.asarray(np.where(l < self.tip_px, angle, -angle))

    def points(self, spacing_px: float) -> Float:
        """Points l of the mirror `spacing_px` apart, the first one spacing from P0, ends left out."""
        return np.arange(spacing_px, self.length_px, spacing_px, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Errors:
    """Largest absolute errors, theta in rad and depth in px.

    "away": points farther than `away_px` of the tip.
    """

    theta_rad: float
    depth_px: float
    theta_away_rad: float
    depth_away_px: float


@dataclass(frozen=True, slots=True)
class Column:
    """One way through the method. Errors are taken at the true mirror points l (n,) in px."""

    name: str
    l: Float  # noqa: E741
    series: Series
    rises: Errors
    drops: Errors
    average: Errors


def errors_of(needle: Needle, l: Float, theta: Float, depth: Float, away_px: float) -> Errors:  # noqa: E741
    """Errors of a reading theta, depth (n,) against the needle at l (n,)."""
    theta_error = np.abs(theta - needle.theta(l))
    depth_error = np.abs(depth - needle.depth(l))
    away = np.abs(l - needle.tip_px) > away_px
    worst = (np.max(part) for part in (theta_error, depth_error, theta_error[away], depth_error[away]))
    return Errors(*(float(value) for value in worst))


def column(
    needle: Needle,
    name: str,
    *,
    exact: bool,
    invert: Inverse,
    step: Step = "centred",
    rim: Rim = "straight",
    spacing_px: float = SPACING_PX,
    away_px: float = 32.0,
) -> Column:
    """Pick the needle on exact geometry or on the paper's own gamma = 0 model, and reconstruct it."""
    l = needle.points(spacing_px)  # noqa: E741
    picks = exact_picks if exact else printed_picks
    bench = {"alpha0": needle.alpha0, "beta0": needle.beta0, "length": needle.length_px}
    m, w = picks(l, needle.depth(l), needle.theta(l), **bench)
    series = reconstruct(m, w, **bench, invert=invert, step=step, rim=rim, keep_gamma=exact)
    readings = (
        (series.theta_rises, series.depth_rises),
        (series.theta_drops, series.depth_drops),
        (series.theta, series.depth),
    )
    return Column(name, l, series, *(errors_of(needle, l, *reading, away_px) for reading in readings))
