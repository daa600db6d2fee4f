"""Anchor of one reading, chosen while its passes settle: quiet nodes, and the far field they still have.

Nodes are judged on what was read less the constant that it contains already, so that where a reading started
does not show. The far field is fitted to the surface that contains it until it stays: one of 0.1 mm moves the
mirror enough for an error of 1 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rig.model import KnownRest
from zeromethod.surface.anchor import MOST_CHOICES, Border, QuietNodes, RestFit, fit_known, known_nodes
from zeromethod.surface.far_field import BodyOnNodes, FarField, fit_far_field
from zeromethod.surface.kept_constant import KeptConstant
from zeromethod.surface.node_passes import dot, step_of
from zeromethod.surface.pass_result import PassResult
from zeromethod.surface.roughness import roughness
from zeromethod.surface.weak_dents import weak_far_field

_AGAIN_MM = 1e-4
"""Step of the constant above which it is found again: what is found depends on it by less than 1 in 2000."""
_DOUBTFUL_MM = 1e-3
"""Sigma of the constant above which nodes may be chosen in several ways."""
_SAME = 1e-3
"""Share of the weight by which two choices of nodes may differ and count as the same."""
_FAR_MM = 0.02
"""Far field above which to take it out of the slopes to first order is too rough for choosing nodes."""
_MOST_FITS = 6
"""How often the far field is fitted in one reading, at most."""


class AnchorFinder:
    """Finds the nodes at rest and the far field, for one reader."""

    def __init__(
        self,
        known_rest: Sequence[KnownRest],
        scale: Float,
        scale_gradient: Float,
        correlation: Float,
        body: Callable[[], BodyOnNodes] | None = None,
    ) -> None:
        """scale: h (rows, cols); its gradient (rows, cols, 2). correlation: see `Border`. body: if known."""
        self._body_of, self._body = body, BodyOnNodes.none()
        self._known_rest, self._correlation = known_rest, correlation
        self.scale, self._gradient = scale, scale_gradient
        self.loads: KeptConstant | None = None
        self._border: Border | None = None

    def nodes(self, read: PassResult, contained_mm: float, most: int = MOST_CHOICES) -> tuple[RestFit, float]:
        """Nodes that count as at rest, with the bound of their depth / h, and the mean of that.

        contained_mm: multiple of h in the depth, to begin with. most: times that quiet nodes are chosen.
        """
        x, y = read.point[..., 0], read.point[..., 1]
        ratio = read.depth / self.scale
        known = known_nodes(self._known_rest, x, y) & read.island if self._known_rest else None
        if known is not None and known.any():
            fit = fit_known(known, self.scale)
            return fit, mean(fit.weights, ratio)
        if self._border is None or not np.array_equal(self._border.island, read.island):
            self._border = Border(read.island, self._gradient, self._correlation)
        quiet = QuietNodes(self._border, read.slope, read.variance, ratio, self.scale, x, y)
        return quiet.fit(contained_mm, most)

    def far_field(self, nodes: RestFit, read: PassResult, several: bool) -> FarField:
        """Far field of a surface with these quiet nodes. several: as of `fit_far_field`."""
        x, y = read.point[..., 0], read.point[..., 1]
        if self._body_of is not None:
            self._body, self._body_of = self._body_of(), None
        # a mirror that is rough itself follows no law more closely
        variance = roughness(read.slope, read.variance, self._correlation, read.island) * read.variance
        fields = (read.slope, variance, read.depth, self.scale, self._gradient, x, y, read.island)
        return fit_far_field(*fields, nodes.weights, nodes.sigma_mm, nodes.hidden_mm, self._body, several)

    def weak_far_field(self, nodes: RestFit, read: PassResult, contained_mm: float) -> tuple[float, float]:
        """Far field of what noise hides, and its sigma, mm, where no slopes are more than noise."""
        x, y = read.point[..., 0], read.point[..., 1]
        slopes = read.slope, self._gradient, contained_mm, read.variance, read.island
        assert self._border is not None  # quiet nodes are those of a border
        return weak_far_field(nodes.weights, self.scale, *slopes, x, y, self._border.shared)


class Anchoring:
    """The anchor of one reading: `fit`, None until it is chosen; `fixed` once no pass changes it any more."""

    def __init__(self, anchors: AnchorFinder, weights: Float | None, several: bool) -> None:
        """weights: of nodes whose mean depth / h is kept until the anchor is chosen; None: chosen at once.

        several: as of `fit_far_field`.
        """
        self._anchors, self._weights, self._several = anchors, weights, several
        self.linear = None
        self._step_mm, self.time_ns = 0.0, 0
        self._fits = 0
        self._chosen: RestFit | None = None
        self.fit: RestFit | None = None
        self.fixed = False

    def shape(self, read: PassResult, error: Float) -> Float:
        """Step of depth (rows, cols), mm, that removes an error of depth / h and keeps the anchor's mean."""
        scale = self._anchors.scale
        if self._weights is None:
            there = replace(read, depth=read.depth + scale * error)
            self._weights = self._anchors.nodes(there, 0.0, 1)[0].weights
        return step_of(scale, error, mean(self._weights, error), read.island)

    def choose(self, read: PassResult) -> float:
        """Choose the nodes and fit the far field; returns the multiple of h to add to depth, mm."""
        self._fits += 1
        assert self._weights is not None
        if self._anchors.loads is not None:
            x, y = read.point[..., 0], read.point[..., 1]
            first = self._fits == 1
            c_mm, sigma_mm = self._anchors.loads.of(
                read, self.linear(x, y), first, self._step_mm, self.time_ns
            )
            weights = np.where(read.island, self._anchors.scale**2, 0.0)
            weights /= weights.sum()
            at_mm = mean(weights, read.depth / self._anchors.scale)
            self.fit = RestFit("loads", weights, sigma_mm, at_mm - c_mm)
            self.fixed = abs(c_mm) < _AGAIN_MM or self._fits == _MOST_FITS
            self._step_mm = c_mm
            return -c_mm
        chosen, at_mm = self._chosen, mean(self._weights, read.depth / self._anchors.scale)
        if chosen is None or self.fit is None or abs(self.fit.far_field_mm) < _FAR_MM:
            self._chosen, at_mm = self._anchors.nodes(read, at_mm)
            chosen = self._chosen
        self._weights, fit = chosen.weights, chosen
        if chosen.hidden_mm > 0.0:
            found = self._anchors.far_field(chosen, read, self._several)
            fit = replace(chosen, far_field_mm=at_mm - found.constant_mm, sigma_mm=found.sigma_mm)
        elif chosen.mode == "quiet":
            far_mm, sigma_mm = self._anchors.weak_far_field(chosen, read, at_mm)
            fit = replace(chosen, far_field_mm=far_mm, sigma_mm=sigma_mm)
        step_mm = fit.far_field_mm - at_mm
        self.fixed = abs(step_mm) < _AGAIN_MM or self._fits == _MOST_FITS
        self.fit = fit
        return step_mm

    def chooses_so_after(self, first: PassResult | None, read: PassResult) -> bool:
        """Whether a reading from rest, with this first pass, would have chosen the same nodes."""
        if first is None or self._chosen is None:
            return False
        begun = self._anchors.nodes(first, 0.0, 1)[0].weights
        contained_mm = mean(begun, read.depth / self._anchors.scale)
        weights = self._anchors.nodes(read, contained_mm)[0].weights
        return float(np.abs(weights - self._chosen.weights).sum()) < _SAME

    @property
    def doubtful(self) -> bool:
        """Whether the anchor depends on where the reading started."""
        return self.fit is not None and not certain(self.fit.sigma_mm, self.fit.far_field_mm)


def certain(sigma_mm: float, far_field_mm: float) -> bool:
    """Whether a reading may start from one with this anchor, without ending elsewhere than one from rest."""
    return sigma_mm < _DOUBTFUL_MM and abs(far_field_mm) < _FAR_MM


def mean(weights: Float, values: Float) -> float:
    """Mean with weights that add up to 1."""
    return float(dot(weights, values))
