"""Harmonics that the shifts alias onto the fundamental: found in the periods' disagreement, and taken out.

N equal shifts cannot separate harmonic N - 1 from the fundamental with reversed phase: with a share e of it,
the phasor comes out as z + e |z| exp(-i (N - 1) phase), its phase off by -e sin(N phase). An LCD drawn
without its inverse response has e = 0.2 for N = 3, 0.01 for N = 4, 0.001 for N = 5 (gamma 2.2).

The shares of all periods are fitted together. With weights w_n and g_n = -sin(N phase_n) P_n / 2 pi, period n
lies d_n = sum over m of (delta_nm - w_m / W) g_m e_m off the weighted mean, so

    sum over pixels of (delta_nm w_n g_n^2 - w_n g_n w_m g_m / W) e_m = sum over pixels of w_n g_n d_n

A share counts where it exceeds its own scatter over parts of the view, and a round of the fit where it makes
the periods agree better; else the phases stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.special import chdtr, chdtri

from zeromethod.arrays import Float, Ints, Mask, Single
from zeromethod.decoding.decoding import Phasors, phase_squares
from zeromethod.decoding.fringes import FringeSequence
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import LONGEST_RATIO
from zeromethod.decoding.unwrapping import BINS, TABLE, Places, Rivalry, Waves, bin_of, corrected, unwrap

LEAST_SHARE = 0.0005
"""Below this a harmonic moves a place by less than a 10000th of the period."""

_SAMPLES = 5000
_LEAST_SAMPLES = 400
_LEAST_IN_BIN = 100
_CLIP = 9.0
# of squares of unit normal deviates, clipped: those below, and the rest at the clip
_CLIPPED = float(chdtr(3, _CLIP) + _CLIP * (1.0 - chdtr(1, _CLIP)))
_ROUNDS = 8
_SETTLED = 0.99
# every so many samples: for a first try, for periods that are far off
_FIRST, _FEW = 8, 8
_PARTS = 8
_SIGMAS = 3.0
_OUTLYING = 20.0
_LEAST_FACTOR = 1e-6

_DIFFERS = 0.2
"""Logarithm of the scatter of neighbouring phases over that of the noise model, from which on it is taken."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """What the periods' agreement says about the phases of one axis; arrays follow the rising periods.

    shares: of the aliased harmonic. tables: the phase corrections for it. noise: (periods, `BINS`) factor on
    each period's variance by which neighbouring pixels' phases scatter, see `Waves`. excess: further factor
    on periods far longer than the shortest, so that it covers what they are off.
    """

    tables: Single
    shares: Float
    noise: Float
    excess: Float


@cache
def _grid(shifts: int) -> tuple[Float, Float, Float, Float]:
    """Phases before and after correction, rad, and cosine and sine of the former times the shifts."""
    true = 2 * np.pi * np.linspace(-0.6, 0.6, TABLE + 1)
    wanted = 2 * np.pi * np.linspace(-0.5, 0.5, TABLE + 1)
    return true, wanted, np.cos(shifts * true), np.sin(shifts * true)


def correction(shares: Float, shifts: int) -> Single:
    """Tables (periods, `TABLE` + 1), turns, that take the harmonic of these shares out of the phase."""
    true, wanted, cosine, sine = _grid(shifts)
    tables = np.zeros((len(shares), TABLE + 1), np.float32)
    for table, share in zip(tables, shares, strict=True):
        if share == 0:
            continue
        measured = true - np.arctan2(share * sine, 1.0 + share * cosine)
        table[:] = (np.interp(wanted, measured, true) - wanted) / (2 * np.pi)
    return tables


def sample(sound: Mask) -> Ints:
    """Flat indices, rising, of the pixels `sound` in some rows, which are taken whole."""
    step = max(1, np.count_nonzero(sound) // _SAMPLES)
    row, col = np.nonzero(sound[::step])
    return np.asarray(row * (step * sound.shape[1]) + col)


def agreement(
    phasors: Phasors,
    axis: int,
    noise: NoiseModel,
    mean: Single,
    size_px: float,
    at: Ints,
    least_noise: float,
) -> Agreement:
    """Shares of the aliased harmonic and scale of the noise, from the pixels `at`, see `sample`.

    least_noise: smallest factor on the noise.
    """
    waves = Waves.of(phasors, axis, noise, mean, at)
    shifts, count = len(phasors.sequence.shifts_rad), len(waves.periods_px)
    shares = np.zeros(count)
    found = Agreement(correction(shares, shifts), shares, np.ones((count, BINS)), np.ones(count))
    if len(at) < _LEAST_SAMPLES:
        return found
    found, _ = _improved(waves.part(_FIRST), size_px, found, phasors.sequence)
    in_row = (at[4:] - at[:-4] == 4) & (at[4:] % mean.shape[1] >= 4)
    factor = _scatter(waves, found.tables, in_row)
    if np.any(np.abs(np.log(np.median(factor, axis=1))) > _DIFFERS):
        found = replace(found, noise=np.maximum(factor, least_noise))
        waves = waves.scaled(found.noise)
    found, places = _improved(waves, size_px, found, phasors.sequence)
    return replace(found, excess=_excess(waves, places, found.tables))


def _improved(
    waves: Waves, size_px: float, found: Agreement, sequence: FringeSequence
) -> tuple[Agreement, Places]:
    """The shares of the round with which the periods agree best, and its places."""
    every = np.ones(waves.turn.shape[1:], np.bool_)
    rivalry = Rivalry.of(waves, size_px, every)
    places = unwrap(waves, size_px, every, found.tables, rivalry=rivalry)
    if not sequence.even:
        return found, places
    shifts = len(sequence.shifts_rad)
    cap = _OUTLYING * float(np.median(places.chi2[np.isfinite(places.chi2)]))
    least = _score(places.chi2, cap)
    part = 1.0
    for _ in range(_ROUNDS):
        step = part * (_refined(waves, places, found, shifts) - found.shares)
        shares = found.shares + step
        if np.max(np.abs(step)) < LEAST_SHARE:
            break
        if np.max(np.abs(shares)) * shifts < 1.0:  # else phases would no longer rise with the place
            tables = correction(shares, shifts)
            tried = unwrap(waves, size_px, every, tables, rivalry=rivalry)
            if (score := _score(tried.chi2, cap)) < least:
                found, places = replace(found, tables=tables, shares=shares), tried
                settled, least, part = score > _SETTLED * least, score, 1.0
                if settled:
                    break
                continue
        part *= 0.5
    return found, places


def _scatter(waves: Waves, tables: Single, in_row: Mask) -> Float:
    """Scatter of neighbouring phases over the variance, (periods, `BINS`), median over the pixels.

    It depends on the phase where noise depends on the grey level. in_row: (n - 4,) whether five pixels,
    one after the other, are neighbours.
    """
    found = np.ones((len(waves.turn), BINS))
    if np.count_nonzero(in_row) < _LEAST_SAMPLES:
        return found
    for n, row in enumerate(found):
        turn, variance = waves.turn[n, 0], waves.variance[n, 0]
        ratio = phase_squares(corrected(turn, tables[n]))[in_row] * (2 * np.pi) ** 2
        ratio /= variance[2:-2][in_row]
        usual = max(float(np.median(ratio)) / float(chdtri(1, 0.5)), _LEAST_FACTOR)
        at = bin_of(turn[2:-2][in_row], waves.folds)
        count = np.bincount(at, minlength=BINS)
        squares = np.bincount(at, np.minimum(ratio / usual, _CLIP), BINS)
        row[:] = usual * np.where(count >= _LEAST_IN_BIN, squares / np.maximum(count, 1) / _CLIPPED, 1.0)
    return np.maximum(found, _LEAST_FACTOR)


def _score(chi2: Single, cap: float) -> float:
    """Mean disagreement, to which no pixel adds more than `cap`; NaN does not count."""
    known = chi2[~np.isnan(chi2)]
    return float(np.minimum(known, cap).sum(dtype=np.float64)) / max(len(known), 1)


def _misfits(waves: Waves, places: Places, tables: Single) -> tuple[Float, Float, Float]:
    """Distance of every period's place from the mean, px, its weight, and its phase, turns: (periods, n)."""
    known = np.isfinite(places.x_px[0])
    periods, x = waves.periods_px[:, None], places.x_px[0, known]
    turn, variance = (part[:, 0, known].astype(np.float64) for part in waves.corrected(tables))
    off = turn - x / periods
    return (off - np.rint(off)) * periods, (2 * np.pi / periods) ** 2 / variance, turn


