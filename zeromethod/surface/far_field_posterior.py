"""How likely each multiple C of the scale is, by the laws of a far field and without; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.far_field_laws import MEMBERS, ROUND, Nodes, unlikely

_PIECES, _NOISES, _WELL = 14.0, 20.0, 8.0
"""Independent errors of a law over the view, those of noise, and the misfit by which they are halved."""

_LONG_COST = 5.0
"""Logarithm of likelihood that the long law must gain for its six numbers."""

_PER_BOUND, _PER_RANGE = 0.6, 7.7
"""Depth that is left at the anchor: sigma over its bound and over the range read."""

_SEEN, _LEAST_SEEN = 6.0, 0.03
"""Odds, times range over what noise can hide, that a quiet anchor is at rest; its sigma over the hidden."""

_HIDDEN = 3.0
"""Power with which it becomes unlikely that C grad h hides larger slopes from all of the anchor."""

_TAIL, _HIDDEN_TAIL = 1.4, 2.0
"""Powers with which a depth beyond the anchor's bound, seen or hidden, becomes unlikely."""

_CLOSER, _SEARCHES = 9, 2
"""Trials between the neighbours of the likeliest one, and how often: it may be narrow."""

_ROUNDS, _MOST_HALVED, _NEGLIGIBLE = 4, 16, 1e-3
"""Rounds in which the likeliest intervals of C are halved, how many of them, and the share of one left so."""

_KNOWN, _MISFIT, _NOISE, _LAWS = 1, 2, 3, 4
"""Columns of a trial after C: logarithm of how likely C is without laws, and those of `unlikely`."""


class Prior(NamedTuple):
    """What is known of C without the laws.

    range_mm: of depth read. rest_mm: the anchor's depth / h. bound_mm: the same if it decays as 1 / r and C
    is 0; hidden_mm: what of it noise can hide. diagonal_mm: of the view.
    """

    range_mm: float
    rest_mm: float
    bound_mm: float
    hidden_mm: float
    diagonal_mm: float


@numba.njit(cache=True, error_model="numpy")
def posterior(nodes: Nodes, quiet: Nodes, share: Float, prior: Prior, trial: Float) -> tuple[float, float]:
    """Mean and standard deviation of C, mm.

    share: the weight of each of the anchor's nodes `quiet`. trial: C to begin with, mm; others follow where
    it is likely.
    """
    first, searched = len(trial), _CLOSER * _SEARCHES
    seen = np.empty((first + searched + _ROUNDS * _MOST_HALVED, _LAWS + MEMBERS))
    low = high = 0.0
    for count in range(first + searched):
        place = (count - first) % _CLOSER
        if count < first:
            constant = trial[count]
        else:
            if place == 0:
                low, high = _about_best(seen[:count])
            constant = low + (high - low) * (place + 1) / (_CLOSER + 1)
        _look(nodes, quiet, share, prior, constant, seen[count])
    count = first + searched
    for _ in range(_ROUNDS):
        at, mass = _masses(seen[:count])
        for k in np.argsort(-mass)[:_MOST_HALVED]:
            if mass[k] > _NEGLIGIBLE:
                _look(nodes, quiet, share, prior, 0.5 * (at[k] + at[k + 1]), seen[count])
                count += 1
    at, mass = _masses(seen[:count])
    mean = variance = 0.0
    for k in range(len(mass)):
        mean += mass[k] * 0.5 * (at[k] + at[k + 1])
    for k in range(len(mass)):
        variance += mass[k] * ((at[k] - mean) ** 2 + (at[k + 1] - mean) ** 2) / 2.0
    return mean, np.sqrt(variance)


@numba.njit(cache=True, error_model="numpy")
def _masses(seen: Float) -> tuple[Float, Float]:
    """Trials in order, and the probability (m - 1,) of C between each and the next."""
    pieces, likely, order = _pieces(seen), np.empty(len(seen)), np.argsort(seen[:, 0])
    for i, row in enumerate(seen):
        least, by_round, by_long = row[_LAWS:].min(), 0.0, 0.0
        for j in range(_LAWS, len(row)):
            if j < _LAWS + ROUND:
                by_round += np.exp(0.5 * pieces * (least - row[j])) / ROUND
            else:
                by_long += np.exp(0.5 * pieces * (least - row[j])) / (MEMBERS - ROUND)
        both = by_round + np.exp(-_LONG_COST) * by_long
        likely[i] = row[_KNOWN] - 0.5 * pieces * least + np.log(both)
    likely = np.exp(likely - likely.max())[order]
    at = seen[order, 0]
    mass = 0.5 * (likely[1:] + likely[:-1]) * (at[1:] - at[:-1])
    return at, mass / mass.sum()


