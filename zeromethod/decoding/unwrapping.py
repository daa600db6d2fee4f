"""Temporal unwrapping: absolute places from wrapped phases of several periods, with odds of a wrong order.

Every order of the shortest period is a candidate; the other periods take the order that lies nearest to it,
and the place is then the weighted mean. chi^2 of that mean measures the agreement of the periods:

    chi^2(orders) = sum_j w_j (x_j - x)^2,  x_j = (phase_j / 2 pi + order_j) P_j,  w_j = (2 pi / P_j /
    sigma_j)^2

The best candidate is the maximum-likelihood order. The difference to the next best chi^2 gives the odds that
it is wrong, exp(-difference / 2). All orders are compared at once, not period by period.

Most pixels need no search: any two candidates are at least d apart (`periods.rivals`), so by the triangle
inequality every other one than a candidate has a chi^2 of at least (d - sqrt(chi^2))^2, with its own chi^2;
d is that of usual noise, less for a pixel by as much as its noisiest period, against the usual, is worse.
The order nearest to the pixel before is tried so; where that does not prove it the best by far, all orders
are searched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask, Single
from zeromethod.decoding.decoding import Phasors, fit_matrices
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import rivals
from zeromethod.kernels import kernel, piece, read

TABLE = 512
"""Steps of a turn in a table of phase corrections, between which it is linear."""

BINS = 8
"""Parts of a turn's fold (see `Waves`) whose noise is found by itself."""

_CLEAR = 20.0
"""Lead in chi^2 of the best order, odds of 1 : 20,000, below which the next best is searched, not bounded."""

_SURE = 200.0
_SAMPLES = 200


@dataclass(frozen=True, slots=True)
class Places:
    """Absolute place along one axis of the LCD, per pixel (rows, cols); NaN where not unwrapped.

    x_px: LCD px. sigma_px: from the camera's noise. chi2: disagreement of the periods, of `degrees` degrees
    of freedom. odds: of the second-best order against the best, 0 to 1, or their bound. stiffness: d(expected
    chi2) / d(variance of a phase error common in size to all periods, rad^2). leverage_px2: variance of x
    that such an error of 1 rad^2 brings. phase_sigma_rad: of the periods, rms. coherent: share of the
    expected chi2 that comes from errors alike in neighbouring pixels, which an average does not lessen.
    """

    x_px: Float
    sigma_px: Single
    chi2: Single
    odds: Single
    stiffness: Single
    leverage_px2: Single
    phase_sigma_rad: Single
    degrees: int
    coherent: float


@dataclass(frozen=True, slots=True)
class Waves:
    """Wrapped phases of one axis, the shortest period first.

    periods_px: rising. turn: (periods, rows, cols) phases, -1/2 to 1/2 turn. variance: same shape, rad^2, to
    be multiplied by `factor` (periods, `BINS`). folds: by which part of a turn noise repeats, as the shifts
    do.
    """

    periods_px: Float
    turn: Single
    variance: Single
    factor: Single
    folds: int

    @classmethod
    def of(
        cls, phasors: Phasors, axis: int, noise: NoiseModel, mean: Single, at: Ints | None = None
    ) -> Waves:
        """Phases of the image, or of its flat indices `at` as one row.

        mean: (rows, cols) grey without disturbances, whose noise is that of the frames.
        """
        periods = np.asarray(phasors.sequence.periods[axis], dtype=np.float64)
        order = np.argsort(periods)
        _, solve = fit_matrices(phasors.sequence.shifts_rad)
        spread = solve[1:3] @ solve[1:3].T / phasors.sequence.repeats
        seen = mean if at is None else mean.ravel()[at][None]
        grey2 = noise.variance(seen).astype(np.float32)
        turn, variance = np.empty((2, len(order), *grey2.shape), np.float32)
        for n, period in enumerate(order):
            c, s = phasors.cosine[axis][period], phasors.sine[axis][period]
            if at is not None:
                c, s = c.ravel()[at][None], s.ravel()[at][None]
            np.arctan2(s, c, out=turn[n])
            turn[n] *= np.float32(0.5 / np.pi)
            power = np.maximum(c * c + s * s, np.float32(1e-12))
            (cc, cs), (_, ss) = spread.astype(np.float32)
            variance[n] = (s * s * cc - np.float32(2.0) * s * c * cs + c * c * ss) * grey2 / power**2
        folds = len(phasors.sequence.shifts_rad) if phasors.sequence.even else 1
        return cls(periods[order], turn, variance, np.ones((len(order), BINS), np.float32), folds)

    def scaled(self, factor: Float) -> Waves:
        """The same with the variance times `factor` (periods, `BINS`)."""
        return replace(self, factor=factor.astype(np.float32))

    def corrected(self, tables: Single | None) -> tuple[Single, Single]:
        """Phases plus their tables' corrections, and their variances times their factors."""
        turn, variance = self.turn, self.variance
        if tables is not None and tables.any():
            turn = np.empty_like(turn)
            for n, table in enumerate(tables):
                turn[n] = corrected(self.turn[n], table)
        if not (self.factor == 1.0).all():
            variance = variance.copy()
            for n, factor in enumerate(self.factor):
                variance[n] *= factor[bin_of(self.turn[n], self.folds)]
        return turn, variance

    def part(self, step: int) -> Waves:
        """Every `step`-th pixel along the row."""
        one, other = (np.ascontiguousarray(of[..., ::step]) for of in (self.turn, self.variance))
        return replace(self, turn=one, variance=other)


