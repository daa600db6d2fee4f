"""Rays in a plane by vectors and root finding: nothing of the paper's equations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class Press:
    """Depth height exp(-((l - at) / width)^2) and its slope."""

    height: float
    at: float
    width: float

    def depth(self, l):  # noqa: E741
        return self.height * np.exp(-(((l - self.at) / self.width) ** 2))

    def slope(self, l):  # noqa: E741
        return -2 * (l - self.at) / self.width**2 * self.depth(l)


Depth = Callable[[float], float]


def traced(
    w: float, depth: Depth, slope: Depth, *, alpha0: float, beta0: float, length: float
) -> tuple[float, float, float]:
    """(l, m, alpha) of the camera ray that enters the camera face at w from R0, normal to it at beta0."""
    entry = np.array([length - w * np.cos(beta0), -w * np.sin(beta0)])
    travel = np.array([-np.sin(beta0), np.cos(beta0)])

    def above(t: float) -> float:
        x, z = entry + t * travel
        return float(z + depth(x))

    point = entry + brentq(above, 0.0, 2 * length, xtol=1e-13, rtol=1e-15) * travel
    tangent = np.array([1.0, -slope(point[0])])
    tangent /= np.linalg.norm(tangent)
    # a mirror keeps the part along its tangent and turns the part across it
    along = (travel @ tangent) * tangent
    out = 2 * along - travel
    # the pattern face: P0 + m (cos alpha0, -sin alpha0)
    m, _ = np.linalg.solve(np.column_stack([[np.cos(alpha0), -np.sin(alpha0)], -out]), point)
    return float(point[0]), float(m), float(np.arctan2(-out[0], -out[1]))
