"""The constant of depth, from the loads on the rubber that explain the slopes.

Slopes give a depth D = d + C h, with h the integrator's scale (see `integrate`), and are read as y = grad d +
C grad h. The true depth is a sum of dents that loads make on the rig's rubber (`mechanics.gaussian_load`),
d = sum p_j f_j, p_j ~ N(0, gamma_j). With w the weights of a ring at the view's border, a0 = w.(D / h) and
m_j = w.(f_j / h), C is no unknown of its own, C = a0 - m.p, and means over blocks of nodes obey

    z = y - a0 grad h = sum over j of (grad f_j - m_j grad h) p_j + noise.

Which loads press is learned (`mechanics.load_variances`); then C is linear in slopes and ring, and its
weights serve many frames. Depth's mean over the view is what is reported: noise of the ring's mean against it
goes into sigma as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.ndimage import correlate1d

from zeromethod.arrays import Float, Mask
from zeromethod.mechanics.bodies import Candidate
from zeromethod.mechanics.gaussian_load import Elastic, Loads
from zeromethod.mechanics.load_posterior import posterior
from zeromethod.mechanics.load_variances import COST, learned_variances, spread_variances
from zeromethod.mechanics.possible_loads import possible_loads
from zeromethod.mechanics.whitening import Whitening
from zeromethod.surface.block_readings import BlockReader, BlockReadings
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.learned import Fit, Learned, Linear, OfBody
from zeromethod.surface.outside import Outside
from zeromethod.surface.possible_dents import PossibleDents
from zeromethod.warp.blocks import Blocks

_RING = 0.2
"""Width of the ring over the view's shorter side."""
_LEAST_RING = 16
"""Blocks of the ring below which all of the view serves as the ring."""
_MODEL, _MOST_MODEL = 1e-3, 0.1
"""Error of dents' slopes over the slope: at least (blocks, shifts of nodes), and at most."""
_UNEVEN = 0.04
"""Part of the noise that blocks do not share: the carrier changes correlations as much (`warp.overlap`)."""
_LEAST_OUTSIDE = 0.25
"""Share of all that presses below which pressure outside the view may come of errors of dents inside it."""
_STEEP = 10.0
"""Slope over noise from which a block says how large that error is."""
Bodies = tuple[tuple[PossibleDents, tuple[PossibleDents, ...]], ...]
"""Dents on each body that the rubber may be, and on bodies beside it."""


