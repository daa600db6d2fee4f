"""Temporal unwrapping: absolute places from wrapped phases of several periods, with odds of a wrong order.

Every order of the shortest period is a candidate; the other periods take the order that lies nearest to it,
and the place is then the weighted mean. chi^2 of that mean measures the agreement of the periods:

    chi^2(orders) = sum_j w_j (x_j - x)^2,  x_j = (phase_j / 2 pi + order_j) P_j,  w_j = (2 pi / P_j /
    sigma_j)^2

The best candidate is the maximum-likelihood order. The difference to the next best chi^2 gives the odds that
it is wrong, exp(-difference / 2). All orders are compared at once, not period by period.

Where the shifts are few, a harmonic that they alias onto the fundamental makes the periods disagree.
N equal shifts cannot separate harmonic N - 1 from the fundamental with reversed phase: with a share e of it,
the phasor comes out as z + e |z| exp(-i (N - 1) phase), its phase off by -e sin(N phase). An LCD drawn
without its inverse response has e = 0.2 for N = 3, 0.01 for N = 4, 0.001 for N = 5 (gamma 2.2). As e is the
same at all phases, it is the component of the phases' misfit along sin(N phase) over the whole view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.decoding.decoding import Phasors, fit_matrices
from zeromethod.decoding.noise import QUANTISATION, NoiseModel

LEAST_SHARE = 0.002
"""Below this a harmonic moves a place by less than a 3000th of the period."""

_SAMPLES = 100_000
_LEAST_SAMPLES = 1000
_ROUNDS = 6


@dataclass(frozen=True, slots=True)
class Places:
    """Absolute place along one axis of the LCD, per pixel (rows, cols); NaN where not unwrapped.

    x_px: LCD px. sigma_px: from the camera's noise. chi2: disagreement of the periods, of periods - 1 degrees
    of freedom. odds: of the second-best order against the best, 0 to 1. stiffness: d(expected chi2) /
    d(variance of a phase error common in size to all periods, rad^2). leverage_px2: variance of x that such
    an error of 1 rad^2 brings. phase_sigma_rad: of the periods, rms.
    """

    x_px: Float
    sigma_px: Single
    chi2: Single
    odds: Single
    stiffness: Single
    leverage_px2: Single
    phase_sigma_rad: Single


@numba.njit(cache=True, error_model="numpy", inline="always")
def _phase_variance(
    c: float, s: float, mean: float, constant: float, slope: float, least: float, solve: Float, waves: Float
) -> float:
    """Variance of the phase, rad^2, from the noise of every shift's grey level through the least squares."""
    power = c * c + s * s
    total = 0.0
    for k in range(solve.shape[1]):
        along = (c * solve[2, k] - s * solve[1, k]) / power
        grey = mean + c * waves[k, 1] + s * waves[k, 2]
        total += along * along * max(constant + slope * grey, least)
    return total


@numba.njit(cache=True, error_model="numpy")
def _unwrap(
    cosine: Single,
    sine: Single,
    mean: Single,
    bright: Mask,
    periods: Float,
    noise: tuple[float, float, float],
    share: float,
    solve: Float,
    waves: Float,
    low: float,
    high: float,
    x_px: Float,
    out: Single,
) -> None:
    """Places of all pixels. Periods rise. out: (6, rows, cols) as in `Places`."""
    count, rows, cols = cosine.shape
    turn, sigma2, weight = np.empty(count), np.empty(count), np.empty(count)
    step, at = np.empty(count), np.empty(count)
    for j in range(rows):
        for i in range(cols):
            if not bright[j, i]:
                continue
            total = 0.0
            for n in range(count):
                c, s = float(cosine[n, j, i]), float(sine[n, j, i])
                turn[n] = math.atan2(s, c) / (2.0 * math.pi)
                sigma2[n] = share * _phase_variance(
                    c, s, float(mean[j, i]), noise[0], noise[1], noise[2], solve, waves
                )
                weight[n] = (2.0 * math.pi / periods[n]) ** 2 / sigma2[n]
                total += weight[n]
            first = math.ceil(low / periods[0] - turn[0])
            last = math.floor(high / periods[0] - turn[0])
            for n in range(1, count):
                step[n] = periods[0] / periods[n]
                at[n] = (turn[0] + first) * step[n] - turn[n]
            best = second = math.inf
            best_shift = 0.0
            best_order = first
            for order in range(first, last + 1):
                sw1 = sw2 = 0.0
                for n in range(1, count):
                    # x_n - x_0 with the order of period n that brings it nearest
                    r = (np.rint(at[n]) - at[n]) * periods[n]
                    sw1 += weight[n] * r
                    sw2 += weight[n] * r * r
                    at[n] += step[n]
                squares = sw2 - sw1 * sw1 / total
                if squares < best:
                    second, best = best, squares
                    best_order, best_shift = order, sw1 / total
                elif squares < second:
                    second = squares
            if best == math.inf:
                continue
            stiffness = leverage = variance = 0.0
            for n in range(count):
                h = weight[n] / total
                stiffness += (1.0 - h) / sigma2[n]
                leverage += (h * periods[n] / (2.0 * math.pi)) ** 2
                variance += sigma2[n] / count
            x_px[j, i] = (turn[0] + best_order) * periods[0] + best_shift
            out[0, j, i] = math.sqrt(1.0 / total)
            out[1, j, i] = max(best, 0.0)
            out[2, j, i] = math.exp(-0.5 * (second - best)) if second < math.inf else 0.0
            out[3, j, i] = stiffness
            out[4, j, i] = leverage
            out[5, j, i] = math.sqrt(variance)


