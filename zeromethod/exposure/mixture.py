"""Mixtures: the effect of two or more pictures in one exposure on the residual, exact for a carrier.

At a node picture i is displaced by d + s_i, where q_i((u, v) + d + s_i) = q_mix((u, v) + d): s_i is the
displacement of that picture against the mix. Light adds up, so along each carrier the observed phasor is

    exp(i k d) sum_i w_i exp(i k s_i),

and the sensor's residual is d + b, b = arg(sum_i w_i exp(i k s_i)) / k. The sum's length is the
share of the carrier's amplitude that is left. b is third order in the spread (the weighted mean of s_i is
zero to first order), so a mix of similar pictures acts as the mix of their warps.

Where the target itself moves (`zeromethod.pattern.stepping`) picture i shows it with a phase t_i that is
known exactly. It is no displacement: the phasors are w_i exp(i (k s_i + t_i)), and b is what their sum's
argument differs by from that of sum_i w_i exp(i t_i), the target's own phase in that exposure.

Neglected, as second order: that s_i changes within the sensing window (a picture whose carrier is stretched
by 10 % weighs 1 % less in the window's sum), and that the mirror moves while the weights change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask

LEAST_COHERENCE = 0.5
"""Least share of the carrier's amplitude in the mix: below, small errors of weight shift the phase a lot."""

LARGEST_BIAS_PERIODS = 1 / 16
"""Largest bias along a carrier that is corrected.

A steady motion stays below. After a sudden press pictures are periods apart, and their spread varies so much
within the sensing window that the neglected terms (see the module) are tenths of the bias.
"""

SPREAD_ABOVE_PERIODS = 0.125
"""Spread above which a sensor without carriers cannot read a mix.

At 1/8 a mix of 20 % and 80 % is 0.02 px in error, at 1/16 0.003 px: the error is third order.
"""

SPREAD_WEIGHT = 0.02
"""Pictures with less weight than this at a node do not count towards its spread."""

SAME_LCD_PX = 1 / 16
"""Warps closer than this at a node count as equal: the effect of the difference is below 1e-5 px."""

_FAST = {"contract", "reassoc", "nsz", "arcp"}


def _odd_fit(function: str, limit: float, terms: int) -> tuple[float, ...]:
    """Coefficients of x, x^3, ... of an odd function on +-limit, by least squares on Chebyshev points."""
    x = limit * np.cos(np.pi * (np.arange(200) + 0.5) / 400)
    powers = x[:, None] ** (2 * np.arange(terms) + 1)
    return tuple(np.linalg.lstsq(powers, getattr(np, function)(x), rcond=None)[0].tolist())


# Within 1e-6 rad; free of branches, so that the compiler vectorises a row of nodes.
_S0, _S1, _S2, _S3, _S4 = _odd_fit("sin", math.pi / 2, 5)
_A0, _A1, _A2, _A3, _A4, _A5, _A6 = _odd_fit("arctan", 1.0, 7)


@dataclass(frozen=True, slots=True)
class Mixture:
    """Effect of mixing at each node.

    mixed: (rows, cols) where the pictures are too different to be read. bias_px: (rows, cols, 2) b above,
    camera px, at (u, v) + d, a function of where the node looks on the mix; None where the sensor has no
    carriers.
    """

    mixed: Mask
    bias_px: Float | None


@numba.njit(cache=True, fastmath=_FAST, inline="always")
def _sine(x: float) -> float:
    """Sine for |x| <= pi / 2."""
    y = x * x
    value: float = x * (_S0 + y * (_S1 + y * (_S2 + y * (_S3 + y * _S4))))
    return value


@numba.njit(cache=True, fastmath=_FAST, inline="always")
def _arctan(x: float) -> float:
    """Arc tangent for |x| <= 1."""
    y = x * x
    value: float = x * (_A0 + y * (_A1 + y * (_A2 + y * (_A3 + y * (_A4 + y * (_A5 + y * _A6))))))
    return value