class LoadConstant:
    """Finds the constant of depth by the loads that press, for one view."""

    def __init__(
        self,
        candidates: Sequence[Callable[[], Candidate]],
        x_mm: Float,
        y_mm: Float,
        scale: Float,
        gradient: Float,
        known: Mask,
        correlation: Float,
    ) -> None:
        """x_mm, y_mm, scale h: (rows, cols) at rest; h's gradient (..., 2).

        known: (rows, cols) nodes that see the mirror at rest; h is not that of others. correlation: of nodes'
        noise.
        """
        self._x, self._y, self._scale, self._candidates = x_mm, y_mm, scale, candidates
        self.knows_body = bool(candidates)
        self._blocks = Blocks.of(x_mm.shape)
        self.reader = BlockReader(self._blocks, x_mm, y_mm, scale)
        of_scale = np.concatenate([gradient, 1.0 / scale[..., None]], axis=-1)
        means, _ = self._blocks.means(of_scale, known)
        self._gradient, self._inverse_scale = means[:, :2], means[:, 2]
        self._both_ways = np.concatenate([correlation[:0:-1], correlation])
        of_blocks = np.kron(*self._blocks.correlation(correlation))
        self._of_blocks = (1.0 - _UNEVEN) * of_blocks + _UNEVEN * np.diag(np.diag(of_blocks))
        self._border = self._blocks.border(_RING)

    @cached_property
    def view_mm(self) -> tuple[Float, Float]:
        """Corners (2,) of what is seen of the mirror: least and largest x and y."""
        low, high = (np.array([edge(self._x), edge(self._y)]) for edge in (np.min, np.max))
        return low, high

    @cached_property
    def _dents(self) -> Bodies:
        low, high = self.view_mm
        block_mm = float(np.sqrt(np.prod(high - low) / self._blocks.count))
        loads = possible_loads(low, high, block_mm)

        def of(body: Elastic) -> PossibleDents:
            return PossibleDents(body, loads, self._blocks, self._x, self._y)

        made = [candidate() for candidate in self._candidates]
        return tuple((of(one.body), tuple(of(other) for other in one.others)) for one in made)

    def learn(
        self,
        read: BlockReadings,
        variance: Float,
        island: Mask,
        linear: LinearIntegration,
        before: Learned | None = None,
        again: bool = True,
    ) -> Learned:
        """Learn which loads press, and the constant's weights.

        variance: (rows, cols, 2) of the nodes' slopes; linear: of their integration. before: what was learned
        before; not again: its loads are kept, and weights made for the blocks that are used now.
        """
        ring = self._ring(read)
        shared, open_mm2 = self._noise_of_view(ring, variance, island, linear)
        view = _View(self, read, ring, shared, open_mm2)
        starts = [None] * len(self._dents) if before is None else before.bodies
        found = []
        for (dents, others), start in zip(self._dents, starts, strict=True):
            found.append(view.of_body(dents, others, start, again))
        if before is not None and not again:
            return replace(before, bodies=tuple(found), used=read.used)
        best = max(found, key=lambda body: body.evidence)
        return Learned(tuple(found), read.used, best.fit.chi2(read, read.used))

    def open(self, read: BlockReadings) -> tuple[float, float]:
        """(constant, its standard deviation), mm, where nothing serves: the ring is taken as at rest.

        It is as deep as its slopes make it over half of the view.
        """
        ring = self._ring(read)
        constant_mm = float(ring @ read.ratio)
        extent_mm = float(np.hypot(np.ptp(self._x), np.ptp(self._y)))
        steep2 = ((read.slope - constant_mm * self._gradient) ** 2).sum(axis=1)
        return constant_mm, 0.5 * extent_mm * float(np.sqrt(ring @ steep2))

    def open_constant(self, read: BlockReadings, other: BlockReadings) -> float:
        """`open`'s constant of other values, by the ring's weights of a reading."""
        return float(self._ring(read) @ other.ratio)

    def _ring(self, read: BlockReadings) -> Float:
        """(blocks,) weights of the border, larger where it is flat."""
        ring = self._border & read.used
        ring = ring if np.count_nonzero(ring) >= _LEAST_RING else read.used
        steep2 = (read.slope**2).sum(axis=1) + 4.0 * read.variance.sum(axis=1)
        weights = np.where(ring, 1.0 / np.maximum(steep2, 1e-30), 0.0)
        return np.asarray(weights / weights.sum())

    def _noise_of_view(
        self, ring: Float, variance: Float, island: Mask, linear: LinearIntegration
    ) -> tuple[Float, float]:
        """Noise of the view's mean depth / h less the ring's: its covariance with slopes, its variance."""
        count = np.maximum(self._blocks.sums(island.astype(np.float64)), 1.0)
        of_ring = self._blocks.spread(ring / count) * island
        of_view = self._scale**2 * island
        slope_weights = linear.slope_weights(of_view / of_view.sum() - of_ring / of_ring.sum(), 1e-2)
        sigma = np.sqrt(np.where(island[..., None], variance, 0.0))
        noise = sigma * slope_weights
        for axis in (0, 1):
            noise = correlate1d(noise, self._both_ways, axis=axis, mode="constant")
        shared = self._blocks.sums(sigma * noise) / count[:, None]
        return shared, float((sigma * slope_weights * noise).sum())


class _White(NamedTuple):
    """White equations data = phi p + noise; mean (loads,): depth / h in the ring of dents 1 mm deep."""

    white: Whitening
    phi: Float
    data: Float
    mean: Float
    error2: float


