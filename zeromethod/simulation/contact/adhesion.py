"""Radius in which a ball sticks to the rubber, by energy: JKR, for a half-space and for a layer.

The pressure's transform is taken as that of a function phi on (0, a), which turns the contact into an
integral equation in one dimension; what the base of a layer changes is its smooth kernel.
Sources: Johnson, Kendall & Roberts 1971, doi:10.1098/rspa.1971.0141; Lebedev & Ufliand 1958, Axisymmetric
contact problem for an elastic layer, J. Appl. Math. Mech. 22, 442.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.compliance import Compliance, layer_factor

_POINTS = 40
_WAVES = 40.0
_WAVE_POINTS = 400


@dataclass(frozen=True, slots=True)
class Round:
    """Contact of a ball within a radius: force N, depth mm, strength of the pressure's edge phi(a)."""

    force_n: float
    depth_mm: float
    edge: float


class BallContact:
    """A ball on rubber, for any radius of contact.

    added_mm_per_n: displacement besides that of a half-space or layer, the same all over the contact.
    """

    def __init__(self, rubber: Rubber, radius_mm: float, added_mm_per_n: float = 0.0) -> None:
        self._added_mm_per_n = added_mm_per_n
        self._rubber = rubber
        self._modulus = Compliance(rubber).modulus_mpa
        self._radius_mm = radius_mm

    def within(self, contact_mm: float, adhesion_n_mm: float = 0.0) -> Round:
        """Contact of radius `contact_mm` that balances a work of adhesion (N/mm, 0: none)."""
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        x = np.append(0.5 * contact_mm * (nodes + 1), contact_mm)
        weight = np.append(0.5 * contact_mm * weights, 0.0)
        matrix = np.eye(_POINTS + 1) + self._kernel(x[:, None], x[None, :]) * weight
        scale = self._modulus / np.pi
        right = np.stack((np.full_like(x, scale), -scale * x**2 / self._radius_mm), axis=-1)
        flat, ball = np.linalg.solve(matrix, right).T
        edge = -np.sqrt(2 * contact_mm * self._modulus * adhesion_n_mm / np.pi)
        depth = float((edge - ball[-1]) / flat[-1])
        force = float(2 * np.pi * (weight * (depth * flat + ball)).sum())
        return Round(force, depth + self._added_mm_per_n * force, float(edge))

    def _kernel(self, x: Float, t: Float) -> Float:
        if self._rubber.thickness_mm is None:
            return np.zeros(np.broadcast_shapes(x.shape, t.shape))
        thickness = self._rubber.thickness_mm or np.inf
        nodes, weights = np.polynomial.legendre.leggauss(_WAVE_POINTS)
        waves = 0.5 * _WAVES * (nodes + 1)
        lacks = layer_factor(waves, self._rubber.poisson, bonded=self._rubber.support == "bonded") - 1
        weights = 0.5 * _WAVES * weights * lacks
        by_x = np.cos(waves * x[..., None] / thickness)
        by_t = np.cos(waves * t[..., None] / thickness)
        return np.asarray(
            2 / (np.pi * thickness) * np.einsum("ijk,ijk,k->ij", *np.broadcast_arrays(by_x, by_t), weights)
        )

    def radius_for(self, adhesion_n_mm: float, *, depth_mm: float | None, force_n: float | None) -> float:
        """Contact radius, mm, of a ball held at a depth > 0 or by a force; below 0, it pulls.

        Raises InputError for a pull that parts them.
        """

        def miss(contact_mm: float) -> float:
            found = self.within(contact_mm, adhesion_n_mm)
            return found.depth_mm - depth_mm if depth_mm is not None else found.force_n - (force_n or 0.0)

        low, high = 1e-4 * self._radius_mm, 1e-2 * self._radius_mm
        if force_n is not None and force_n < 0:
            # narrower than this a contact under a constant pull parts, on a half-space
            low = (9 * np.pi * adhesion_n_mm * self._radius_mm**2 / (8 * self._modulus)) ** (1 / 3)
            high = 1.1 * low
            if miss(low) > 0:
                raise InputError(f"object: force_n: {force_n:g}: it parts ball and rubber: a weaker pull")
        while miss(high) < 0:
            low, high = high, 2 * high
        return float(scipy.optimize.brentq(miss, low, high, xtol=1e-9))
