"""One fit of contacts' pressures to slopes, whose geometry serves frame after frame while outlines rest.

Kernels, weights and factors depend on where contacts lie, and hardly on one frame's slopes: later frames are
only multiplied by them. Slopes that are not read then, or far off, count as what the fit says of them (the
H-algorithm). Source: Huber 1981, Robust Statistics, 7.8, doi:10.1002/0471725250.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact import load_fields
from zeromethod.contact.contact import Contact
from zeromethod.contact.loads import SHAPES, Loads, shares
from zeromethod.contact.median import median
from zeromethod.contact.slope_blocks import LARGEST, SlopeBlocks
from zeromethod.mechanics.yielding import Yielding
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface
from zeromethod.warp.overlap import component_correlation, mean_noise_gain

_FEWEST = 24
"""Blocks of slopes, beyond those that the shares need, without which nothing is fitted."""
_PASSES, _LATER_PASSES = 2, 4
"""Passes in which outlying slopes lose weight: of a fit, and of a frame that follows one."""
_MEDIAN = 0.6745
"""Median of the size of a standard normal number."""
_DOUBTED = 2.5
"""Slopes that are farther off than so many standard deviations count less. Source: Huber 1964,
doi:10.1214/aoms/1177703732."""
_MODEL = 0.003
"""What the kernel and the contact's border leave open of slopes, relative to them."""
_MOVED = 3.0
"""Standard deviations of its border by which a contact may move, or grow, before kernels are made again: what
is read of balls, cones, punches and rods changed by less than a third of its sigma, mostly by a twentieth."""
_GROWN, _SURELY = 0.25, 3.0
"""Relative change of a force, if it is larger than so many standard deviations, from which weights are."""
_LOST = 0.2
"""Share of the nodes that stand alone which need not be read in a frame."""
_LEAST_SHARE = 0.9
"""Of a block's weight that must be read in a frame."""


