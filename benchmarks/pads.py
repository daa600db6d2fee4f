"""What benchmarks press: loads, named by the sigma of the Gaussian dent that is as curved in its middle.

No rubber takes a Gaussian's shape: a load's dent falls like 1/r far away.
"""

from __future__ import annotations

from math import sqrt

from zeromethod.rig.tables import Rubber
from zeromethod.simulation.loads import HALF_SPACE, load, rod
from zeromethod.simulation.press import Dent

STEEPEST, HOLLOW = 0.503, 0.358
"""Of a load: steepest slope over depth / sigma, x (I0 - I1) exp(-x^2 / 2) of x^2 / 2 at its largest, and the
curvature of the hollow around, which folds, over depth / sigma^2: the most by which that falls with x."""


def pad(x_mm: float, y_mm: float, depth_mm: float, sigma_mm: float, rubber: Rubber = HALF_SPACE) -> Dent:
    """One load."""
    return load(x_mm, y_mm, depth_mm, sigma_mm / sqrt(2), rubber)


def bar(
    x_mm: float, y_mm: float, depth_mm: float, sigma_mm: float, length_mm: float, angle_deg: float = 0.0
) -> Dent:
    """A rod: the same load smeared along a line."""
    return rod(x_mm, y_mm, depth_mm, length_mm, sigma_mm / sqrt(2), angle_deg)