def unwrap(
    phasors: Phasors, axis: int, noise: NoiseModel, mean: Single, size_px: float, bright: Mask
) -> Places:
    """Places along the columns (axis 0) or rows (1) of an LCD of `size_px`, for the pixels `bright`.

    mean: (rows, cols) grey without disturbances, which with the amplitude gives the noise of every shift's
    frame. Orders are searched from half a shortest period before the LCD's first pixel to as far past its
    last.
    """
    sequence = phasors.sequence
    order = np.argsort(sequence.periods_px)
    periods = np.asarray(sequence.periods_px, dtype=np.float64)[order]
    waves, solve = fit_matrices(sequence.shifts_rad)
    shape = bright.shape
    x = np.full(shape, np.nan)
    out = np.full((6, *shape), np.nan, dtype=np.float32)
    margin = 0.5 * periods[0]
    _unwrap(
        np.ascontiguousarray(phasors.cosine[axis, order]),
        np.ascontiguousarray(phasors.sine[axis, order]),
        mean,
        bright,
        periods,
        (noise.constant_grey2, noise.slope_grey, QUANTISATION),
        1.0 / sequence.repeats,
        solve,
        waves,
        -margin,
        size_px - 1.0 + margin,
        x,
        out,
    )
    return Places(x, *out)


def folded_harmonic(phasors: Phasors, places: list[Places], sound: Mask) -> Float:
    """Share e of the aliased harmonic, (2, periods), over the pixels `sound` (rows, cols)."""
    sequence = phasors.sequence
    count = len(sequence.shifts_rad)
    shares = np.zeros((2, len(sequence.periods_px)))
    index = np.flatnonzero(sound)
    index = index[:: max(1, len(index) // _SAMPLES)]
    # the shifts divide the turn evenly, in any order
    turns = np.sort(np.mod(np.asarray(sequence.shifts_rad) - sequence.shifts_rad[0] + 1e-9, 2 * np.pi))
    even = np.allclose(np.diff(turns), 2 * np.pi / count, atol=1e-6)
    if len(index) < _LEAST_SAMPLES or not even or len(sequence.periods_px) < 2:
        return shares
    weight = 1.0 / np.asarray(sequence.periods_px) ** 2
    free = 1.0 - weight / weight.sum()  # share of a phase error that does not move the place
    for axis, place in enumerate(places):
        x = place.x_px.ravel()[index]
        for n, period in enumerate(sequence.periods_px):
            phase = np.arctan2(phasors.sine[axis, n].ravel()[index], phasors.cosine[axis, n].ravel()[index])
            misfit = np.angle(np.exp(1j * (phase - 2 * np.pi * x / period)))
            wave = np.sin(count * phase)
            shares[axis, n] = -float(np.mean(wave * misfit) / np.mean(wave * wave)) / free[n]
    return shares


def without_harmonic(phasors: Phasors, shares: Float) -> Phasors:
    """Phasors without the aliased harmonic of these shares (2, periods)."""
    folded = len(phasors.sequence.shifts_rad) - 1
    cosine, sine = phasors.cosine.copy(), phasors.sine.copy()
    for axis, n in np.ndindex(shares.shape):
        measured = phasors.cosine[axis, n] + 1j * phasors.sine[axis, n]
        z = measured
        for _ in range(_ROUNDS):  # the error falls by the share in each round
            z = measured - np.float32(shares[axis, n]) * np.abs(z) * np.exp(-1j * folded * np.angle(z))
        cosine[axis, n], sine[axis, n] = z.real, z.imag
    return replace(phasors, cosine=cosine, sine=sine)
