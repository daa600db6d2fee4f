"""Section 3.1 of the paper: a needle-shaped surface and what its method makes of it.

The paper shows the shape only as a drawing. A tent is taken: straight flanks from d = 0 at both ends to a
peak in the middle. "Approximately 1 percent" of error and "under 0.4 pixel" make the peak 40 px. Its points
are picked as by a camera at infinity, normal to the camera face; (x, z) with x along the mirror from P0,
z out of the rubber, else as in `zeromethod.paper.equations`.
"""

# ruff: noqa: E741 (the paper's l)

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.paper.equations import captured_distance, pattern_distance, reflected_angle
from zeromethod.paper.series import Inverse, Rim, Series, Step, reconstruct

PAPER_THETA_ERROR_RAD = 0.0008
PAPER_DEPTH_ERROR_PX = 0.4
"""Figures 8 and 9: "suppressed under"."""
SPACING_PX = 2.0
"""Distance of points along the mirror, if nothing else is asked for."""
AWAY_PX = 32.0
"""Distance from the tip beyond which the paper's own reading is judged "away" from it."""


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

    def depth(self, l: Float) -> Float:
        """Depth (...) in px at l (...) px; the flanks go on beyond the ends."""
        return np.asarray(self.peak_px * (1.0 - np.abs(l - self.tip_px) / self.tip_px))

    def theta(self, l: Float) -> Float:
        """Slope angle (...) in rad at l (...) px."""
        angle = np.arctan(self.peak_px / self.tip_px)
        return np.asarray(np.where(l < self.tip_px, angle, -angle))

    def points(self, spacing_px: float) -> Float:
        """Points l of the mirror `spacing_px` apart, the first one spacing from P0, ends left out."""
        return np.arange(spacing_px, self.length_px, spacing_px, dtype=np.float64)


def exact_picks(
    l: Float, d: Float, theta: Float, *, alpha0: float, beta0: float, length: float
) -> tuple[Float, Float]:
    """Exact m, w (n,) of mirror points (l, -d) of slope angle theta, (n,) each, by plane geometry alone.

    The camera's rays are parallel, beta0 from the normal. m is where the reflected ray meets the pattern
    face's line through P0 (negative or beyond the face where it misses), w the camera ray's on the captured.
    """
    normal = np.stack([-np.sin(theta), -np.cos(theta)], axis=-1)
    to_camera = np.array([np.sin(beta0), -np.cos(beta0)])
    outgoing = 2.0 * (normal @ to_camera)[..., None] * normal - to_camera
    point = np.stack([l, -d], axis=-1)
    m = _along_face(point, outgoing, np.array([np.cos(alpha0), -np.sin(alpha0)]))
    from_r0 = point - np.array([length, 0.0])
    w = _along_face(
        from_r0, np.broadcast_to(to_camera, point.shape), np.array([-np.cos(beta0), -np.sin(beta0)])
    )
    return m, w


def printed_picks(
    l: Float, d: Float, theta: Float, *, alpha0: float, beta0: float, length: float
) -> tuple[Float, Float]:
    """The paper's own approximate m, w (n,): equations 9, 12 and 14 with gamma = gamma' = 0."""
    alpha = reflected_angle(beta0, -theta)
    m = pattern_distance(l, d, alpha, alpha0, gamma=0.0)
    return m, captured_distance(length - l, d, beta0, beta0, gamma=0.0)


def _along_face(point: Float, direction: Float, face: Float) -> Float:
    """Distance from the origin along `face` (2,) at which rays (n, 2) cross it."""
    across = np.array([-face[1], face[0]])
    travel = -(point @ across) / (direction @ across)
    return np.asarray((point + travel[..., None] * direction) @ face)


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

    l: Float
    series: Series
    rises: Errors
    drops: Errors
    average: Errors


def errors_of(needle: Needle, l: Float, theta: Float, depth: Float, away_px: float) -> Errors:
    """Errors of a reading theta, depth (n,) against the needle at l (n,)."""
    theta_error = np.abs(theta - needle.theta(l))
    depth_error = np.abs(depth - needle.depth(l))
    away = np.abs(l - needle.tip_px) > away_px
    worst = (np.max(part) for part in (theta_error, depth_error, theta_error[away], depth_error[away]))
    return Errors(*(float(value) for value in worst))


def column(
    needle: Needle,
    *,
    exact: bool,
    invert: Inverse,
    step: Step = "centred",
    rim: Rim = "straight",
    spacing_px: float = SPACING_PX,
) -> Column:
    """Pick the needle on exact geometry or on the paper's own gamma = 0 model, and reconstruct it."""
    l = needle.points(spacing_px)
    picks = exact_picks if exact else printed_picks
    bench = {"alpha0": needle.alpha0, "beta0": needle.beta0, "length": needle.length_px}
    m, w = picks(l, needle.depth(l), needle.theta(l), **bench)
    series = reconstruct(m, w, **bench, invert=invert, step=step, rim=rim, keep_gamma=exact)
    theta = series.theta_rises, series.theta_drops, series.theta
    depth = series.depth_rises, series.depth_drops, series.depth
    errors = (errors_of(needle, l, *reading, AWAY_PX) for reading in zip(theta, depth, strict=True))
    return Column(l, series, *errors)
