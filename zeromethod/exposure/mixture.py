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
from zeromethod.exposure.panel_rows import at_rows
from zeromethod.kernels import kernel, piece, read

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


@piece(fastmath=_FAST, inline="always")
def _sine(x: float) -> float:
    """Sine for |x| <= pi / 2."""
    y = x * x
    value: float = x * (_S0 + y * (_S1 + y * (_S2 + y * (_S3 + y * _S4))))
    return value


@piece(fastmath=_FAST, inline="always")
def _arctan(x: float) -> float:
    """Arc tangent for |x| <= 1."""
    y = x * x
    value: float = x * (_A0 + y * (_A1 + y * (_A2 + y * (_A3 + y * (_A4 + y * (_A5 + y * _A6))))))
    return value


@kernel(
    read(numba.float64, 4),
    read(numba.int64, 1),
    read(numba.float64, 3),
    numba.float64,
    numba.float64[:, :, :, ::1],
    numba.boolean[::1],
    fastmath=_FAST,
)
def _displacements(warps: Float, slots: Ints, q: Float, per_px: float, s: Float, differs: Mask) -> None:
    """Fill s (pictures, 2, rows, cols), camera px, of node rows where a picture differs; `differs` (rows,).

    Solves q_i(x + s) = q(x) to second order in s: slopes and curvatures of q_i by central differences.
    """
    rows, cols = q.shape[0], q.shape[1]
    half, quarter = 0.5 * per_px, 0.25 * per_px * per_px
    for j in range(rows):
        other = False
        for p in range(slots.size):
            w, to_u, to_v = warps[slots[p], j], s[p, 0, j], s[p, 1, j]
            for i in range(cols):
                dx, dy = q[j, i, 0] - w[i, 0], q[j, i, 1] - w[i, 1]
                to_u[i], to_v[i] = dx, dy
                other |= abs(dx) > SAME_LCD_PX or abs(dy) > SAME_LCD_PX
        differs[j] = other
        if not other:
            continue
        j1 = min(max(j, 1), rows - 2)
        for p in range(slots.size):
            w, to_u, to_v = warps[slots[p]], s[p, 0, j], s[p, 1, j]
            a, m, b = w[j1 - 1], w[j1], w[j1 + 1]
            for i in range(1, cols - 1):
                dx, dy = to_u[i], to_v[i]
                xu, yu = half * (m[i + 1, 0] - m[i - 1, 0]), half * (m[i + 1, 1] - m[i - 1, 1])
                xv, yv = half * (b[i, 0] - a[i, 0]), half * (b[i, 1] - a[i, 1])
                area = xu * yv - xv * yu
                inverse = 1.0 / (area if abs(area) > 1e-9 else 1e-9)
                su, sv = (yv * dx - xv * dy) * inverse, (xu * dy - yu * dx) * inverse
                # half the second-order term, 0.5 s H s
                uu, vv, uv = 2 * quarter * su * su, 2 * quarter * sv * sv, quarter * su * sv
                bx = uu * (m[i + 1, 0] - 2 * m[i, 0] + m[i - 1, 0]) + vv * (b[i, 0] - 2 * m[i, 0] + a[i, 0])
                by = uu * (m[i + 1, 1] - 2 * m[i, 1] + m[i - 1, 1]) + vv * (b[i, 1] - 2 * m[i, 1] + a[i, 1])
                bx += uv * (b[i + 1, 0] - b[i - 1, 0] - a[i + 1, 0] + a[i - 1, 0])
                by += uv * (b[i + 1, 1] - b[i - 1, 1] - a[i + 1, 1] + a[i - 1, 1])
                to_u[i] = su - (yv * bx - xv * by) * inverse
                to_v[i] = sv - (xu * by - yu * bx) * inverse
            to_u[0], to_v[0] = to_u[1], to_v[1]
            to_u[cols - 1], to_v[cols - 1] = to_u[cols - 2], to_v[cols - 2]


