"""Polynomials over a window of nodes, and where they are stationary."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import perm

import numpy as np

from zeromethod.arrays import Float

_STEPS = 8


def powers_of(degree: int) -> list[tuple[int, int]]:
    """Powers of both variables of all terms up to a degree."""
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]


@cache
def whole_window(reach: int, degree: int) -> Float:
    """Matrix (terms, nodes) from the values of all nodes of a window to the coefficients of `_fit`."""
    b, a = (one.ravel().astype(np.float64) for one in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    return np.asarray(np.linalg.pinv(terms(a, b, powers_of(degree))), dtype=np.float64)


def polynomial(
    coefficients: list[float], powers: list[tuple[int, int]], at: Float, da: int, db: int
) -> float:
    """Sum of c a^i b^j at (a, b), differentiated da times by a and db times by b."""
    a, b = at.tolist()
    total = 0.0
    for c, (i, j) in zip(coefficients, powers, strict=True):
        if i >= da and j >= db:
            total += c * perm(i, da) * perm(j, db) * a ** (i - da) * b ** (j - db)
    return total


def terms(a: Float, b: Float, powers: list[tuple[int, int]]) -> Float:
    """Columns a^i b^j."""
    return np.stack([a**i * b**j for i, j in powers], axis=-1)


def stationary(
    derivative: Callable[[Float, int, int], float], start: Float, within: float, settled: float
) -> Float | None:
    """Point (a, b) of zero gradient by Newton's steps, no farther than `within` on either axis.

    derivative: of the function at a point, so often by a and so often by b. settled: a step that ends it.
    """
    at = np.array(start, dtype=np.float64)
    for _ in range(_STEPS):
        d10, d01, d20, d11, d02 = (
            derivative(at, *order) for order in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        )
        determinant = d20 * d02 - d11 * d11
        if determinant <= 0.0:
            return None
        step = np.array([d02 * d10 - d11 * d01, d20 * d01 - d11 * d10]) / determinant
        at = at - step
        if np.max(np.abs(at)) > within:
            return None
        if np.max(np.abs(step)) < settled:
            break
    return at
