"""Anchor of one reading, chosen while its passes settle: quiet nodes, and the far field they still have.

Nodes are judged on what was read less the constant that it contains already, so that where a reading started
does not show. The far field is fitted to the surface that contains it until it stays: one of 0.1 mm moves the
mirror enough for an error of 1 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rig.model import KnownRest
from zeromethod.surface.anchor import RestFit, fit_known, fit_quiet, known_nodes
from zeromethod.surface.far_field import FarField, fit_far_field

_NEARLY_MM = 3e-4
"""Change of depth below which nodes are chosen; then they are kept, so that the passes converge."""
_FIXED_MM = 3e-7
"""Step of a far field from which it is kept."""
_SHARP_MM = 2e-6
"""The same where its sigma is as small: choosing again changes a hundredth of either."""
_DOUBTFUL_MM = 1e-3
"""Sigma of the constant above which nodes may be chosen in several ways."""
_FAR_MM = 0.02
"""Far field above which to take it out of the slopes to first order is too rough for choosing nodes."""
_MOST_FITS = 6


@dataclass(frozen=True, slots=True)
class Pass:
    """What one pass read, (rows, cols): depth as it began, and what depth / h lacks by its slopes."""

    slope: Float
    variance: Float
    point: Float
    island: Mask
    depth: Float
    error: Float


class Anchors:
    """Where depth may be anchored, of one reader."""

    def __init__(
        self, known_rest: Sequence[KnownRest], scale: Float, scale_gradient: Float, correlation: Float
    ) -> None:
        """scale: h (rows, cols); its gradient (rows, cols, 2). correlation: see `fit_quiet`."""
        self._known_rest, self._correlation = known_rest, correlation
        self.scale, self._gradient = scale, scale_gradient

    def nodes(self, read: Pass, contained_mm: float) -> RestFit:
        """Nodes that count as at rest, with the bound of their depth / h.

        contained_mm: multiple of h in the depth, which is taken out.
        """
        x, y = read.point[..., 0], read.point[..., 1]
        known = known_nodes(self._known_rest, x, y) & read.island
        if known.any():
            return fit_known(known, self.scale)
        depth = read.depth + self.scale * read.error
        slope = read.slope - contained_mm * self._gradient
        return fit_quiet(slope, read.variance, depth, self.scale, x, y, read.island, self._correlation)

    def far_field(self, nodes: RestFit, read: Pass, at_mm: float) -> FarField:
        """Far field of a surface whose quiet `nodes` have a mean depth / h of `at_mm`."""
        depth = read.depth + self.scale * read.error
        depth += self.scale * (at_mm - mean(nodes.weights, depth / self.scale))
        x, y = read.point[..., 0], read.point[..., 1]
        fields = (read.slope, read.variance, depth, self.scale, self._gradient, x, y, read.island)
        return fit_far_field(*fields, nodes.weights, nodes.sigma_mm, nodes.hidden_mm)


class Anchoring:
    """The anchor of one reading; `fit` once it is chosen, `fixed` once no pass changes it any more."""

    def __init__(self, anchors: Anchors, weights: Float | None) -> None:
        """weights: of nodes whose mean depth / h is kept until the anchor is chosen; None: chosen at once."""
        self._anchors, self._weights = anchors, weights
        self._fits = 0
        self._chosen: RestFit | None = None
        self._again = True
        self.fit: RestFit | None = None
        self.fixed = False

    def constant(self, read: Pass) -> float:
        """Multiple of h, mm, to add to a pass's depth and error."""
        if self._weights is None:
            self._weights = self._anchors.nodes(read, 0.0).weights
        ratio = read.depth / self._anchors.scale
        kept_mm = mean(self._weights, ratio)
        if not self.fixed and (self._fits or self._moved_mm(read) < _NEARLY_MM):
            self._choose(read)
        to_mm = kept_mm if self.fit is None else self.fit.far_field_mm
        return to_mm - mean(self._weights, ratio + read.error)

    def _moved_mm(self, read: Pass) -> float:
        """Largest change of depth by a pass whose constant is kept."""
        assert self._weights is not None
        off_mm = -mean(self._weights, read.error)
        return largest(self._anchors.scale * (read.error + off_mm) * read.island)

    def _choose(self, read: Pass) -> None:
        """Choose nodes by this pass, and the far field once these have the constant of the ones before."""
        assert self._weights is not None
        self._fits += 1
        ratio = read.depth / self._anchors.scale
        chosen = self._chosen
        if chosen is None or self._again:
            before, made = self._weights, ratio + read.error
            self._chosen = chosen = self._anchors.nodes(read, mean(before, ratio))
            self._weights = chosen.weights
            if self._fits == 1 and abs(mean(chosen.weights, made) - mean(before, made)) > _NEARLY_MM:
                return
        at_mm, fit = mean(chosen.weights, ratio), chosen
        if chosen.hidden_mm > 0.0:
            found = self._anchors.far_field(chosen, read, at_mm)
            fit = replace(chosen, far_field_mm=at_mm - found.constant_mm, sigma_mm=found.sigma_mm)
        step_mm = abs(fit.far_field_mm - at_mm)
        fixed_mm = _SHARP_MM if fit.sigma_mm < _SHARP_MM else _FIXED_MM
        moves = step_mm > (fixed_mm if chosen.hidden_mm else _NEARLY_MM)
        self._again = moves and abs(fit.far_field_mm) < _FAR_MM
        self.fixed = self._fits == _MOST_FITS or not moves
        self.fit = fit

    @property
    def doubtful(self) -> bool:
        """Whether it depends on where the reading started."""
        return self.fit is not None and not certain(self.fit.sigma_mm, self.fit.far_field_mm)


def certain(sigma_mm: float, far_field_mm: float) -> bool:
    """Whether a reading may start from one with this anchor, without ending elsewhere than one from rest."""
    return sigma_mm < _DOUBTFUL_MM and abs(far_field_mm) < _FAR_MM


def mean(weights: Float, values: Float) -> float:
    """Mean with weights that add up to 1."""
    return float(np.vdot(weights, values))


def largest(values: Float) -> float:
    """Largest absolute value."""
    return max(float(values.max()), -float(values.min()))
