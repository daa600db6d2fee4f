"""The paper's equations 5, 8 to 10, 12 to 14, 17 and 19, one function each.

Convention: one length unit throughout, angles in rad, everything in the plane of incidence. l runs along the
mirror from P0, l' = L0 - l from R0; depth d is positive into the rubber and tan(theta) = dd/dl. alpha and
beta lie between a ray and the normal of the *undeformed* mirror: alpha towards the pattern, beta towards the
camera. m = |P0 P1| on the pattern face, w = |R0 R1| on the camera face. All arguments broadcast.

The paper counts theta twice. In equation 4 it is the slope of d; in equation 6 it is the mirror normal's
lean towards the camera. Where d points into the rubber, as gamma's sign in equations 11 and 14 needs it,
the two are opposite: lean = -theta. With gamma dropped the equations do not know the sign of d.

Source: S. Saga, "High-resolution tactile sensor using the deformation of a reflection image".
"""

# ruff: noqa: E741 (the paper's l)

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float


def _floats(*values: ArrayLike) -> list[Any]:
    return [np.asarray(value, dtype=np.float64) for value in values]


def depth_step(delta_l: ArrayLike, theta: ArrayLike, delta_theta: ArrayLike) -> Float:
    """Equation 5: rise of d over delta_l while the slope angle turns evenly from theta by delta_theta.

    L / Theta log|cos(theta) / cos(theta + Theta)|; delta_l < 0 goes back towards P0. Exact where theta is
    linear in l; else the error is that of the trapezoid, third order in delta_l. Written with log1p, so that
    delta_theta -> 0 gives L tan(theta) without loss of digits.
    """
    length, start, turn = _floats(delta_l, theta, delta_theta)
    straight = np.abs(turn) < 1e-9
    safe = np.where(straight, 1.0, turn)
    # cos(theta + Theta) / cos(theta) - 1; below -1 past the vertical, which the printed bars | | allow
    change = -2.0 * np.sin(safe / 2) ** 2 - np.tan(start) * np.sin(safe)
    ratio = -np.where(change > -0.5, np.log1p(np.maximum(change, -0.5)), np.log(np.abs(1.0 + change)))
    return np.asarray(length * np.where(straight, np.tan(start + turn / 2), ratio / safe))


def reflected_angle(beta: ArrayLike, lean: ArrayLike) -> Float:
    """Equations 8 and 9: alpha = beta - 2 lean. Exact.

    lean: angle of the mirror's normal towards the camera, the paper's theta; -theta for d into the rubber.
    """
    towards_camera, turned = _floats(beta, lean)
    return np.asarray(towards_camera - 2.0 * turned)


def lean_between(alpha: ArrayLike, beta: ArrayLike) -> Float:
    """Equation 9 solved for the normal's lean towards the camera: (beta - alpha) / 2."""
    towards_pattern, towards_camera = _floats(alpha, beta)
    return np.asarray((towards_camera - towards_pattern) / 2.0)


def elevation(d: ArrayLike, l: ArrayLike) -> Float:
    """Equations 10 and 13: gamma = arctan(d / l), by which Q leaves the mirror as seen from P0.

    With l' for l: as seen from R0. Exact.
    """
    depth, along = _floats(d, l)
    return np.asarray(np.arctan2(depth, along))


def pattern_distance(
    l: ArrayLike, d: ArrayLike, alpha: ArrayLike, alpha0: float, gamma: ArrayLike | None = None
) -> Float:
    """Equation 12: m = sqrt(l^2 + d^2) cos(alpha - gamma) / cos(alpha - alpha0), from P0.

    gamma: None for equation 10, where it is exact; 0 for the paper's own approximation, whose error
    d tan(alpha) / l relative to m is of first order in the depth.
    """
    along, depth, angle = _floats(l, d, alpha)
    raised = elevation(depth, along) if gamma is None else np.asarray(gamma, dtype=np.float64)
    return np.asarray(np.hypot(along, depth) * np.cos(angle - raised) / np.cos(angle - alpha0))