@kernel(
    read(numba.float64, 4),
    read(numba.boolean, 1),
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    numba.float64,
    numba.boolean,
    numba.float64[:, ::1],
    numba.float64[:, :, ::1],
    numba.float64[:, ::1],
    fastmath=_FAST,
)
def _sum_phasors(
    s: Float,
    differs: Mask,
    weights: Float,
    place: Float,
    turns: Float,
    wavenumber: float,
    diagonal: bool,
    work: Float,
    angle: Float,
    left: Float,
) -> None:
    """Argument of sum w exp(i phase), (2, rows, cols), and a lower bound of its length, in rows that differ.

    The angle is relative to the heaviest picture's, which is continuous from node to node wherever that
    outweighs the others. Beyond half a turn from it the length is that at half a turn: a picture a whole
    turn away agrees in phase again, but the turn is then ambiguous. work: (pictures + 6, cols).
    """
    count, cols = weights.shape[1], place.shape[1]
    turn, last = 2 * math.pi, weights.shape[0] - 1
    share, heaviest = work[:count], work[count]
    re, im, least, side, middle = (
        work[count + 1],
        work[count + 2],
        work[count + 3],
        work[count + 4],
        work[count + 5],
    )
    for j in range(place.shape[0]):
        if not differs[j]:
            continue
        for i in range(cols):
            n = min(int(place[j, i]), last - 1)
            t = place[j, i] - n
            best = 0
            for p in range(count):
                share[p, i] = (1.0 - t) * weights[n, p] + t * weights[n + 1, p]
                if share[p, i] > share[best, i]:
                    best = p
            heaviest[i] = best
        for c in range(2):
            # displacements along the carrier: of a checker u + v and u - v
            by_u = 1.0 if diagonal or c == 0 else 0.0
            by_v = (1.0 if c == 0 else -1.0) if diagonal else float(c)
            by_u, by_v = wavenumber * by_u, wavenumber * by_v
            bias, kept = angle[c, j], left[j]
            for i in range(cols):
                re[i] = im[i] = least[i] = side[i] = 0.0
                p = int(heaviest[i])
                middle[i] = by_u * s[p, 0, j, i] + by_v * s[p, 1, j, i] + turns[p, c]
            for p in range(count):
                to_u, to_v, weight, begin = s[p, 0, j], s[p, 1, j], share[p], turns[p, c]
                for i in range(cols):
                    x = by_u * to_u[i] + by_v * to_v[i] + begin - middle[i]
                    y = 0.5 * (x - turn * np.rint(x / turn))
                    # cos 2y = 1 - 2 sin^2 y and sin 2y = 2 sin y cos y, cos y = sin(pi/2 - |y|)
                    sine, cosine = _sine(y), _sine(0.5 * math.pi - abs(y))
                    w = weight[i]
                    real, imaginary = w * (1.0 - 2.0 * sine * sine), w * 2.0 * sine * cosine
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
                shorter = math.sqrt(least[i] * least[i] + side[i] * side[i])
                kept[i] = min(kept[i], shorter if re[i] > 0.0 else 0.0)


def _too_far_apart(s: Float, weights: Float, place: Float, most_px: float) -> Mask:
    """(rows, cols) where a picture that counts is further than that from the heaviest one."""
    share = at_rows(weights, place)
    best = share.argmax(axis=-1)[..., None, None]
    apart = np.moveaxis(s, (0, 1), (2, 3))
    apart = apart - np.take_along_axis(apart, best, axis=2)
    far = np.hypot(apart[..., 0], apart[..., 1]) > most_px
    return np.asarray(((share > SPREAD_WEIGHT) & far).any(axis=-1))


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
    shape, count = q.shape[:2], slots.size
    s, differs = np.empty((count, 2, *shape)), np.empty(shape[0], np.bool_)
    _displacements(warps, slots, q, 1 / spacing_px, s, differs)
    if not differs.any():
        return Mixture(np.zeros(shape, np.bool_), None if kind == "noise" else np.zeros_like(q))
    if kind == "noise":
        far = _too_far_apart(s, weights, place, SPREAD_ABOVE_PERIODS * period_px)
        return Mixture(far & differs[:, None], None)
    wavenumber = 2 * math.pi / period_px
    turns, target = moving or (np.zeros((count, 2)), None)
    angle, left, work = np.zeros((2, *shape)), np.ones(shape), np.empty((count + 6, shape[1]))
    carriers = turns, wavenumber, kind == "checker"
    _sum_phasors(s, differs, weights, place, *carriers, work, angle, left)
    if target is not None:
        angle -= np.moveaxis(at_rows(target, place), -1, 0)
        angle -= 2 * math.pi * np.rint(angle / (2 * math.pi))
        angle[:, ~differs] = 0.0
    a, b = angle / wavenumber
    largest = LARGEST_BIAS_PERIODS * period_px
    mixed = (left < LEAST_COHERENCE) | (np.maximum(np.abs(a), np.abs(b)) > largest)
    bias = (0.5 * (a + b), 0.5 * (a - b)) if kind == "checker" else (a, b)
    return Mixture(mixed, np.stack(bias, axis=-1))
