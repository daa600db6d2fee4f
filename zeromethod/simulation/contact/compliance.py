"""How rubber yields under pressure: a half-space, a layer on a rigid base, or the rig's prism.

What a prism adds to a half-space (`zeromethod.simulation.elements`) is smooth, and depends on where on the
mirror load and place are.

Convention: displacement > 0 into the rubber; lengths in mm, moduli and pressures in MPa, forces in N.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.special import j0

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.prism_tables import Prism
from zeromethod.rig.tables import FaceSupports, Rubber
from zeromethod.simulation.elements.prism import HeldPrism, PrismKernel, prism_kernel

_WAVES = 30.0
"""Wave number x thickness beyond which a layer yields as a half-space does: exp(-60) is left."""
_PANELS, _NODES = 40, 30
_TABLE = 3000
_SOFT_MPA = 1.0
_SMOOTH = 13
"""Points along each side of a lattice of pressures at which what a prism adds is known."""


def layer_factor(waves: Float, poisson: float, *, bonded: bool) -> Float:
    """Displacement of a layer over that of a half-space, for pressure cos(k x); `waves` = k x thickness > 0.

    bonded: the base holds the layer fast; else it lets it slide. Limits: 1 for short waves; waves x
    (1 - 2 nu) / (2 (1 - nu)^2) (bonded) and waves / 2 (sliding) for long ones, an even compression.
    Source: Johnson 1985, Contact Mechanics, 5.8, doi:10.1017/CBO9781139171731.
    """
    decay = np.exp(-2 * waves)
    sinh, cosh = 0.5 * (1 - decay**2), 0.5 * (1 + decay**2)  # of 2 waves, times exp(-2 waves)
    if not bonded:
        return np.asarray((cosh - decay) / (sinh + 2 * waves * decay))
    kappa = 3 - 4 * poisson
    above = 2 * kappa * sinh - 4 * waves * decay
    below = 2 * kappa * cosh + (1 + kappa**2 + 4 * waves**2) * decay
    return np.asarray(above / below)


@dataclass(frozen=True)
class Compliance:
    """The surface's answer to pressure, of a rig's rubber.

    prism: the rig's, where the rubber's support is given per face.
    """

    rubber: Rubber
    prism: Prism | None = None

    @property
    def body(self) -> PrismKernel | None:
        """What the prism adds to a half-space; None for a half-space and a layer.

        Raises InputError for a support per face without a prism.
        """
        if not isinstance(self.rubber.support, FaceSupports):
            return None
        if self.prism is None:
            raise InputError("rubber.support: per face only with the prism of a rig")
        return prism_kernel(HeldPrism.of(self.prism, self.rubber.support, self.rubber.poisson))

    def of_body(self, places_mm: Float, forces_mm: Float) -> Float:
        """(places, forces) mm per N that the prism adds at places (2, n) by forces at places (2, m)."""
        if self.body is None:
            return np.zeros((places_mm.shape[1], forces_mm.shape[1]))
        return self.body.between(places_mm, forces_mm) / self.youngs_modulus_mpa

    @property
    def youngs_modulus_mpa(self) -> float:
        """The rig file's, or soft silicone's where it has none."""
        return self.rubber.youngs_modulus_mpa or _SOFT_MPA

    @property
    def modulus_mpa(self) -> float:
        """E / (1 - nu^2)."""
        return self.youngs_modulus_mpa / (1 - self.rubber.poisson**2)

    def of_cells(self, x_mm: Float, y_mm: Float, pitch_mm: float) -> Float:
        """Displacement, mm, at distance (x, y) from a square cell of `pitch_mm` under a pressure of 1 MPa.

        Source: Love 1929, doi:10.1098/rsta.1929.0009. What a layer adds is taken at the cell's middle.
        """
        half = pitch_mm / 2

        def corner(x: Float, y: Float) -> Float:
            # lattices of the cell's pitch never have x or y = 0 here
            return np.asarray(x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y)))

        left, right, low, high = x_mm - half, x_mm + half, y_mm - half, y_mm + half
        whole = corner(right, high) - corner(left, high) - corner(right, low) + corner(left, low)
        space = whole / (np.pi * self.modulus_mpa)
        return np.asarray(space + pitch_mm**2 * self.of_layer(np.hypot(x_mm, y_mm)))

    def of_force(self, distance_mm: Float) -> Float:
        """Displacement, mm, at a distance (> 0) from a force of 1 N; but for `of_body`."""
        return np.asarray(1 / (np.pi * self.modulus_mpa * distance_mm) + self.of_layer(distance_mm))

    def of_layer(self, distance_mm: Float) -> Float:
        """What the base adds to a half-space's displacement under a force of 1 N, mm; 0 for a half-space."""
        if self.rubber.thickness_mm is None:
            return np.zeros_like(distance_mm)
        radii, values = _layer_table(self.rubber)
        return np.interp(distance_mm, radii, values)