class _View:
    """One reading's equations for any body: z, its noise, and the ring that the constant is counted from."""

    def __init__(
        self, of: LoadConstant, read: BlockReadings, ring: Float, shared: Float, open_mm2: float
    ) -> None:
        self._used, self._ring, self._open_mm2 = read.used, ring, open_mm2
        self._view = of.view_mm
        self._of_h = of._inverse_scale, of._gradient
        self._gradient = of._gradient[read.used].T.ravel()
        self._z = read.slope[read.used].T.ravel() - float(ring @ read.ratio) * self._gradient
        self._slope2 = np.tile((read.slope[read.used] ** 2).sum(axis=1), 2)
        sigma = np.sqrt(read.variance[read.used]).T
        of_blocks = of._of_blocks[np.ix_(read.used, read.used)]
        along, across = (np.asarray(of_blocks * np.outer(one, one)) for one in sigma)
        self._noise = along, across
        self._shared = shared[read.used].T.ravel()

    def of_body(
        self, dents: PossibleDents, others: Sequence[PossibleDents], start: OfBody | None, again: bool
    ) -> OfBody:
        """The constant by the loads that are learned for this body, and for these by the bodies beside it."""
        kept = None if again else start
        data = self._white(dents, _MODEL**2 if kept is None else kept.error2)
        if kept is None:
            data, variances = self._learned(dents, data, None if start is None else start.variances)
            spread = spread_variances(variances, dents.loads)
            found = self._posterior(data, spread, variances, None)
            outside = self._outside(data, found.fit.root, spread, dents.loads)
        else:
            variances = kept.variances
            spread = spread_variances(variances, dents.loads)
            found = self._posterior(data, spread, variances, kept.weak_shares)
            outside = kept.outside
        beside = (self._white(other, data.error2) for other in others)
        moved = tuple(self._posterior(one, spread, variances, found.weak_shares).constant for one in beside)
        return replace(found, others=moved, outside=outside)

    def _outside(self, of: _White, root: Float, gamma: Float, loads: Loads) -> Outside | None:
        """What of the loads presses beyond what is seen of the mirror; None where its middle is seen."""
        low, high = self._view
        place = np.stack([loads.x_mm, loads.y_mm], axis=-1)
        beyond = ((place < low) | (place > high)).any(axis=-1)
        q = np.where(beyond, loads.q_mm2, 0.0)
        over = solve_triangular(root, np.stack([of.phi @ (gamma * q), of.data], axis=1), lower=True)
        depths = gamma * (of.phi.T @ solve_triangular(root, over[:, 1], lower=True, trans=1))
        pressed = depths * q
        total = float(pressed.sum())
        sigma = float(np.sqrt(max(gamma @ q**2 - over[:, 0] @ over[:, 0], 0.0)))
        x, y = middle = pressed @ place / (total or 1.0)
        seen = ((middle >= low) & (middle <= high)).all() or total < _LEAST_OUTSIDE * float(
            depths @ loads.q_mm2
        )
        return None if seen else Outside(x, y, total, sigma)

    def _white(self, dents: PossibleDents, error2: float) -> _White:
        """The equations of one body, made white. error2: of its dents' slopes, over the slope."""
        white = Whitening(self._noise, error2 * self._slope2)
        phi, mean = dents.seen(self._ring, *self._of_h, self._used)
        return _White(white, white(phi), white(self._z), mean, error2)

    def _posterior(self, of: _White, gamma: Float, variances: Float, shares: Float | None) -> OfBody:
        shared = of.white(self._shared)
        found = posterior(of.phi, gamma, of.data, of.mean, shared, self._open_mm2, shares)
        a = of.white.weights(found.weights)
        of_slope = np.zeros((len(self._used), 2))
        of_slope[self._used] = a.reshape(2, -1).T
        constant = Linear(self._ring * (1.0 + float(a @ self._gradient)), of_slope)
        evidence = found.evidence - of.white.log_size - COST * np.count_nonzero(variances)
        fit = Fit(self._ring, self._of_h[1], of.white, found.root)
        return OfBody(
            constant, found.variance, evidence, variances, found.shares, of.error2, found.by_others, fit
        )

    def _learned(self, dents: PossibleDents, of: _White, start: Float | None) -> tuple[_White, Float]:
        """The equations, with the error of the dents that is found, and the loads' variances."""
        variances = learned_variances(of.phi, of.data, dents.loads, start)
        noise2 = np.concatenate([np.diag(one) for one in self._noise])
        steep = self._slope2 > _STEEP**2 * noise2
        if steep.any():
            some = of.phi[:, variances > 0.0]
            whole = np.eye(len(of.data)) + (some * variances[variances > 0.0]) @ some.T
            left = of.white.back(np.asarray(np.linalg.solve(whole, of.data)))
            error2 = 1.3 * float((left**2 - noise2)[steep].mean() / self._slope2[steep].mean())
            if error2 > of.error2:
                of = self._white(dents, min(error2, _MOST_MODEL**2))
                variances = learned_variances(of.phi, of.data, dents.loads, variances)
        return of, variances
