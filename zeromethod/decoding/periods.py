"""Choice of periods: the distance of two LCD places in phase, and how often noise confuses them.

K periods P_j send a place x to K phases 2 pi x / P_j. Two places that lie D apart differ by the wrapped
phases w_j = wrap(2 pi D / P_j); with phase noise sigma_j, a maximum-likelihood decoder confuses them with
probability Q(d / 2), d^2 = sum (w_j / sigma_j)^2, Q the Gaussian tail. Around every
near-coincidence of the periods d is smallest at one D; the sum of Q over these minima, both signs, bounds the
share of wrong orders (union bound), closely where the share is small. Places near the panel's edge have
fewer rivals: a rival D exists for the share 1 - |D| / size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import combinations

import numpy as np
from scipy.special import erfc

from zeromethod.arrays import Float, Ints

SHORTEST_PX = 16
"""Default shortest period: a lens blur of 2 LCD px still passes 73 % of its contrast."""

LONGEST_RATIO = 3.0
"""Default longest period over the shortest: every period then contributes to the precision."""

SEPARATION_RAD = 1.0
"""Distance of rivals that tolerates phase errors of 0.5 rad: ten sigma of 0.05 rad, or a second reflection of
a third."""

RANGE_ERROR = 1e-6
"""Share of wrong orders up to which a range is unambiguous."""

LARGEST_PX = 16384
"""Largest panel considered."""


def rivals(
    periods_px: Sequence[float] | Float, phase_sigma_rad: float | Sequence[float] | Float, size_px: float
) -> tuple[Float, Float]:
    """Offsets D (px, positive) at which the periods nearly coincide, and their distance d in sigmas."""
    order = np.argsort(periods_px)
    periods = np.asarray(periods_px, dtype=np.float64)[order]
    sigma = np.broadcast_to(np.asarray(phase_sigma_rad, dtype=np.float64), periods.shape)[order]
    weight = (2.0 * math.pi / (periods * sigma)) ** 2
    # one near-coincidence for each whole number of shortest periods
    whole = periods[0] * np.arange(1, int(size_px / periods[0] + 0.5) + 1)
    off = np.rint(whole[:, None] / periods) * periods - whole[:, None]
    step = off @ weight / weight.sum()
    within = whole + step <= size_px
    squared = np.maximum(off**2 @ weight - step**2 * weight.sum(), 0.0)
    return (whole + step)[within], np.sqrt(squared[within])


def order_error(
    periods_px: Sequence[float], phase_sigma_rad: float | Sequence[float], size_px: float
) -> float:
    """Expected share of pixels with a wrong order, by the union bound (never above 1).

    phase_sigma_rad: standard deviation of the wrapped phase, one number or one per period.
    size_px: range of LCD px in which the place is searched. NaN for a sigma of NaN.
    """
    if not np.isfinite(phase_sigma_rad).all():
        return math.nan
    offset, distance = rivals(periods_px, phase_sigma_rad, size_px)
    tails = erfc(distance / (2.0 * math.sqrt(2.0)))  # both signs of D: 2 Q(d / 2)
    return float(min(np.sum((1.0 - offset / size_px) * tails), 1.0))


def unambiguous_range(periods_px: Sequence[float], phase_sigma_rad: float) -> float:
    """Largest size, px, with a share of wrong orders below `RANGE_ERROR`; at least the longest period."""
    offset, distance = rivals(periods_px, phase_sigma_rad, LARGEST_PX)
    tails = np.cumsum(erfc(distance / (2.0 * math.sqrt(2.0))))
    bad = np.flatnonzero(tails > RANGE_ERROR)
    reach = float(offset[bad[0]]) - 1.0 if len(bad) else float(LARGEST_PX)
    return max(reach, *periods_px)


def _best(sets: Ints, size: float, enough: float) -> int:
    """Index of the most precise set with rivals `enough` apart, else of the set with the farthest."""
    periods = np.ascontiguousarray(sets.T, dtype=np.float64)
    first, weight = periods[0], np.sum(periods**-2.0, axis=0)
    least = np.full(len(sets), np.inf)
    for k in range(1, int(size / first.min() + 0.5) + 1):
        off = (np.rint(k * first / periods) * periods - k * first) / periods
        squared = (2.0 * math.pi) ** 2 * (
            np.sum(off**2, axis=0) - np.sum(off / periods, axis=0) ** 2 / weight
        )
        np.minimum(least, squared, out=least, where=k <= np.floor(size / first + 0.5))
    apart = least >= enough**2
    return int(np.argmax(np.where(apart, weight, -np.inf) if apart.any() else least))


@cache
def choose_periods(size_px: int, count: int = 4, shortest_px: int = SHORTEST_PX) -> tuple[float, ...]:
    """Whole periods, px, for a panel of `size_px` (its longer side).

    Of all sets of `count` from shortest_px to `LONGEST_RATIO` x shortest_px, the one that gives the place
    most precisely (largest sum of 1 / P^2) while rivals stay `SEPARATION_RAD` apart; where no set reaches
    that, the closest to it.
    """
    candidates = range(shortest_px, int(LONGEST_RATIO * shortest_px) + 1)
    sets = np.array(list(combinations(candidates, count)), dtype=np.int64)
    return tuple(float(period) for period in sets[_best(sets, float(size_px), SEPARATION_RAD)])