@numba.njit(cache=True, error_model="numpy")
def _likeliest(seen: Float) -> int:
    """Number of the likeliest trial if its best law were all."""
    best, most = 0, -np.inf
    for i, row in enumerate(seen):
        likely = row[_KNOWN] - 0.5 * _PIECES * row[_LAWS:].min()
        if likely > most:
            best, most = i, likely
    return best


@numba.njit(cache=True, error_model="numpy")
def _pieces(seen: Float) -> float:
    """Number of independent errors of the laws: the fewer, the worse they fit."""
    best = seen[_likeliest(seen)]
    noise = min(best[_NOISE] / max(best[_MISFIT], 1e-9), 1.0)
    return float(1.0 / ((1.0 - noise) / _PIECES + noise / _NOISES) / (1.0 + best[_MISFIT] / _WELL))


@numba.njit(cache=True, error_model="numpy")
def _about_best(seen: Float) -> tuple[float, float]:
    """The trials next to the likeliest one; itself where there is none."""
    best, low, high = seen[_likeliest(seen), 0], -np.inf, np.inf
    for constant in seen[:, 0]:
        if low < constant < best:
            low = constant
        if best < constant < high:
            high = constant
    return (low if low > -np.inf else best), (high if high < np.inf else best)


@numba.njit(cache=True, error_model="numpy")
def _look(nodes: Nodes, quiet: Nodes, share: Float, prior: Prior, constant: float, row: Float) -> None:
    """Fill in the row of one trial."""
    row[0] = constant
    x, y = unlikely(nodes, constant, prior.diagonal_mm, row[_MISFIT:])
    row[_KNOWN] = _known(quiet, share, prior, constant, x, y)


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _known(quiet: Nodes, share: Float, prior: Prior, constant: float, x_mm: float, y_mm: float) -> float:
    """Logarithm of how likely C is by what is left at the anchor, with the dent's centre at x, y."""
    bound2 = 0.0
    for i in range(len(share)):
        away2 = max((quiet.x[i] - x_mm) ** 2 + (quiet.y[i] - y_mm) ** 2, (0.25 * prior.diagonal_mm) ** 2)
        slope_x = quiet.slope_x[i] - constant * quiet.gradient_x[i]
        slope_y = quiet.slope_y[i] - constant * quiet.gradient_y[i]
        slope2 = slope_x**2 + slope_y**2 - 2.0 * (quiet.variance_x[i] + quiet.variance_y[i])
        bound2 += share[i] * away2 * slope2 / quiet.scale[i] ** 2
    left_mm, hidden_mm = prior.rest_mm - constant, max(prior.hidden_mm, prior.bound_mm)
    quiet_mm, bound_mm = (
        max(np.sqrt(max(bound2, 0.0)), hidden_mm),
        max(prior.bound_mm, _LEAST_SEEN * hidden_mm),
    )
    odds = np.log1p(_SEEN * prior.range_mm / hidden_mm) * (1.0 - bound_mm / hidden_mm)
    seen2 = (left_mm / (_PER_BOUND * bound_mm)) ** 2
    hidden2 = (left_mm / (_PER_BOUND * quiet_mm)) ** 2
    seen = odds - np.log(bound_mm) - _TAIL * np.log1p(seen2 / 3.0)
    unseen = (
        -np.log(hidden_mm) - _HIDDEN_TAIL * np.log1p(hidden2 / 3.0) - _HIDDEN * np.log(quiet_mm / hidden_mm)
    )
    either = max(seen, unseen) + np.log1p(np.exp(-abs(seen - unseen)))
    return float(either - np.log1p((left_mm / (_PER_RANGE * prior.range_mm)) ** 2))
