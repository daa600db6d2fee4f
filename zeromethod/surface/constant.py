"""The constant of depth, from the loads on the rubber that explain the slopes.

Slopes give a depth D = d + C h, with h the integrator's scale (see `integrate`), and are read as y = grad d +
C grad h. The true depth is a sum of dents that loads make on the rig's rubber (`mechanics.gaussian_load`),
d = sum p_j f_j, p_j ~ N(0, gamma_j). With w the weights of a ring at the view's border, a0 = w.(D / h) and m_j =
w.(f_j / h), C is no unknown of its own, C = a0 - m.p, and means over blocks of nodes obey

    z = y - a0 grad h = sum over j of (grad f_j - m_j grad h) p_j + noise.

Which loads press is learned (`mechanics.load_variances`); then C is linear in slopes and ring, and its weights serve
many frames. Wanted is the mean over the view: the noise of the ring's mean against it counts as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import correlate1d

from zeromethod.arrays import Float, Mask
from zeromethod.mechanics.bodies import Candidate
from zeromethod.mechanics.gaussian_load import Elastic, Loads
from zeromethod.mechanics.load_posterior import posterior
from zeromethod.mechanics.load_variances import COST, learned_variances, spread_variances
from zeromethod.mechanics.possible_loads import possible_loads
from zeromethod.surface.blocks import Blocks
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.whitening import Whitening

_RING = 0.2
"""Width of the ring over the view's shorter side."""
_LEAST_RING = 16
"""Blocks of the ring below which all of the view serves as the ring."""
_MODEL, _MOST_MODEL = 1e-3, 0.1
"""Error of the dents' slopes over the slope: of blocks and shifts at least, and where the constant is 50 µm off."""
_STEEP = 10.0
"""Slope over noise from which a block says how large that error is."""
_UNSURE = 10.0
"""Nats by which evidences of bodies are unsure: loads are learned one by one, and may be others as well."""
_AT_ONCE = 128
"""Loads whose fields are worked out together, some 8 MB."""


@dataclass(frozen=True, slots=True)
class BlockReadings:
    """What was read, means over blocks: slopes y (n, 2) and depth / h (n,), mm, at the points of rest.

    variance: (n, 2) of one node's slopes. used: (n,) blocks.
    """

    slope: Float
    ratio: Float
    variance: Float
    used: Mask


@dataclass(frozen=True, slots=True)
class Linear:
    """Weights of a constant, mm: of_ratio (n,) . (D / h) - of_slope (n, 2) . y."""

    of_ratio: Float
    of_slope: Float

    def __call__(self, read: BlockReadings) -> float:
        """The constant of a reading."""
        return float(self.of_ratio @ read.ratio) - float((self.of_slope * read.slope).sum())


@dataclass(frozen=True, slots=True)
class OfBody:
    """The constant as one body has it, its variance, mm^2, and that body's evidence, nats.

    variances: (loads,) of all possible loads. others: as bodies have it that are one standard deviation away.
    """

    constant: Linear
    variance: float
    evidence: float
    variances: Float
    others: tuple[Linear, ...]


@dataclass(frozen=True, slots=True)
class Learned:
    """The constant as all bodies have it that the rubber may be. used: blocks that it was learned with."""

    bodies: tuple[OfBody, ...]
    used: Mask

    def of(self, read: BlockReadings) -> tuple[float, float]:
        """(constant, its standard deviation) of a reading, mm."""
        share = np.array([body.evidence for body in self.bodies])
        share = np.exp((share - share.max()) / _UNSURE)
        share /= share.sum()
        values = np.array([body.constant(read) for body in self.bodies])
        variances = [
            body.variance + sum((other(read) - value) ** 2 for other in body.others)
            for body, value in zip(self.bodies, values, strict=True)
        ]
        mean = float(share @ values)
        return mean, float(np.sqrt(share @ (np.array(variances) + (values - mean) ** 2)))