@numba.njit(cache=True, fastmath=_FAST)
def _displacements(warps: Float, slots: Ints, q: Float, j: int, per_px: float, s: Float) -> bool:
    """Fill s (pictures, 2, cols) of node row j, camera px; False when no picture differs there.

    Solves q_i(x + s) = q(x) to second order in s: slopes and curvatures of q_i by central differences.
    """
    rows, cols = q.shape[0], q.shape[1]
    j1 = min(max(j, 1), rows - 2)
    differs = False
    for p in range(slots.size):
        w = warps[slots[p]]
        for i in range(cols):
            dx, dy = q[j, i, 0] - w[j, i, 0], q[j, i, 1] - w[j, i, 1]
            s[p, 0, i] = dx
            s[p, 1, i] = dy
            differs |= abs(dx) > SAME_LCD_PX or abs(dy) > SAME_LCD_PX
    if not differs:
        return False
    half, quarter = 0.5 * per_px, 0.25 * per_px * per_px
    for p in range(slots.size):
        w = warps[slots[p]]
        a, m, b = w[j1 - 1], w[j1], w[j1 + 1]
        for i in range(1, cols - 1):
            dx, dy = s[p, 0, i], s[p, 1, i]
            xu, yu = half * (m[i + 1, 0] - m[i - 1, 0]), half * (m[i + 1, 1] - m[i - 1, 1])
            xv, yv = half * (b[i, 0] - a[i, 0]), half * (b[i, 1] - a[i, 1])
            area = xu * yv - xv * yu
            inverse = 1.0 / (area if abs(area) > 1e-9 else 1e-9)
            su, sv = (yv * dx - xv * dy) * inverse, (xu * dy - yu * dx) * inverse
            # half the second-order term, 0.5 s H s
            uu, vv, uv = 2 * quarter * su * su, 2 * quarter * sv * sv, 0.25 * per_px * per_px * su * sv
            bx = uu * (m[i + 1, 0] - 2 * m[i, 0] + m[i - 1, 0]) + vv * (b[i, 0] - 2 * m[i, 0] + a[i, 0])
            by = uu * (m[i + 1, 1] - 2 * m[i, 1] + m[i - 1, 1]) + vv * (b[i, 1] - 2 * m[i, 1] + a[i, 1])
            bx += uv * (b[i + 1, 0] - b[i - 1, 0] - a[i + 1, 0] + a[i - 1, 0])
            by += uv * (b[i + 1, 1] - b[i - 1, 1] - a[i + 1, 1] + a[i - 1, 1])
            s[p, 0, i] = su - (yv * bx - xv * by) * inverse
            s[p, 1, i] = sv - (xu * by - yu * bx) * inverse
        for c in range(2):
            s[p, c, 0] = s[p, c, 1]
            s[p, c, cols - 1] = s[p, c, cols - 2]
    return True


@numba.njit(cache=True, fastmath=_FAST)
def _shares(weights: Float, place: Float, share: Float, heaviest: Float) -> None:
    """Share (pictures, cols) of each picture along a node row, and the index of the largest."""
    last = weights.shape[0] - 1
    for i in range(place.size):
        n = min(int(place[i]), last - 1)
        t = place[i] - n
        best = 0
        for p in range(weights.shape[1]):
            share[p, i] = (1.0 - t) * weights[n, p] + t * weights[n + 1, p]
            if share[p, i] > share[best, i]:
                best = p
        heaviest[i] = best


@numba.njit(cache=True, fastmath=_FAST)
def _sum_phasors(phase: Float, share: Float, heaviest: Float, total: Float, bias: Float, left: Float) -> None:
    """Argument of sum w exp(i phase) of a node row, in `bias`; a lower bound of its length, in `left`.

    The angle is relative to the heaviest picture's, which is continuous from node to node wherever that
    outweighs the others. Beyond half a turn from it the length is that at half a turn: a picture a whole
    turn away agrees in phase again, but the turn is then ambiguous.
    """
    cols = bias.size
    pictures = share.shape[0]
    turn = 2 * math.pi
    re, im, least, side, middle = total[0], total[1], total[2], total[3], total[4]
    for i in range(cols):
        re[i] = im[i] = least[i] = side[i] = 0.0
        middle[i] = phase[int(heaviest[i]), i]
    for p in range(pictures):
        for i in range(cols):
            x = phase[p, i] - middle[i]
            y = 0.5 * (x - turn * np.rint(x / turn))
            # cos 2y = 1 - 2 sin^2 y and sin 2y = 2 sin y cos y, cos y = sin(pi/2 - |y|)
            s, c = _sine(y), _sine(0.5 * math.pi - abs(y))
            w = share[p, i]
            real, imaginary = w * (1.0 - 2.0 * s * s), w * 2.0 * s * c
            re[i] += real
            im[i] += imaginary
            within = abs(x) < math.pi
            least[i] += real if within else -w
            side[i] += imaginary if within else 0.0
    for i in range(cols):
        length = math.sqrt(re[i] * re[i] + im[i] * im[i])
        # a negative real part leaves the turn ambiguous; such nodes get length 0, below
        half = im[i] / max(length + max(re[i], 0.0), 1e-9)
        bias[i] = middle[i] + 2.0 * _arctan(half)
        kept = math.sqrt(least[i] * least[i] + side[i] * side[i])
        left[i] = min(left[i], kept if re[i] > 0.0 else 0.0)


