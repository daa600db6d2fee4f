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
from zeromethod.contact import load_slopes, slope_blocks
from zeromethod.contact.contact import Contact
from zeromethod.contact.loads import SHAPES, Loads, shares
from zeromethod.contact.median import median
from zeromethod.contact.slope_blocks import SlopeBlocks
from zeromethod.mechanics.yielding import Yielding
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface
from zeromethod.surface.anchor import mean_noise_gain
from zeromethod.warp.overlap import component_correlation

_FEWEST = 24
_PASSES, _LATER_PASSES = 3, 4
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
    """Correlation of nodes' noise, 0, 1, 2, ... nodes apart, along a component's own axis and the other."""

    own: Float
    other: Float

    @classmethod
    def of(cls, rig: Rig) -> Overlap:
        """That of a rig's target."""
        period_px = rig.target.period_px
        return cls(*component_correlation(period_px, period_px // 2, rig.target.kind))

    @property
    def whole(self) -> float:
        """Variance of means that reach over many nodes, over that of independent nodes."""
        return float((2 * self.own.sum() - 1) * (2 * self.other.sum() - 1))

    def within(self, nodes: Float) -> Float:
        """The same (n,) of means over squares of so many nodes (n,)."""
        sides = np.maximum(np.rint(np.sqrt(nodes)), 1).astype(int)
        known = [
            k * k * mean_noise_gain(self.own, k) * mean_noise_gain(self.other, k)
            for k in range(1, sides.max() + 1)
        ]
        return np.asarray(np.array(known)[sides - 1])


class ForceFit:
    """Shares of all contacts' pressures by the slopes of a surface, and of those read after it.

    mean: (t,) shares, then a tilt; spread: (t, t) their covariance. arms: (contacts, 3, t) net force, and
    torques about x and y, of each share, over pi E*. slopes: (2 n,) of the blocks that the fit was made of;
    terms: (2 n, t) of them by each share; weight: (2 n,) 1 / their sigma;
    open_slopes: (2 n,) what is open of them all together, by the body. at_mm: (n, 4, 2) where.
    """

    def __init__(
        self,
        blocks: SlopeBlocks,
        contacts: Sequence[Contact],
        yielding: Yielding,
        overlap: Overlap,
    ) -> None:
        """The fit to the slopes that the blocks were made of."""
        self._contacts, self._blocks = tuple(contacts), blocks
        loads = [Loads.of(contact) for contact in contacts]
        terms = [_terms(load, blocks.at_mm, yielding) for load in loads]
        tilt = np.broadcast_to(np.eye(2), (len(blocks.slope), 2, 2))
        self.terms = np.concatenate([*terms, tilt], axis=2).reshape(blocks.slope.size, -1)
        steep2 = (blocks.slope**2).sum(axis=1, keepdims=True)
        open2 = _MODEL**2 * blocks.slope**2
        rim2 = blocks.rim[:, None] ** 2 * steep2
        weight = (1 / np.sqrt(overlap.whole * (blocks.variance + rim2) + open2)).ravel()
        own = overlap.within(blocks.nodes)[:, None]
        by_own = (1 / np.sqrt(own * blocks.variance + rim2 + open2)).ravel()
        self.mean: Float
        self.spread: Float
        self._fit(weight, by_own, len(loads))
        self._allow_for(yielding, loads)
        self.arms = np.zeros((len(contacts), 3, len(self.mean)))
        for k, (contact, load) in enumerate(zip(contacts, loads, strict=True)):
            x, y = (load.cells - (contact.x_mm, contact.y_mm)).T
            by_cell = np.stack([np.ones_like(x), -y, x])
            self.arms[k, :, SHAPES * k : SHAPES * (k + 1)] = np.einsum("mc,sc->ms", by_cell, load.forces)

    def _allow_for(self, yielding: Yielding, loads: list[Loads]) -> None:
        """Add to the covariance what is open of the body: it changes all shares together."""
        at, wrong = self._blocks.at_mm.mean(axis=1), np.zeros(self._blocks.slope.shape)
        for load, net in zip(loads, self.mean[::SHAPES], strict=False):
            steep = yielding.open_slopes(at, load.middle_mm)
            if steep is not None:
                wrong += net * steep
        self.open_slopes = wrong.ravel()
        change = np.einsum("nt,n->t", self._gain, self.open_slopes)
        self.spread += np.outer(change, change)

    @classmethod
    def of(
        cls, surface: Surface, contacts: Sequence[Contact], yielding: Yielding, overlap: Overlap
    ) -> ForceFit | None:
        """The fit to a surface's slopes; None where too few are read."""
        blocks = SlopeBlocks.of(surface, contacts)
        if len(blocks.slope) < _FEWEST + SHAPES * len(contacts):
            return None
        return cls(blocks, contacts, yielding, overlap)

    def _fit(self, weight: Float, by_own: Float, count: int) -> None:
        """weight: (2 n,) 1 / standard deviation of slopes in means over many nodes; by_own: of each alone."""
        self.at_mm, self.slopes = self._blocks.at_mm, self._blocks.slope.ravel()
        wanted, used = self.slopes, weight
        for _ in range(_PASSES):
            normal, right = load_slopes.normal_equations(self.terms * used[:, None], wanted * used)
            mean, known = _regular(normal, right, count)
            left = np.abs(wanted - np.einsum("nt,t->n", self.terms, mean)) * by_own
            usual = max(median(left) / _MEDIAN, 1.0)
            last = used
            # slopes beside a border, where the mirror may fold, can be off by any amount
            used = weight * np.sqrt(np.minimum(1.0, _DOUBTED * usual / np.maximum(left, 1e-12)))
        inverse = np.asarray(np.linalg.inv(known), np.float64)
        self._first = self.mean = mean
        self.spread = usual**2 * inverse
        self._gain: Float = np.einsum("nt,tu->nu", self.terms * last[:, None] ** 2, inverse)
        self._kept = np.einsum("tu,uv->tv", inverse, normal)
        self._limit = _DOUBTED * usual / by_own
        self.weight = last / usual

    def serves(self, contacts: Sequence[Contact]) -> bool:
        """Whether these contacts lie where those of the fit do."""
        return len(contacts) == len(self._contacts) and all(
            one.id == other.id and _change(one, other) < _MOVED * other.sigma_edge_mm
            for one, other in zip(contacts, self._contacts, strict=True)
        )

    def follow(self, surface: Surface) -> bool:
        """Fit the slopes of another surface; False where too much has changed for that."""
        slopes, share = self._blocks.now(surface)
        alone = self._blocks.nodes == 1
        if np.count_nonzero(share[alone] == 0) > _LOST * np.count_nonzero(alone):
            return False
        read = np.where(share >= _LEAST_SHARE, share, 0.0)
        self.mean = load_slopes.followed(
            self.terms, self._gain, self._kept, self._limit, slopes.ravel(), read, self.mean, _LATER_PASSES
        )
        net = self.arms[:, 0]
        change, force = np.abs(net @ (self.mean - self._first)), np.abs(net @ self._first)
        sigma = np.sqrt(np.einsum("mt,tu,mu->m", net, self.spread, net))
        return bool((change <= np.maximum(_GROWN * force, _SURELY * sigma)).all())


def _terms(load: Loads, at_mm: Float, yielding: Yielding) -> Float:
    """(n, 2, SHAPES) mean slopes at points (n, 4, 2) by one contact; the body adds to its net force."""
    slopes = load_slopes.load_slopes(load, at_mm)
    # it is smooth, and so the same all over a block
    added = yielding.added_slopes(at_mm.mean(axis=1), load.middle_mm)
    if added is not None:
        slopes[:, :, 0] += added
    return slopes


def _change(one: Contact, other: Contact) -> float:
    """By how much a border has moved at most, mm, as far as its ellipse has it."""
    turned = math.radians(90 - abs((one.angle_deg - other.angle_deg) % 180 - 90))
    longer, wider = abs(one.major_mm - other.major_mm), abs(one.minor_mm - other.minor_mm)
    grown = max(longer, wider, turned * (other.major_mm - other.minor_mm)) / 2
    return math.hypot(one.x_mm - other.x_mm, one.y_mm - other.y_mm) + grown


def _regular(normal: Float, right: Float, count: int) -> tuple[Float, Float]:
    """Shares of the pressures of so many contacts, of which balls alone say how large the forces are."""
    alone = np.concatenate([np.arange(0, SHAPES * count, SHAPES), [-2, -1]])
    newtons = np.linalg.solve(normal[np.ix_(alone, alone)], right[alone])[:count]
    return shares(normal, right, newtons)


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    for module in (load_slopes, slope_blocks):
        module.compile_ahead()