class PossibleDents:
    """Dents of all possible loads on one body, as the blocks of one view see them."""

    def __init__(self, body: Elastic, loads: Loads, blocks: Blocks, x_mm: Float, y_mm: Float) -> None:
        """x_mm, y_mm: (rows, cols) mirror points at rest."""
        self.body, self.loads = body, loads
        self._blocks, self._points = blocks, (x_mm, y_mm)

    @cached_property
    def fields(self) -> Float:
        """(3, blocks, loads) means of depth, and of slopes along x and y, 1/mm, of dents 1 mm deep."""
        (x, weight), (y, _) = (self._blocks.places(one) for one in self._points)
        out = np.empty((3, self._blocks.count, len(self.loads)))
        for start in range(0, len(self.loads), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            at = self.body.fields(x.ravel(), y.ravel(), self.loads[part]).reshape(3, *x.shape, -1)
            out[:, :, part] = np.einsum("kbpn,bp->kbn", at, weight, optimize=True)
        return out


class LoadConstant:
    """Finds the constant of depth by the loads that press, for one reader."""

    def __init__(
        self,
        candidates: Sequence[Callable[[], Candidate]],
        x_mm: Float,
        y_mm: Float,
        scale: Float,
        gradient: Float,
        correlation: Float,
    ) -> None:
        """x_mm, y_mm, scale h: (rows, cols) at rest; gradient of h (rows, cols, 2). correlation: of nodes' noise."""
        self._x, self._y, self._scale = x_mm, y_mm, scale
        self._candidates = candidates
        self._blocks = Blocks.of(x_mm.shape)
        along = [np.stack(np.gradient(one), axis=-1) for one in (x_mm, y_mm)]
        self._per_mm = np.linalg.inv(np.stack(along, axis=-2))
        of_scale = np.concatenate([gradient, 1.0 / scale[..., None]], axis=-1)
        means, _ = self._blocks.means(of_scale, np.ones(scale.shape, bool))
        self._gradient, self._inverse_scale = means[:, :2], means[:, 2]
        self._both_ways = np.concatenate([correlation[:0:-1], correlation])
        self._of_blocks = np.kron(*self._blocks.correlation(correlation))
        self._border = self._blocks.border(_RING)
        self.model = 0.0

    @cached_property
    def _dents(self) -> tuple[tuple[PossibleDents, tuple[PossibleDents, ...]], ...]:
        """Of each body that the rubber may be, and of the bodies beside it."""
        low, high = (np.array([edge(self._x), edge(self._y)]) for edge in (np.min, np.max))
        block_mm = float(np.sqrt(np.prod(high - low) / self._blocks.count))
        loads = possible_loads(low, high, block_mm)

        def of(body: Elastic) -> PossibleDents:
            return PossibleDents(body, loads, self._blocks, self._x, self._y)

        made = [candidate() for candidate in self._candidates]
        return tuple((of(one.body), tuple(of(other) for other in one.others)) for one in made)

    def blocks(
        self, slope: Float, variance: Float, depth: Float, x_mm: Float, y_mm: Float, island: Mask
    ) -> BlockReadings:
        """Means over blocks of what was read at nodes (rows, cols), moved back to the points of rest.

        slope, variance: (rows, cols, 2); where depth is 0.2 mm, its nodes lie as far from those of rest.
        """
        there = island[..., None]
        away = np.where(there, np.stack([x_mm - self._x, y_mm - self._y], axis=-1), 0.0)
        slope = np.where(there, slope, 0.0)
        nodes = np.einsum("...ij,...j->...i", self._per_mm, away)
        change = np.stack(np.gradient(slope, axis=(0, 1)), axis=-1)
        at_rest = slope - np.einsum("...ki,...i->...k", change, nodes)
        ratio = (depth - (slope * away).sum(axis=-1)) / self._scale
        values = np.concatenate([at_rest, ratio[..., None], np.where(there, variance, 0.0)], axis=-1)
        means, used = self._blocks.means(values, island)
        return BlockReadings(means[:, :2], means[:, 2], means[:, 3:], used)

    def learn(
        self, read: BlockReadings, variance: Float, island: Mask, linear: LinearIntegration,
        before: Learned | None = None,
    ) -> Learned:
        """Learn which loads press. variance: (rows, cols, 2) of the nodes' slopes; linear: of their integration."""
        ring = self._ring(read)
        count = np.maximum(self._blocks.sums(island.astype(np.float64)), 1.0)
        of_ring = self._blocks.spread(ring / count) * island
        of_view = self._scale**2 * island
        slope_weights = linear.slope_weights(of_view / of_view.sum() - of_ring / of_ring.sum(), 1e-2)
        sigma = np.sqrt(np.where(island[..., None], variance, 0.0))
        noise = sigma * slope_weights
        for axis in (0, 1):
            noise = correlate1d(noise, self._both_ways, axis=axis, mode="constant")
        shared = self._blocks.sums(sigma * noise) / count[:, None]
        open_mm2 = float((sigma * slope_weights * noise).sum())
        starts = [None] * len(self._dents) if before is None else [body.variances for body in before.bodies]
        found = [
            self._of_body(dents, others, read, ring, shared, open_mm2, start)
            for (dents, others), start in zip(self._dents, starts, strict=True)
        ]
        return Learned(tuple(found), read.used)

    def _ring(self, read: BlockReadings) -> Float:
        """(blocks,) weights of the border, larger where it is flat."""
        ring = self._border & read.used
        ring = ring if np.count_nonzero(ring) >= _LEAST_RING else read.used
        steep2 = (read.slope**2).sum(axis=1) + 4.0 * read.variance.sum(axis=1)
        weights = np.where(ring, 1.0 / np.maximum(steep2, 1e-30), 0.0)
        return np.asarray(weights / weights.sum())

    def _of_body(
        self, dents: PossibleDents, others: Sequence[PossibleDents], read: BlockReadings, ring: Float,
        shared: Float, open_mm2: float, start: Float | None,
    ) -> OfBody:  # fmt: skip
        used = read.used
        gradient = self._gradient[used].T.ravel()
        z = read.slope[used].T.ravel() - float(ring @ read.ratio) * gradient
        of_blocks = self._of_blocks[np.ix_(used, used)]
        sigma = np.sqrt(read.variance[used]).T
        noise = of_blocks * np.outer(sigma[0], sigma[0]), of_blocks * np.outer(sigma[1], sigma[1])
        phi, m = self._seen(dents, ring, used)
        white, variances = self._learned(phi, z, noise, np.tile((read.slope[used] ** 2).sum(axis=1), 2), dents.loads, start)
        loads = dents.loads
        self.gamma = variances
        gamma = spread_variances(variances, loads)

        def constant(a: Float) -> Linear:
            a = white.weights(a)
            of_slope = np.zeros((len(used), 2))
            of_slope[used] = a.reshape(2, -1).T
            return Linear(ring * (1.0 + float(a @ gradient)), of_slope)

        data, both = white(z), white(shared[used].T.ravel())
        found = posterior(white(phi), gamma, data, m, both, open_mm2)
        beside = []
        for other in others:
            phi, m = self._seen(other, ring, used)
            beside.append(constant(posterior(white(phi), gamma, data, m, both, open_mm2).weights))
        evidence = found.evidence - white.log_size - COST * np.count_nonzero(variances)
        return OfBody(constant(found.weights), found.variance, evidence, variances, tuple(beside))

    def _seen(self, dents: PossibleDents, ring: Float, used: Mask) -> tuple[Float, Float]:
        """(2 blocks, loads) what dents 1 mm deep make of z; (loads,) their mean depth / h in the ring."""
        depth, *slopes = dents.fields
        m = (ring * self._inverse_scale) @ depth
        gradient = self._gradient[used].T.ravel()
        return np.concatenate([one[used] for one in slopes]) - np.outer(gradient, m), m

    def _learned(
        self, phi: Float, z: Float, noise: tuple[Float, Float], slope2: Float, loads: Loads, start: Float | None
    ) -> tuple[Whitening, Float]:
        """The noise, with the error of the dents that is found, and the loads' variances."""
        noise2 = np.concatenate([np.diag(one) for one in noise])
        steep = slope2 > _STEEP**2 * noise2
        white = Whitening(noise, _MODEL**2 * slope2)
        seen, data = white(phi), white(z)
        gamma = learned_variances(seen, data, loads, start)
        if steep.any():
            pressing = gamma > 0.0
            some = seen[:, pressing]
            whole = np.eye(len(z)) + (some * gamma[pressing]) @ some.T
            left = white.back(np.linalg.solve(whole, data))
            error2 = 1.3 * float((left**2 - noise2)[steep].mean() / slope2[steep].mean())
            if error2 > _MODEL**2:
                white = Whitening(noise, min(error2, _MOST_MODEL**2) * slope2)
                gamma = learned_variances(white(phi), white(z), loads, gamma)
        return white, gamma
