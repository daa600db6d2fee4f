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

import numpy as np
from scipy.special import chdtr, chdtri

from zeromethod.arrays import Float, Mask, Single
from zeromethod.decoding.decoding import Phasors, phase_scatter
from zeromethod.decoding.fringes import FringeSequence
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import LONGEST_RATIO
from zeromethod.decoding.unwrapping import BINS, TABLE, Places, Waves, unwrap, without_harmonic

LEAST_SHARE = 0.0005
"""Below this a harmonic moves a place by less than a 10000th of the period."""

_SAMPLES = 5000
_LEAST_SAMPLES = 400
_LEAST_IN_BIN = 100
_CLIP = 9.0
# of squares of unit normal deviates, clipped: those below, and the rest at the clip
_CLIPPED = float(chdtr(3, _CLIP) + _CLIP * (1.0 - chdtr(1, _CLIP)))
_ROUNDS = 8
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


def correction(shares: Float, shifts: int) -> Single:
    """Tables (periods, `TABLE` + 1), turns, that take the harmonic of these shares out of the phase."""
    true = 2 * np.pi * np.linspace(-0.6, 0.6, 2 * TABLE + 1)
    wanted = 2 * np.pi * np.linspace(-0.5, 0.5, TABLE + 1)
    tables = np.zeros((len(shares), TABLE + 1), np.float32)
    for table, share in zip(tables, shares, strict=True):
        if share == 0:
            continue
        measured = true + np.angle(1.0 + share * np.exp(-1j * shifts * true))
        table[:] = (np.interp(wanted, measured, true) - wanted) / (2 * np.pi)
    return tables


