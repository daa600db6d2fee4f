"""The paper's reconstruction (section 2.4): depth summed point by point from either end of the mirror.

Convention: as in `zeromethod.paper.equations`: d into the rubber, tan(theta) = dd/dl.
"""

# ruff: noqa: E741 (the paper's l)

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import newton

from zeromethod.arrays import Float
from zeromethod.errors import InputError, MeasurementError
from zeromethod.paper.equations import (
    depth_step,
    expanded_angle_change,
    lean_between,
    mirror_distance,
    next_depth_step,
    pattern_angle,
)

Inverse = Literal["equation 17", "equation 12"]
Step = Literal["printed", "centred"]
Rim = float | Literal["straight", "closed"]

_START_ITERATIONS = 60


@dataclass(frozen=True, slots=True)
class Series:
    """A reconstructed profile; all (n,), at the n points that were given, from P0 on.

    l, theta, depth: averages of the two series (the paper's "o"). *_rises: summed from l = 0;
    *_drops: summed from l = L0. Lengths in the unit of m and w, theta in rad.
    """

    l: Float
    theta: Float
    depth: Float
    l_rises: Float
    theta_rises: Float
    depth_rises: Float
    l_drops: Float
    theta_drops: Float
    depth_drops: Float


@dataclass(frozen=True)
class _Bench:
    alpha0: float
    beta0: float
    length: float
    invert: Inverse
    step: Step
    keep_gamma: bool

    def along(self, w: float, d: float) -> float:
        """Equation 14: l of the point that the camera sees at w, if it is d deep."""
        return self.length - float(mirror_distance(w, d, self.beta0, keep_gamma=self.keep_gamma))

    def theta(self, m: float, l: float, d: float) -> float:
        """Equations 9 and 17 (or 12): slope angle of the point (l, d) that looks at m."""
        if self.invert == "equation 17":
            alpha = self.alpha0 + float(expanded_angle_change(m, l, d, self.alpha0))
        else:
            alpha = float(pattern_angle(m, l, d, self.alpha0))
        return -float(lean_between(alpha, self.beta0))


def reconstruct(
    m: ArrayLike,
    w: ArrayLike,
    *,
    alpha0: float,
    beta0: float,
    length: float,
    invert: Inverse = "equation 17",
    step: Step = "printed",
    rim: Rim = "straight",
    keep_gamma: bool = True,
) -> Series:
    """Profile of the mirror from picked points: camera at infinity, normal to the camera face.

    m, w: (n,) distances of each point's image from P0 on the pattern and from R0 on the camera face,
    ordered from P0 on, any spacing, n >= 2. alpha0, beta0: angles of both faces to the mirror, rad.
    length: L0; d = 0 is assumed at l = 0 and l = L0.

    invert: slope by "equation 17" (second order, gamma = 0) or by "equation 12" (exact, gamma kept).
    step: "printed" takes equation 19 as it stands, each interval's step applied to the next one;
        "centred" uses equation 18 only to guess the depth at which l and theta are read, then applies the
        interval's own step (equation 5).
    rim: slope angle at both ends, rad (0.0: clamped), or "straight": the mirror is straight from the end
        to the first point; or "closed": at P0 the slope with which the series of rises comes down to d = 0
        at L0 ("straight" at L0). On exact geometry the pattern touches the mirror at P0, the lever there has
        no length, and all surfaces that differ by a multiple of l look alike: d(0) = 0 does not
        distinguish them, so that "equation 12" needs "closed" or a known slope.
    keep_gamma: equation 14 with gamma' (exact) or without.

    Raises InputError on shapes, order or values that cannot be picks, MeasurementError where "closed" finds
    no slope.
    """
    picked_m, picked_w = _checked(m, w, length)
    bench = _Bench(alpha0, beta0, length, invert, step, keep_gamma)
    if rim == "closed":
        start: float | None = _closing_slope(bench, picked_m, picked_w)
        end: float | None = None
    else:
        start = end = None if rim == "straight" else float(rim)
    rises = _sum(bench, picked_m, picked_w, 0.0, start)
    drops = _sum(bench, picked_m[::-1], picked_w[::-1], length, end)[:, ::-1]
    mean = (rises + drops) / 2
    return Series(*mean, *rises, *drops)


def _checked(m: ArrayLike, w: ArrayLike, length: float) -> tuple[Float, Float]:
    picked_m, picked_w = np.asarray(m, dtype=np.float64), np.asarray(w, dtype=np.float64)
    if picked_m.ndim != 1 or picked_m.shape != picked_w.shape or len(picked_m) < 2:
        raise InputError(f"lattice: m, w: shapes {picked_m.shape}, {picked_w.shape}: equal, 2 or more points")
    if not (np.isfinite(picked_m).all() and np.isfinite(picked_w).all()):
        raise InputError("lattice: m, w: not finite: picked points only")
    if not length > 0:
        raise InputError(f"lattice: length: {length}: above 0")
    if not (picked_m > 0).all():
        raise InputError(f"lattice: m: {picked_m.min()}: above 0")
    if not (np.diff(picked_w) < 0).all():
        raise InputError("lattice: w: not falling: points in order from P0 on")
    return picked_m, picked_w


def _sum(bench: _Bench, m: Float, w: Float, end: float, rim: float | None) -> Float:
    """(3, n): l, theta, d of one series that starts with d = 0 at l = `end`; rim None = straight."""
    found = np.empty((3, len(m)))
    l, theta, d, rise = _first(bench, m[0], w[0], end, rim)
    found[:, 0] = l, theta, d
    for n in range(1, len(m)):
        l_before, theta_before, d_before = l, theta, d
        d = d_before + rise
        l = bench.along(w[n], d)
        theta = bench.theta(m[n], l, d)
        rise = float(next_depth_step(l - l_before, theta_before, theta - theta_before))
        if bench.step == "centred":
            d = d_before + rise
            l = bench.along(w[n], d)
        found[:, n] = l, theta, d
    return found


def _first(
    bench: _Bench, m: float, w: float, end: float, rim: float | None
) -> tuple[float, float, float, float]:
    """l, theta and d of the point next to an end, and the rise of d up to it."""
    if rim is not None:
        guess = (bench.along(w, 0.0) - end) * float(np.tan(rim))
        l = bench.along(w, guess)
        theta = bench.theta(m, l, guess)
        rise = float(depth_step(l - end, rim, theta - rim))
        if bench.step == "printed":
            return l, theta, guess, rise
        return bench.along(w, rise), theta, rise, rise
    d = 0.0
    l, theta = end, 0.0
    for _ in range(_START_ITERATIONS):
        l = bench.along(w, d)
        theta = bench.theta(m, l, d)
        d = (l - end) * float(np.tan(theta))
    return l, theta, d, d


def _closing_slope(bench: _Bench, m: Float, w: Float) -> float:
    """Slope angle at P0 with which the rises end, straight on from the last point, at d = 0."""

    def missed(slope: float) -> float:
        l, theta, d = _sum(bench, m, w, 0.0, slope)[:, -1]
        return float(d + (bench.length - l) * np.tan(theta))

    start = float(_first(bench, m[0], w[0], 0.0, None)[1])
    found, how = newton(missed, start, x1=start + 1e-4, tol=1e-12, maxiter=30, full_output=True, disp=False)
    # Beyond a right angle tan repeats itself: what is found there is no slope of a surface.
    if not (how.converged and abs(found) < np.pi / 2):
        raise MeasurementError("lattice: no slope at P0 brings the series of rises to d = 0 at L0")
    return float(found)