@dataclass(frozen=True)
class Overlap:
    """Noise of means over nodes, whose windows overlap, over that of independent nodes, as variances.

    whole: of means that reach over many nodes. squares: (LARGEST,) over squares of 1, 2, ... nodes a side.
    """

    whole: float
    squares: Float

    @classmethod
    def of(cls, rig: Rig) -> Overlap:
        """That of a rig's target."""
        period_px = rig.target.period_px
        own, other = component_correlation(period_px, period_px // 2, rig.target.kind)
        squares = [
            side * side * mean_noise_gain(own, side) * mean_noise_gain(other, side)
            for side in range(1, LARGEST + 1)
        ]
        return cls(float((2 * own.sum() - 1) * (2 * other.sum() - 1)), np.array(squares))

    def within(self, nodes: Float) -> Float:
        """The variances' ratio (n,) for means over squares of so many nodes (n,)."""
        return np.asarray(self.squares[np.maximum(np.rint(np.sqrt(nodes)), 1).astype(int) - 1])


class ForceFit:
    """Shares of all contacts' pressures by the slopes of a surface, and of those read after it.

    mean: (t,) shares, then a tilt; spread: (t, t) their covariance. by_constant: (t,) their change by an
    error of depth's constant, 1/mm; not in spread, as what is known of the constant changes while a fit
    serves. arms: (contacts, 3, t) net force, and torques about x and y, of each share, over pi E*. loads:
    pressures of each contact. slopes: (2 n,) of the blocks that the fit was made of; terms: (2 n, t) of them
    by each share; weight: (2 n,) 1 / their sigma; open_slopes: (2 n,) what is open of them all together, by
    the body; None where nothing is. blocks: where. alone: (nodes,) those that stand alone, counted along
    rows; depths: (nodes, t - 2) there by each share.
    """

    def __init__(
        self,
        blocks: SlopeBlocks,
        contacts: Sequence[Contact],
        yielding: Yielding,
        overlap: Overlap,
    ) -> None:
        """The fit to the slopes that the blocks were made of."""
        self._contacts, self.blocks = tuple(contacts), blocks
        self.loads = [Loads.of(contact) for contact in contacts]
        count, self.alone = SHAPES * len(contacts), blocks.alone()
        self.slopes = blocks.slope.ravel()
        self.terms = np.empty((len(self.slopes), count + 2))
        self.depths = np.empty((len(self.alone), count))
        for k, load in enumerate(self.loads):
            own = slice(SHAPES * k, SHAPES * (k + 1))
            fields = load_fields.load_fields(load, blocks.at_mm, blocks.spread_mm2)
            # the body adds to the net force; it is smooth, and so the same all over a block
            added = yielding.added_slopes(blocks.at_mm, load.middle_mm)
            if added is not None:
                fields[:, 1:, 0] += added
            self.terms[:, own] = fields[:, 1:].reshape(-1, SHAPES)
            self.depths[:, own] = fields[blocks.nodes == 1, 0]
        self.terms[:, count:] = np.tile(np.eye(2), (len(blocks.slope), 1))
        steep2 = (blocks.slope**2).sum(axis=1, keepdims=True)
        open2 = _MODEL**2 * blocks.slope**2 + blocks.rim[:, None] ** 2 * steep2
        own2 = overlap.within(blocks.nodes)[:, None] * blocks.variance + open2
        self._fit((1 / np.sqrt(overlap.whole * blocks.variance + open2)).ravel(), (1 / np.sqrt(own2)).ravel())
        self.by_constant = self._change_by(blocks.by_constant.ravel())
        self._allow_for(yielding, blocks.at_mm)
        self.arms = np.zeros((len(contacts), 3, len(self.mean)))
        for k, (contact, load) in enumerate(zip(contacts, self.loads, strict=True)):
            x, y = (load.cells - (contact.x_mm, contact.y_mm)).T
            by_cell = np.stack([np.ones_like(x), -y, x])
            self.arms[k, :, SHAPES * k : SHAPES * (k + 1)] = np.einsum("mc,sc->ms", by_cell, load.forces)

    @classmethod
    def of(
        cls, surface: Surface, contacts: Sequence[Contact], yielding: Yielding, overlap: Overlap
    ) -> ForceFit | None:
        """The fit to a surface's slopes; None where too few are read."""
        blocks = SlopeBlocks.of(surface, contacts)
        if len(blocks.slope) < _FEWEST + SHAPES * len(contacts):
            return None
        return cls(blocks, contacts, yielding, overlap)

    def _fit(self, weight: Float, by_own: Float) -> None:
        """weight: (2 n,) 1 / standard deviation of slopes in means over many nodes; by_own: of each alone."""
        used = weight
        for _ in range(_PASSES):
            last = used
            normal, right = load_fields.normal_equations(self.terms, self.slopes, used)
            self.mean, known = shares(normal, right, self.loads)
            left = np.abs(load_fields.left_over(self.terms, self.slopes, self.mean)) * by_own
            usual = max(median(left) / _MEDIAN, 1.0)
            # slopes beside a border, where the mirror may fold, can be off by any amount
            used = weight * np.sqrt(np.minimum(1.0, _DOUBTED * usual / np.maximum(left, 1e-12)))
        inverse = np.asarray(np.linalg.inv(known), np.float64)
        self._first = self.mean
        self.spread = usual**2 * inverse
        self._used, self._inverse = last, inverse
        self._kept = np.einsum("tu,uv->tv", inverse, normal)
        self._limit = _DOUBTED * usual / by_own
        self.weight = last / usual

    def _allow_for(self, yielding: Yielding, at_mm: Float) -> None:
        """Add to the covariance what is open of the body at (n, 2): it changes all shares together."""
        self.open_slopes = None
        for load, net in zip(self.loads, self.mean[::SHAPES], strict=False):
            steep = yielding.open_slopes(at_mm, load.middle_mm)
            if steep is None:
                return
            self.open_slopes = (0.0 if self.open_slopes is None else self.open_slopes) + net * steep.ravel()
        assert self.open_slopes is not None
        change = self._change_by(self.open_slopes)
        self.spread += np.outer(change, change)

    def _change_by(self, slopes: Float) -> Float:
        """Change (t,) of the shares by that of all slopes (2 n,)."""
        _, right = load_fields.normal_equations(self.terms, slopes, self._used)
        return np.asarray(np.einsum("tu,u->t", self._inverse, right))

    def serves(self, contacts: Sequence[Contact]) -> bool:
        """Whether these contacts lie where those of the fit do."""
        return len(contacts) == len(self._contacts) and all(
            one.id == other.id and _change(one, other) < _MOVED * other.sigma_edge_mm
            for one, other in zip(contacts, self._contacts, strict=True)
        )

    def follow(self, surface: Surface) -> bool:
        """Fit the slopes of another surface; False where too much has changed for that."""
        slopes, share = self.blocks.now(surface)
        alone = self.blocks.nodes == 1
        if np.count_nonzero(share[alone] == 0) > _LOST * np.count_nonzero(alone):
            return False
        read = np.where(share >= _LEAST_SHARE, share, 0.0)
        self.mean = load_fields.followed(
            self.terms, self._used, self._inverse, self._kept, self._limit, slopes.ravel(), read, self.mean,
            _LATER_PASSES,
        )  # fmt: skip
        net = self.arms[:, 0]
        change, force = np.abs(net @ (self.mean - self._first)), np.abs(net @ self._first)
        sigma = np.sqrt(np.einsum("mt,tu,mu->m", net, self.spread, net))
        return bool((change <= np.maximum(_GROWN * force, _SURELY * sigma)).all())


def _change(one: Contact, other: Contact) -> float:
    """By how much a border has moved at most, mm, as far as its ellipse has it."""
    turned = math.radians(90 - abs((one.angle_deg - other.angle_deg) % 180 - 90))
    longer, wider = abs(one.major_mm - other.major_mm), abs(one.minor_mm - other.minor_mm)
    grown = max(longer, wider, turned * (other.major_mm - other.minor_mm)) / 2
    return math.hypot(one.x_mm - other.x_mm, one.y_mm - other.y_mm) + grown