def _normal(off_px: Float, weight: Float, lever: Float) -> tuple[Float, Float]:
    """Both sides of the shares' equations, (parts, periods, periods) and (parts, periods)."""
    count, pixels = off_px.shape
    square, right = np.empty((_PARTS, count, count)), np.empty((_PARTS, count))
    pull, total = weight * lever, weight.sum(axis=0)
    for part, at in enumerate(np.array_split(np.arange(pixels), _PARTS)):
        right[part] = np.sum(pull[:, at] * off_px[:, at], axis=1)
        own = np.sum(pull[:, at] * lever[:, at], axis=1)
        square[part] = np.diag(own) - (pull[:, at] / total[at]) @ pull[:, at].T
    return square, right


def _solved(square: Float, right: Float) -> tuple[Float, Float]:
    """The shares' change, and its scatter over the parts of the view."""
    solve = np.linalg.pinv(square.sum(axis=0))
    step = solve @ right.sum(axis=0)
    scatter2 = np.sum(((right - square @ step) @ solve.T) ** 2, axis=0)
    # nor less than noise alone leaves it, as where the fringes are all seen at one phase
    return step, np.sqrt(np.maximum(scatter2, np.diag(solve)))


def _refined(waves: Waves, places: Places, found: Agreement, shifts: int) -> Float:
    """Shares with what is left of the harmonic; 0 where that does not exceed its scatter over the view."""
    off_px, weight, turn = _misfits(waves, places, found.tables)
    # single precision is many times faster, and enough for a weight
    sine = np.sin((-2 * np.pi * shifts * turn).astype(np.float32))
    lever = sine * (waves.periods_px[:, None] / (2 * np.pi))
    step, scatter = _solved(*_normal(off_px, weight, lever))
    shares = found.shares + step
    return np.where(np.abs(shares) > _SIGMAS * scatter, shares, 0.0)


def _excess(waves: Waves, places: Places, tables: Single) -> Float:
    """Factor, 1 or more, on the variance of periods above `LONGEST_RATIO` times the shortest.

    They hardly move the place, which therefore shows what they are off; and they give orders, not places.
    """
    off_px, weight, _ = _misfits(waves, places, tables)
    off_px, weight = off_px[:, ::_FEW], weight[:, ::_FEW]
    expected = 1.0 / weight - 1.0 / weight.sum(axis=0)
    ratio = np.median(off_px**2 / expected, axis=1) / float(chdtri(1, 0.5))
    coarse = waves.periods_px > LONGEST_RATIO * waves.periods_px[0]
    return np.where(coarse, np.maximum(ratio, 1.0), 1.0)
