"""Laws by which a dent's depth falls with the way from its middle, and the numbers of a dent; compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float

NUMBERS, LAW = 7, 6
"""Of one dent: depth, mm; place x, y, mm; a, b, c, 1/mm, of z = (a X + b Y)^2 + (c Y)^2, X, Y from there; and
its law."""

LAYER, POINT, BALL = -1.0, 1.0, 3.0
"""Law of depth exp(1 - sqrt(1 + z)); those from 0 to 1 are depth (1 + law z)^(-1 / (2 law)), the last one a
load's, and those above add law - 1 of what the body adds to a load, where it is known (`Body`). From 3 on it
is the depth under and around a ball, which adds law - 3 of it."""

FAR_OF_BALL = 4.0 / (3.0 * np.pi)
"""Depth far away over that of depth (1 + z)^(-1 / 2), of a ball."""

_EDGE = 0.1
"""Least root of z - 1 by which the bend at a ball's edge, which has no end, is taken."""

GAUSSIAN = 1e-4
"""Law below which it is its limit exp(-z / 2)."""


@numba.njit(cache=True, error_model="numpy")
def dents_end(numbers: Float) -> int:
    """Count of the dents' numbers; two more may follow, a tilt of all slopes, rad."""
    return len(numbers) // NUMBERS * NUMBERS


@numba.njit(cache=True, error_model="numpy")
def ends_of_law(law: float, most_law: float) -> tuple[float, float]:
    """Laws between which one may be fitted."""
    return (BALL, BALL + most_law - POINT) if law >= BALL else (0.0, most_law)


@numba.njit(cache=True, error_model="numpy")
def _half2(law: float) -> float:
    """Squared way z at which a dent of a law is half as deep as in its middle."""
    if law >= BALL:
        return 1.0
    if law < 0.0:
        return float((1.0 + np.log(2.0)) ** 2 - 1.0)
    k = min(law, POINT)
    return float((4.0**k - 1.0) / k if k > GAUSSIAN else np.log(4.0))


@numba.njit(cache=True, error_model="numpy")
def with_law(numbers: Float, law: float) -> Float:
    """The same dents with another law, as wide where they are half as deep."""
    out = numbers.copy()
    for k in range(0, dents_end(out), NUMBERS):
        out[k + 3 : k + LAW] *= np.sqrt(_half2(law) / _half2(out[k + LAW]))
        out[k + LAW] = law
    return out


@numba.njit(cache=True, error_model="numpy")
def share_of_body(law: float) -> float:
    """Share of what the body adds to a load that a law adds, 0 for those of no load."""
    return law - BALL if law >= BALL else max(law - POINT, 0.0)


@numba.njit(cache=True, error_model="numpy")
def of_ball(z: float) -> tuple[float, float, float]:
    """Depth by a ball's pressure, 1 in its middle, and its derivatives by z, the squared way over its radius.

    K. L. Johnson, Contact Mechanics, section 4.2.
    """
    if z <= 1.0:
        return 1.0 - 0.5 * z, -0.5, 0.0
    angle, root = np.arcsin(1.0 / np.sqrt(z)), np.sqrt(z - 1.0)
    shape, first = ((2.0 - z) * angle + root) / np.pi, (root / z - angle) / np.pi
    return shape, first, 1.0 / (np.pi * z * z * max(root, _EDGE))
