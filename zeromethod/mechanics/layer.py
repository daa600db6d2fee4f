"""What a rigid base under a layer of rubber adds to a half-space's answer to a load.

A wave of pressure cos(k x) makes four fields in the layer, two that decay inwards and two that decay
outwards; what holds its two sides mixes them. A load is a sum of such waves (Hankel transform). Source of the
fields: Papkovich & Neuber; Barber 2010, Elasticity, 21, doi:10.1007/978-90-481-3809-8.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import j1

from zeromethod.arrays import Float

_WAVES = 30.0
"""Wave number x thickness beyond which a layer yields as a half-space does: exp(-60) is left."""
_PANELS, _POINTS = 120, 12
"""Panels of the integral over waves, and Gauss points in each."""
_FAR = 12.0
"""Distance over thickness up to which slopes are kept; beyond, the base takes all of a half-space's."""
_TABLE = 1200
"""Distances, up to that, at which slopes are tabulated."""


def wave_share(waves: Float, poisson: float, *, bonded: bool) -> Float:
    """Depth of a layer over that of a half-space under waves of pressure, (n,).

    waves: (n,) wave number x thickness, > 0. bonded: the base holds the layer fast; else it lets it slide.
    """
    at = np.asarray(waves, dtype=np.float64)
    top, base = _fields(np.zeros_like(at), at, poisson), _fields(at, at, poisson)
    along, into, normal, shear = range(4)
    matrix = np.stack([top[normal], top[shear], base[along if bonded else shear], base[into]])
    pressed = np.zeros((len(at), 4, 1))
    pressed[:, 0] = -1.0
    mixed = np.linalg.solve(np.moveaxis(matrix, -1, 0), pressed)[..., 0]
    return np.asarray(np.einsum("fn,nf->n", top[into], mixed) / (2 * (1 - poisson)))


def _fields(z: Float, thickness: Float, poisson: float) -> Float:
    """(along, into, normal stress, shear; field; n) at depth z, lengths in 1 / k, in units of 2 G = 1."""
    one, kappa, open_ = np.ones_like(z), 3 - 4 * poisson, 1 - 2 * poisson
    inwards, outwards = np.exp(-z), np.exp(z - thickness)
    fields = [
        (one, one, -one, -one),
        (z, kappa + z, -2 + 2 * poisson - z, -open_ - z),
        (one, -one, -one, one),
        (z, kappa - z, 2 - 2 * poisson - z, z - open_),
    ]
    decay = (inwards, inwards, outwards, outwards)
    return np.stack([np.stack(field) * by for field, by in zip(fields, decay, strict=True)], axis=1)


@lru_cache(8)
def reach_and_waves(thickness_mm: float, poisson: float, bonded: bool) -> tuple[Float, Float, Float]:
    """(distances mm, wave numbers 1/mm, share less 1 times weight of each wave, 1/mm) of a Hankel integral.

    What a layer lacks to a half-space ends at `_WAVES` over its thickness; nothing is left beyond the last
    distance.
    """
    at, weight = np.polynomial.legendre.leggauss(_POINTS)
    panel = _WAVES / _PANELS
    waves = (panel * (np.arange(_PANELS)[:, None] + 0.5 * (at + 1))).ravel()
    lacks = (wave_share(waves, poisson, bonded=bonded) - 1) * np.tile(0.5 * panel * weight, _PANELS)
    reach = thickness_mm * np.linspace(0.0, _FAR, _TABLE)
    return reach, waves / thickness_mm, lacks / thickness_mm


@lru_cache(8)
def layer_slopes(thickness_mm: float, poisson: float, *, bonded: bool) -> tuple[Float, Float]:
    """(distance mm, slope outwards 1/mm^2) that the base adds per q; a half-space's dent is q / distance."""
    reach, waves, lacks = reach_and_waves(thickness_mm, poisson, bonded)
    return reach, -(j1(np.outer(reach, waves)) @ (lacks * waves))