def agreement(
    phasors: Phasors,
    axis: int,
    noise: NoiseModel,
    mean: Single,
    size_px: float,
    sound: Mask,
    least_noise: float,
) -> Agreement:
    """Shares of the aliased harmonic and scale of the noise, from some rows of the pixels `sound`.

    least_noise: smallest factor on the noise.
    """
    rows = slice(None, None, max(1, np.count_nonzero(sound) // _SAMPLES))
    waves = Waves.of(phasors, axis, noise, mean, rows)
    some = np.ascontiguousarray(sound[rows])
    shifts, count = len(phasors.sequence.shifts_rad), len(waves.periods_px)
    shares = np.zeros(count)
    found = Agreement(correction(shares, shifts), shares, np.ones((count, BINS)), np.ones(count))
    if np.count_nonzero(some) < _LEAST_SAMPLES:
        return found
    found, places = _improved(waves, size_px, some, found, phasors.sequence)
    factor = _scatter(waves, found.tables, some)
    if np.any(np.abs(np.log(np.median(factor, axis=1))) > _DIFFERS):
        found = replace(found, noise=np.maximum(factor, least_noise))
        waves = waves.scaled(found.noise)
        found, places = _improved(waves, size_px, some, found, phasors.sequence)
    return replace(found, excess=_excess(waves, places, found.tables, some))


def _improved(
    waves: Waves, size_px: float, some: Mask, found: Agreement, sequence: FringeSequence
) -> tuple[Agreement, Places]:
    """The shares of the round with which the periods agree best, and its places."""
    places = unwrap(waves, size_px, some, found.tables)
    if not sequence.even:
        return found, places
    shifts = len(sequence.shifts_rad)
    cap = _OUTLYING * float(np.nanmedian(places.chi2))
    least = _score(places, cap)
    part = 1.0
    for _ in range(_ROUNDS):
        step = part * (_refined(waves, places, found, shifts, some) - found.shares)
        shares = found.shares + step
        if np.max(np.abs(step)) < LEAST_SHARE:
            break
        if np.max(np.abs(shares)) * shifts < 1.0:  # else phases would no longer rise with the place
            tables = correction(shares, shifts)
            tried = unwrap(waves, size_px, some, tables)
            if (score := _score(tried, cap)) < least:
                found, places, least = replace(found, tables=tables, shares=shares), tried, score
                continue
        part *= 0.5
    return found, places


def _scatter(waves: Waves, tables: Single, some: Mask) -> Float:
    """Scatter of neighbouring phases over the variance, (periods, `BINS`), median over the pixels `some`.

    It depends on the phase where noise depends on the grey level.
    """
    inner = some.copy()
    for step in (-2, -1, 1, 2):
        inner &= np.roll(some, step, axis=1)
    inner[:, :2] = inner[:, -2:] = False
    found = np.ones((len(waves.turn), BINS))
    if np.count_nonzero(inner) < _LEAST_SAMPLES:
        return found
    turn = without_harmonic(waves.turn.reshape(len(tables), -1), tables).reshape(waves.turn.shape)
    ratio = phase_scatter(turn)[:, inner] * (2 * np.pi) ** 2 / waves.variance[:, inner]
    usual = np.maximum(np.median(ratio, axis=1) / float(chdtri(1, 0.5)), _LEAST_FACTOR)
    for row, one, place, scale in zip(found, ratio, waves.bins(waves.turn[:, inner]), usual, strict=True):
        squares = np.bincount(place, np.minimum(one / scale, _CLIP), BINS)
        count = np.bincount(place, minlength=BINS)
        row[:] = scale * np.where(count >= _LEAST_IN_BIN, squares / np.maximum(count, 1) / _CLIPPED, 1.0)
    return np.maximum(found, _LEAST_FACTOR)


def _score(places: Places, cap: float) -> float:
    """Mean disagreement, to which no pixel adds more than `cap`."""
    return float(np.nanmean(np.minimum(places.chi2, cap)))


def _misfits(waves: Waves, places: Places, tables: Single, some: Mask) -> tuple[Float, Float, Float]:
    """Distance of every period's place from the mean, px, its weight, and its phase, turns: (periods, n)."""
    at = some & np.isfinite(places.x_px)
    turn = without_harmonic(waves.turn[:, at], tables)
    period = waves.periods_px[:, None]
    off = turn - places.x_px[at] / period
    return (off - np.rint(off)) * period, (2 * np.pi / period) ** 2 / waves.variance[:, at], turn


def _refined(waves: Waves, places: Places, found: Agreement, shifts: int, some: Mask) -> Float:
    """Shares with what is left of the harmonic; 0 where that does not exceed its scatter over the view."""
    off_px, weight, turn = _misfits(waves, places, found.tables, some)
    lever = -np.sin(2 * np.pi * shifts * turn) * waves.periods_px[:, None] / (2 * np.pi)
    pull, total = weight * lever, weight.sum(axis=0)
    parts = np.array_split(np.arange(off_px.shape[1]), _PARTS)
    square = np.array([-(pull[:, p] / total[p]) @ pull[:, p].T for p in parts])
    count = np.arange(len(lever))
    square[:, count, count] += [(pull[:, p] * lever[:, p]).sum(axis=1) for p in parts]
    right = np.array([(pull[:, p] * off_px[:, p]).sum(axis=1) for p in parts])
    solve = np.linalg.pinv(square.sum(axis=0))
    step = solve @ right.sum(axis=0)
    scatter = np.sqrt((((right - square @ step) @ solve.T) ** 2).sum(axis=0))
    # nor less than noise alone leaves it, as where the fringes are all seen at one phase
    scatter = np.maximum(scatter, np.sqrt(np.maximum(np.diag(solve), 0.0)))
    shares = found.shares + step
    return np.where(np.abs(shares) > _SIGMAS * scatter, shares, 0.0)


def _excess(waves: Waves, places: Places, tables: Single, some: Mask) -> Float:
    """Factor, 1 or more, on the variance of periods above `LONGEST_RATIO` times the shortest.

    They hardly move the place, which therefore shows what they are off; and they give orders, not places.
    """
    off_px, weight, _ = _misfits(waves, places, tables, some)
    expected = 1.0 / weight - 1.0 / weight.sum(axis=0)
    ratio = np.median(off_px**2 / expected, axis=1) / float(chdtri(1, 0.5))
    coarse = waves.periods_px > LONGEST_RATIO * waves.periods_px[0]
    return np.where(coarse, np.maximum(ratio, 1.0), 1.0)