def bin_of(turn: Single, folds: int) -> Ints:
    """Numbers, below `BINS`, of the parts of a fold in which phases (n,) lie."""
    return ((turn.astype(np.float64) + 0.5) * (folds * BINS)).astype(np.int64) % BINS


def corrected(turn: Single, table: Single) -> Float:
    """Phases of any shape, turns, plus the correction of a table (`TABLE` + 1,) over the turn from -1/2."""
    return np.asarray(turn + np.interp(turn, np.linspace(-0.5, 0.5, TABLE + 1), table))


@piece
def _search(
    turn: Float, weight: Float, spread: float, periods: Float, low: float, high: float
) -> tuple[float, float, float, float]:
    """Best order of the shortest period, its shift to the weighted mean, its chi^2 and the next best's."""
    count = len(periods)
    first = math.ceil(low / periods[0] - turn[0])
    last = math.floor(high / periods[0] - turn[0])
    best = second = math.inf
    best_shift = best_order = 0.0
    for order in range(first, last + 1):
        sw1 = sw2 = 0.0
        for n in range(1, count):
            # x_n - x_0 with the order of period n that brings it nearest
            at = (turn[0] + order) * periods[0] / periods[n] - turn[n]
            r = (np.rint(at) - at) * periods[n]
            sw1 += weight[n] * r
            sw2 += weight[n] * r * r
        squares = sw2 - sw1 * sw1 * spread
        if squares < best:
            second, best = best, squares
            best_order, best_shift = float(order), sw1 * spread
        elif squares < second:
            second = squares
    return best_order, best_shift, best, second


