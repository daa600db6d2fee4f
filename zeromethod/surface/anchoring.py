"""The constant of one reading, chosen while its passes settle.

The shape settles first, with the constant that it started from. Then the constant is found, which moves the
mirror along its rays, and found again from the slopes there until it stays: 0.1 mm changes what is found by
an error of 1 %.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Float
from zeromethod.rig.model import KnownRest
from zeromethod.surface.anchor import RestFit, fit_known, known_nodes
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.kept_constant import KeptConstant
from zeromethod.surface.node_passes import dot, step_of
from zeromethod.surface.pass_result import PassResult

_AGAIN_MM = 1e-4
"""Step of the constant above which it is found again: what is found depends on it by less than 1 in 2000."""
_MOST_FITS = 6
"""How often it is found in one reading, at most."""


class Anchoring:
    """The anchor of one reading: `fit`, None until it is chosen; `fixed` once no pass changes it any more."""

    def __init__(
        self,
        known_rest: Sequence[KnownRest],
        constant: KeptConstant,
        integrator: SlopeIntegrator,
        scale: Float,
        last: bool,
    ) -> None:
        """scale: h (rows, cols). last: False where slopes will be carried across seams by what is read."""
        self._known_rest, self._constant, self._integrator = known_rest, constant, integrator
        self._scale, self._last = scale, last
        self._fits, self._step_mm = 0, 0.0
        self.fit: RestFit | None = None
        self.fixed = False

    def shape(self, read: PassResult, error: Float) -> Float:
        """Step of depth (rows, cols), mm, that removes an error of depth / h and keeps the anchor's mean."""
        weights = self._weights(read, self._known(read)) if self.fit is None else self.fit.weights
        return step_of(self._scale, error, mean(weights, error), read.island)

    def choose(self, read: PassResult) -> float:
        """Find the constant; returns the multiple of h to add to depth, mm."""
        known = self._known(read)
        weights = self._weights(read, known)
        at_mm = mean(weights, read.depth / self._scale)
        self._fits += 1
        if known is not None:
            self.fit, step_mm = known, -at_mm
        else:
            first = self._fits == 1
            found = self._constant.of(read, self._integrator, first, self._last, self._step_mm)
            step_mm = -found.constant_mm
            self.fit = RestFit("loads", weights, found.sigma_mm, at_mm + step_mm, found.false_constant)
        self.fixed = abs(step_mm) < _AGAIN_MM or self._fits == _MOST_FITS
        self._step_mm = step_mm
        return step_mm

    def _weights(self, read: PassResult, known: RestFit | None) -> Float:
        """Weights (rows, cols) of the nodes whose mean the constant gives: all, or those declared at rest."""
        if known is not None:
            return known.weights
        weights = np.where(read.island, self._scale**2, 0.0)
        return np.asarray(weights / weights.sum())

    def _known(self, read: PassResult) -> RestFit | None:
        """The fit to nodes that are declared to be at rest, where some are read."""
        if not self._known_rest:
            return None
        nodes = known_nodes(self._known_rest, read.point[..., 0], read.point[..., 1]) & read.island
        return fit_known(nodes, self._scale) if nodes.any() else None


def mean(weights: Float, values: Float) -> float:
    """Mean with weights that add up to 1."""
    return float(dot(weights, values))
