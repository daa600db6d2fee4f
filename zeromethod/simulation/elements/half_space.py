"""A half-space under a force of 1 N on its surface: displacement and stress inside, from cylindrical ones.

Convention: the force acts at the origin along +z, into z > 0; mm, MPa, tension positive. Source: Johnson
1985, Contact Mechanics, eqs. 3.18 and 3.19, doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float


def displacement(x: Float, y: Float, z: Float, shear_mpa: float, poisson: float) -> Float:
    """(3, ...) mm along x, y, z."""
    away = np.sqrt(x**2 + y**2 + z**2)
    # (rho - z) / (rho r^2), which stays finite below the force
    open_ = (1 - 2 * poisson) / (away * (away + z))
    out_over_r = z / away**3 - open_
    into = (z / away) ** 2 / away + 2 * (1 - poisson) / away
    return np.asarray(np.stack((x * out_over_r, y * out_over_r, into)) / (4 * np.pi * shear_mpa))


def stress(x: Float, y: Float, z: Float, poisson: float) -> Float:
    """(3, 3, ...) MPa."""
    r, away = np.hypot(x, y), np.sqrt(x**2 + y**2 + z**2)
    cos = np.divide(x, r, out=np.ones_like(r), where=r > 0)
    sin = np.divide(y, r, out=np.zeros_like(r), where=r > 0)
    shared = (1 - 2 * poisson) / (away * (away + z))
    radial = shared - 3 * z * r**2 / away**5
    hoop = (1 - 2 * poisson) * z / away**3 - shared
    shear = -3 * r * z**2 / away**5
    out = np.empty((3, 3, *r.shape))
    out[0, 0] = radial * cos**2 + hoop * sin**2
    out[1, 1] = radial * sin**2 + hoop * cos**2
    out[0, 1] = out[1, 0] = (radial - hoop) * sin * cos
    out[0, 2] = out[2, 0] = shear * cos
    out[1, 2] = out[2, 1] = shear * sin
    out[2, 2] = -3 * z**3 / away**5
    return out / (2 * np.pi)