@kernel(
    read(numba.float32, 3),
    read(numba.float32, 3),
    read(numba.boolean, 2),
    read(numba.float64, 1),
    read(numba.float64, 1),
    numba.float64,
    numba.float64,
    numba.float64,
    numba.float64[:, ::1],
    numba.float32[:, :, ::1],
)
def _unwrap(
    turns: Single,
    variances: Single,
    bright: Mask,
    periods: Float,
    usual: Float,
    separation: float,
    low: float,
    high: float,
    x_px: Float,
    out: Single,
) -> None:
    """Places of all pixels, from phases, turns, and their variances, rad^2.

    separation: of rivals where periods have the variance `usual`, rad^2. out: (6, rows, cols), see `Places`.
    """
    count, rows, cols = turns.shape
    turn, weight, inverse = np.empty(count), np.empty(count), np.empty(count)
    wave2, ratio, per_usual = np.empty(count), np.empty(count), np.empty(count)
    for n in range(count):
        wave2[n], ratio[n] = (2.0 * math.pi / periods[n]) ** 2, periods[0] / periods[n]
        per_usual[n] = 1.0 / usual[n]
    per_px, per_count, single = 1.0 / periods[0], 1.0 / count, np.float32
    known = math.nan
    for j in range(rows):
        for i in range(cols):
            if not bright[j, i]:
                continue
            total = most = variance = 0.0
            for n in range(count):
                turn[n], sigma2 = turns[n, j, i], float(variances[n, j, i])
                inverse[n] = 1.0 / sigma2
                weight[n] = wave2[n] * inverse[n]
                total += weight[n]
                most = max(most, sigma2 * per_usual[n])
                variance += sigma2
            spread = 1.0 / total
            order = np.rint(known * per_px - turn[0])
            sw1 = sw2 = 0.0
            for n in range(1, count):
                at = (turn[0] + order) * ratio[n] - turn[n]
                r = (np.rint(at) - at) * periods[n]
                sw1 += weight[n] * r
                sw2 += weight[n] * r * r
            shift, best = sw1 * spread, max(sw2 - sw1 * sw1 * spread, 0.0)
            nearest = separation / math.sqrt(single(most)) - math.sqrt(single(best))
            second = nearest * nearest
            x = (turn[0] + order) * periods[0]
            if not (nearest > 0.0 and second > best + _CLEAR and low <= x <= high):
                order, shift, best, second = _search(turn, weight, spread, periods, low, high)
                if best == math.inf:
                    continue
                x = (turn[0] + order) * periods[0]
            known = x  # without the shift: the next pixel need not wait for it
            stiffness = leverage = 0.0
            for n in range(count):
                h = weight[n] * spread
                stiffness += (1.0 - h) * inverse[n]
                leverage += h * h / wave2[n]
            x_px[j, i] = x + shift
            out[0, j, i] = math.sqrt(single(spread))
            out[1, j, i] = max(best, 0.0)
            out[2, j, i] = math.exp(-0.5 * (second - best)) if second - best < _SURE else 0.0
            out[3, j, i] = stiffness
            out[4, j, i] = leverage
            out[5, j, i] = math.sqrt(single(variance * per_count))


@dataclass(frozen=True, slots=True)
class Rivalry:
    """How far apart orders are: variance: usual one of each period, rad^2; separation: least d with it."""

    variance: Float
    separation: float

    @classmethod
    def of(cls, waves: Waves, size_px: float, bright: Mask) -> Rivalry:
        """By the medians over the pixels `bright`."""
        index = np.flatnonzero(bright)
        usual = np.ones(len(waves.variance))
        if len(index):
            some = waves.variance.reshape(len(usual), -1)[:, index[:: len(index) // _SAMPLES + 1]]
            usual = np.asarray(np.median(some, axis=1) * waves.factor.mean(axis=1), dtype=np.float64)
        apart = rivals(waves.periods_px, np.sqrt(usual), size_px + float(waves.periods_px[0]))[1]
        return cls(usual, float(apart.min()) if len(apart) else math.inf)


def unwrap(
    waves: Waves,
    size_px: float,
    bright: Mask,
    tables: Single | None = None,
    coherent: float = 0.0,
    rivalry: Rivalry | None = None,
) -> Places:
    """Places along one axis of an LCD of `size_px`, for the pixels `bright`.

    tables: (periods, `TABLE` + 1) correction of the phase over the turn, turns, periods rising. coherent: as
    in `Places`. rivalry: of these waves, where it is known. Orders are searched from half a shortest period
    before the LCD's first pixel to as far past its last.
    """
    periods = waves.periods_px
    x = np.full(bright.shape, np.nan)
    out = np.full((6, *bright.shape), np.nan, dtype=np.float32)
    margin = 0.5 * float(periods[0])
    rivalry = rivalry or Rivalry.of(waves, size_px, bright)
    _unwrap(
        *waves.corrected(tables),
        bright,
        periods,
        rivalry.variance,
        rivalry.separation,
        -margin,
        size_px - 1.0 + margin,
        x,
        out,
    )
    return Places(x, out[0], out[1], out[2], out[3], out[4], out[5], len(periods) - 1, coherent)