@lru_cache(8)
def _layer_table(rubber: Rubber) -> tuple[Float, Float]:
    """(distance mm, mm per N) by the Hankel transform of what a layer lacks to a half-space."""
    thickness = rubber.thickness_mm or np.inf
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    panel = _WAVES / _PANELS
    waves = (panel * (np.arange(_PANELS)[:, None] + 0.5 * (nodes + 1))).ravel()
    weights = np.tile(0.5 * panel * weights, _PANELS)
    lacks = layer_factor(waves, rubber.poisson, bonded=rubber.support == "bonded") - 1
    # dense where the layer's own scale is, out to where nothing of either is left
    radii = thickness * np.concatenate((np.linspace(0, 4, _TABLE // 2), np.linspace(4.01, 30, _TABLE // 2)))
    modulus = Compliance(rubber).modulus_mpa
    values = j0(np.outer(radii / thickness, waves)) @ (lacks * weights) / (np.pi * modulus * thickness)
    # far beyond, the base takes all of it
    far = thickness * np.geomspace(30.1, 300, 200)
    return np.concatenate((radii, far)), np.concatenate((values, -1 / (np.pi * modulus * far)))


class LatticeResponse:
    """Displacement of a lattice under pressures on a lattice inside it: a convolution with zero padding.

    Both have one pitch; the outer reaches `margin` points further on every side. What a prism adds is known
    at some points of the lattice of pressures, and a polynomial between.
    """

    def __init__(
        self,
        compliance: Compliance,
        shape: tuple[int, int],
        pitch_mm: float,
        margin: int = 0,
        world: Callable[[Float, Float], tuple[Float, Float]] | None = None,
    ) -> None:
        """shape: (rows, cols) of the pressures.

        world: from places (along, across) about the lattice's middle, mm, to the mirror's, for a lattice
        without margin; without it nothing is added for a prism.
        """
        self._added: Float | None = None
        if world is not None and compliance.body is not None:
            half = [0.5 * pitch_mm * (n - 1) for n in shape]
            points = chebyshev.chebpts1(_SMOOTH)
            at = np.stack([each.ravel() for each in world(*np.meshgrid(half[1] * points, half[0] * points))])
            self._added = pitch_mm**2 * compliance.of_body(at, at)
            inverse = np.linalg.inv(chebyshev.chebvander(points, _SMOOTH - 1))
            rows_by, cols_by = (
                chebyshev.chebvander(np.linspace(-1, 1, n), _SMOOTH - 1) @ inverse for n in shape
            )
            self._by = rows_by, cols_by
        rows, cols = (int(n + 2 * margin) for n in shape)
        self._size = tuple(
            next_fast_len(n + out - 1, real=True) for n, out in zip(shape, (rows, cols), strict=True)
        )
        self._take = slice(shape[0] - 1, shape[0] - 1 + rows), slice(shape[1] - 1, shape[1] - 1 + cols)
        y = pitch_mm * np.arange(1.0 - margin - shape[0], rows - margin)
        x = pitch_mm * np.arange(1.0 - margin - shape[1], cols - margin)
        self._transfer = rfft2(compliance.of_cells(x[None, :], y[:, None], pitch_mm), self._size)

    def displacement(self, pressure_mpa: Float) -> Float:
        """(rows + 2 margin, cols + 2 margin) mm under pressures (rows, cols), MPa."""
        whole = irfft2(rfft2(pressure_mpa, self._size) * self._transfer, self._size)
        if self._added is None:
            return np.asarray(whole[self._take])
        rows, cols = self._by
        gathered = self._added @ (rows.T @ pressure_mpa @ cols).ravel()
        return np.asarray(whole[self._take] + rows @ gathered.reshape(_SMOOTH, _SMOOTH) @ cols.T)
