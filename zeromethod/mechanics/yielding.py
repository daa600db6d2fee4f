"""How a rig's rubber answers to loads on its mirror, as far as the rig file knows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float
from zeromethod.mechanics.body import BodyKernel, body_of
from zeromethod.mechanics.layer import layer_slopes
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.model import Rig, Rubber

NO_MODULUS = "the rig file has no rubber.youngs_modulus_mpa"
"""Why no force is read."""


@dataclass(frozen=True)
class Layer:
    """Rubber on a rigid base."""

    thickness_mm: float
    poisson: float
    bonded: bool

    def slope_outwards(self, distance_mm: Float) -> Float:
        """1/mm^2 that the base adds per q, where a half-space's dent is q / distance."""
        at, added = layer_slopes(self.thickness_mm, self.poisson, bonded=self.bonded)
        return np.where(
            distance_mm < at[-1], np.interp(distance_mm, at, added), 1 / np.maximum(distance_mm, 1e-9) ** 2
        )

    def slopes(self, at_mm: Float, middle_mm: Float) -> Float:
        """(n, 2) that the base adds per q at points (n, 2) under a load at (2,)."""
        away = at_mm - middle_mm
        distance = np.maximum(np.hypot(*away.T), 1e-9)
        return np.asarray(away * (self.slope_outwards(distance) / distance)[:, None])


def relative_sigma(rubber: Rubber) -> float:
    """Of E / (1 - nu^2), and so of forces: what is open of modulus and Poisson's ratio; NaN: no modulus."""
    nu = rubber.poisson
    return math.hypot(
        rubber.youngs_modulus_sigma_mpa / (rubber.youngs_modulus_mpa or math.nan),
        2 * nu * rubber.poisson_sigma / (1 - nu**2),
    )


@dataclass(frozen=True)
class Yielding:
    """How stiff the rubber is, with its standard deviation, and what its body adds to a half-space.

    modulus_mpa: E / (1 - nu^2), NaN where the rig file has none; a force F makes a dent q / distance in a
    half-space, q = F / (pi modulus).
    relative_sigma: of forces, by what is open of modulus and Poisson's ratio. Of layer and body one at most.
    other: a layer that is one standard deviation away from what is known.
    """

    modulus_mpa: float
    relative_sigma: float
    layer: Layer | None = None
    body: BodyKernel | None = None
    other: Layer | None = None

    @classmethod
    def of(cls, rig: Rig) -> Yielding:
        """That of a rig."""
        rubber = rig.rubber
        nu, relative = rubber.poisson, relative_sigma(rubber)
        modulus = (rubber.youngs_modulus_mpa or math.nan) / (1 - nu**2)
        if rubber.support is None:
            # not known: a half-space, off by as much as a layer that is bonded as deep as this prism is
            deep = PrismGeometry(rig.prism)
            return cls(modulus, relative, other=Layer(deep.thickness_mm, nu, True))
        if rubber.thickness_mm is None:
            return cls(modulus, relative, body=body_of(rig))
        layer = Layer(rubber.thickness_mm, nu, rubber.support == "bonded")
        sigma_mm = rubber.thickness_sigma_mm
        other = replace(layer, thickness_mm=rubber.thickness_mm + sigma_mm) if sigma_mm else None
        return cls(modulus, relative, layer, other=other)

    def added_slopes(self, at_mm: Float, middle_mm: Float) -> Float | None:
        """Slope (n, 2) at points (n, 2) that the body adds per q under a load at (2,); None: a half-space."""
        if self.body is not None:
            return self.body.slopes(at_mm, middle_mm)
        return None if self.layer is None else self.layer.slopes(at_mm, middle_mm)

    def open_slopes(self, at_mm: Float, middle_mm: Float) -> Float | None:
        """The standard deviation of that, the same way everywhere; None where nothing is open."""
        if self.other is None:
            return None
        known = self.added_slopes(at_mm, middle_mm)
        return self.other.slopes(at_mm, middle_mm) - (0.0 if known is None else known)
