"""A point force inside endless rubber: displacement and traction, in closed form.

Lengths in mm, forces in N, moduli and stresses in MPa. Source: Kelvin 1848; Love 1927, A Treatise on the
Mathematical Theory of Elasticity, 130.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float


def displacement(apart: Float, shear_mpa: float, poisson: float) -> Float:
    """(3, 3, ...) mm along i by a unit force along j, at places `apart` (3, ...) from it."""
    r = np.sqrt((apart**2).sum(axis=0))
    towards = apart / r
    out = towards[:, None] * towards[None, :]
    for i in range(3):
        out[i, i] += 3 - 4 * poisson
    return np.asarray(out / (16 * np.pi * shear_mpa * (1 - poisson) * r))


def traction(apart: Float, normal: Float, poisson: float) -> Float:
    """(3, 3, ...) MPa along i by a unit force along j, on a plane of this outward `normal` (3, ...)."""
    r2 = (apart**2).sum(axis=0)
    towards = apart / np.sqrt(r2)
    across = (towards * normal).sum(axis=0)
    out = 3 * across * towards[:, None] * towards[None, :]
    plain = (1 - 2 * poisson) * (towards[:, None] * normal[None, :] - normal[:, None] * towards[None, :])
    # of sigma_ij n_j: f_i (r.n) + r_i (f.n) - n_i (f.r)
    out = out + plain
    for i in range(3):
        out[i, i] += (1 - 2 * poisson) * across
    return np.asarray(-out / (8 * np.pi * (1 - poisson) * r2))