@numba.njit(cache=True, fastmath=_FAST)
def _less_target(target: Float, c: int, place: Float, last: int, angle: Float) -> None:
    """Take the target's own phase along carrier c, (n, 2) at n panel rows, out of a node row's angles."""
    turn = 2 * math.pi
    for i in range(angle.size):
        n = min(int(place[i]), last - 1)
        t = place[i] - n
        apart = angle[i] - ((1.0 - t) * target[n, c] + t * target[n + 1, c])
        angle[i] = apart - turn * np.rint(apart / turn)


@numba.njit(cache=True, fastmath=_FAST)
def _carrier_mixture(
    warps: Float,
    slots: Ints,
    weights: Float,
    place: Float,
    q: Float,
    per_px: float,
    wavenumber: float,
    diagonal: bool,
    turns: Float,
    target: Float,
    bias: Float,
    mixed: Mask,
) -> None:
    rows, cols = q.shape[0], q.shape[1]
    count, last = slots.size, weights.shape[0] - 1
    s, phase = np.empty((count, 2, cols)), np.empty((count, cols))
    share, heaviest, total = np.empty((count, cols)), np.empty(cols), np.empty((5, cols))
    angle, left = np.empty((2, cols)), np.empty(cols)
    for j in range(rows):
        if not _displacements(warps, slots, q, j, per_px, s):
            bias[j] = 0.0
            mixed[j] = False
            continue
        _shares(weights, place[j], share, heaviest)
        left[:] = 1.0
        for c in range(2):
            sign = 1.0 if c == 0 else -1.0
            for p in range(count):
                for i in range(cols):
                    along = s[p, 0, i] + sign * s[p, 1, i] if diagonal else s[p, c, i]
                    phase[p, i] = wavenumber * along + turns[p, c]
            _sum_phasors(phase, share, heaviest, total, angle[c], left)
            if target.shape[0] > 0:
                _less_target(target, c, place[j], last, angle[c])
        scale, most = 1.0 / wavenumber, LARGEST_BIAS_PERIODS * 2 * math.pi / wavenumber
        for i in range(cols):
            a, b = scale * angle[0, i], scale * angle[1, i]
            bias[j, i, 0] = 0.5 * (a + b) if diagonal else a
            bias[j, i, 1] = 0.5 * (a - b) if diagonal else b
            mixed[j, i] = left[i] < LEAST_COHERENCE or max(abs(a), abs(b)) > most


@numba.njit(cache=True, fastmath=_FAST)
def _spread_mixture(
    warps: Float,
    slots: Ints,
    weights: Float,
    place: Float,
    q: Float,
    per_px: float,
    most_px: float,
    mixed: Mask,
) -> None:
    rows, cols = q.shape[0], q.shape[1]
    count = slots.size
    s, share, heaviest = np.empty((count, 2, cols)), np.empty((count, cols)), np.empty(cols)
    for j in range(rows):
        mixed[j] = False
        if _displacements(warps, slots, q, j, per_px, s):
            _shares(weights, place[j], share, heaviest)
            for i in range(cols):
                best = int(heaviest[i])
                for p in range(count):
                    if share[p, i] > SPREAD_WEIGHT:
                        apart = math.hypot(s[p, 0, i] - s[best, 0, i], s[p, 1, i] - s[best, 1, i])
                        mixed[j, i] |= apart > most_px


def mixture(
    warps: Float,
    slots: Ints,
    weights: Float,
    place: Float,
    q: Float,
    spacing_px: float,
    period_px: float,
    kind: str,
    moving: tuple[Float, Float] | None = None,
) -> Mixture:
    """Effect of mixing the pictures `warps[slots]` on the residual against their mix `q`.

    warps: (any, rows, cols, 2) LCD px. weights: (n, k) share of each at n panel rows. place: (rows, cols)
    where among these each node of the mix looks, 0..n - 1. q: (rows, cols, 2) LCD px. kind: the target's;
    cosines and lattice have carriers along u and v, checker along u + v and u - v. Noise has no carrier:
    no bias, and mixed where the spread exceeds 1/8 period. moving: of a moving target, (k, 2) rad, its phase
    along the two carriers in each picture, and (n, 2) in the mix at the n panel rows.

    Convention: residual d as observed(u, v) = T((u, v) + d), camera px.
    """
    mixed = np.empty(q.shape[:2], np.bool_)
    if kind == "noise":
        most_px = SPREAD_ABOVE_PERIODS * period_px
        _spread_mixture(warps, slots, weights, place, q, 1 / spacing_px, most_px, mixed)
        return Mixture(mixed, None)
    bias = np.empty_like(q)
    wavenumber = 2 * math.pi / period_px
    turns, target = moving or (np.zeros((slots.size, 2)), np.zeros((0, 2)))
    carriers = wavenumber, kind == "checker", turns, target
    _carrier_mixture(warps, slots, weights, place, q, 1 / spacing_px, *carriers, bias, mixed)
    return Mixture(mixed, bias)