def captured_distance(
    l_prime: ArrayLike, d: ArrayLike, beta: ArrayLike, beta0: float, gamma: ArrayLike | None = None
) -> Float:
    """Equation 14: w = sqrt(l'^2 + d^2) cos(beta - gamma') / cos(beta - beta0), from R0.

    gamma: None for equation 13, where it is exact; 0 where gamma' is dropped as gamma is.
    """
    return pattern_distance(l_prime, d, beta, beta0, gamma)


def mirror_distance(w: ArrayLike, d: ArrayLike, beta0: float, *, keep_gamma: bool = True) -> Float:
    """Equation 14 solved for l' with the camera at infinity (beta = beta0).

    Exact with gamma' kept: l' = (w - d sin(beta0)) / cos(beta0). Dropped: l'^2 = (w / cos(beta0))^2 - d^2.
    """
    captured, depth = _floats(w, d)
    if keep_gamma:
        return np.asarray((captured - depth * np.sin(beta0)) / np.cos(beta0))
    return np.asarray(np.sqrt(np.maximum((captured / np.cos(beta0)) ** 2 - depth**2, 0.0)))


def expanded_angle_change(m: ArrayLike, l: ArrayLike, d: ArrayLike, alpha0: float) -> Float:
    """Equation 17: delta alpha from m, l and d, to second order in delta alpha, with gamma = 0.

    With r^2 = l^2 + d^2, c = cos(alpha0), s = sin(alpha0) the second-order Taylor series of equation 16,
    m^2 cos^2(x) - r^2 cos^2(alpha0 + x) = 0, is A x^2 + 2 B x + C = 0 with

        A = -m^2 + r^2 (c^2 - s^2),   B = r^2 c s,   C = m^2 - r^2 c^2.

    Equation 17 is x = (-B +- sqrt(B^2 - C A)) / A: *one* root over the whole difference (the print splits it
    in two), and A divides all of it. The plus sign is meant: it gives x = 0 at rest, where C = 0; the other
    root is of order 1. It is computed as -C / (B + sqrt(B^2 - C A)), the same number without cancellation.

    Holds where x is small, with an error of third order, (2/3) x^3 at alpha0 = 45 deg, and where d / l is
    small against x: gamma = 0 makes delta alpha too small by about d / l. On a flank that starts straight
    from P0 that is half of delta alpha itself.
    The root is real for every m.
    """
    pattern, along, depth = _floats(m, l, d)
    c, s = np.cos(alpha0), np.sin(alpha0)
    r2 = along**2 + depth**2
    a = -(pattern**2) + r2 * (c * c - s * s)
    b = r2 * c * s
    rest = pattern**2 - r2 * c * c
    return np.asarray(-rest / (b + np.sqrt(b * b - rest * a)))


def pattern_angle(m: ArrayLike, l: ArrayLike, d: ArrayLike, alpha0: float) -> Float:
    """Equation 12 solved for alpha, gamma kept. Exact.

    tan(alpha) = (l - m cos(alpha0)) / (m sin(alpha0) - d):
    with sqrt(l^2 + d^2) (cos(gamma), sin(gamma)) = (l, d) equation 12 is linear in cos(alpha), sin(alpha).
    """
    pattern, along, depth = _floats(m, l, d)
    return np.asarray(np.arctan2(along - pattern * np.cos(alpha0), pattern * np.sin(alpha0) - depth))


def next_depth_step(delta_l: ArrayLike, theta: ArrayLike, delta_theta: ArrayLike) -> Float:
    """Equation 19: delta d of the *next* interval, n + 1, from l, theta and delta theta of interval n.

    Equation 5 moved on by one interval, which equation 18 (neighbouring delta d are nearly equal) allows.
    The error per interval is delta l^2 times the slope's change per length, first order in delta l in the
    sum: where the slope jumps, d overshoots by one interval's step.
    """
    return depth_step(delta_l, theta, delta_theta)
