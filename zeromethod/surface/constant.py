"""The constant of depth, from the loads on the rubber that explain the slopes.

Slopes give a depth D = d + C h, with h the integrator's scale (see `integrate`), and are read as y = grad d +
C grad h. The true depth is a sum of dents, d = sum p_j f_j, that loads make on the rig's rubber
(`zeromethod.mechanics.gaussian_load`), p_j ~ N(0, gamma_j). With w the weights of a ring at the view's border,
a0 = w.(D / h) and m_j = w.(f_j / h), C is no unknown of its own, C = a0 - m.p, and means over blocks of nodes obey

    z = y - a0 grad h = (grad f - grad h m^T) p + noise.

The posterior of m.p is linear in the slopes: learned once (`load_variances`), its weights serve many frames. What
is wanted is the mean over the view, whose noise against the ring's mean counts as well. Source: MacKay 1992,
Bayesian interpolation, doi:10.1162/neco.1992.4.3.415.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.ndimage import correlate1d

from zeromethod.arrays import Float, Mask
from zeromethod.mechanics.gaussian_load import Elastic, Loads
from zeromethod.mechanics.load_variances import learned_variances, spread_variances
from zeromethod.mechanics.possible_loads import possible_loads
from zeromethod.surface.blocks import Blocks
from zeromethod.surface.integrate import LinearIntegration

_RING = 0.2
"""Width of the ring over the view's shorter side."""
_MODEL = 1e-3
"""Error of fields by how blocks, shifts and body are modelled, over the slope: found again in each learning."""
_LEAST_MODEL, _MOST_MODEL = 1e-3, 0.1
_STEEP = 10.0
"""Slope over noise from which a block says how large that error is."""
_WEAK_MM = (0.0, 3e-6, 1e-5, 3e-5, 1e-4, 1e-3)
_WEAK_PRIOR = (0.5, 0.1, 0.1, 0.1, 0.1, 0.1)
"""Standard deviations of loads everywhere too weak to be found one by one, and their prior."""


@dataclass(frozen=True, slots=True)
class BlockReadings:
    """What was read, means over blocks: slopes y (n, 2) and depth / h (n,), mm, at the points of rest.

    variance: (n, 2) of one node's slopes. used: (n,) blocks.
    """

    slope: Float
    ratio: Float
    variance: Float
    used: Mask


@dataclass(frozen=True)
class Weights:
    """C = of_ratio . (D / h) - of_slope . y, its variance mm^2, and how well the loads explain what was learned from."""

    of_ratio: Float
    of_slope: Float
    variance: Float | float
    used: Mask
    chi2: float


class PossibleDents:
    """Dents of all possible loads on one body, as blocks of one view see them."""

    def __init__(self, body: Elastic, loads: Loads, blocks: Blocks, x_mm: Float, y_mm: Float) -> None:
        """x_mm, y_mm: (rows, cols) mirror points at rest."""
        self.body, self.loads = body, loads
        self._blocks, self._points = blocks, (x_mm, y_mm)

    @cached_property
    def fields(self) -> Float:
        """(3, blocks, loads) means of depth, and of slopes along x and y, 1/mm, of dents 1 mm deep."""
        (x, weight), (y, _) = (self._blocks.places(one) for one in self._points)
        out = np.empty((3, self._blocks.count, len(self.loads)))
        for start in range(0, len(self.loads), 128):
            part = slice(start, start + 128)
            some = Loads(self.loads.x_mm[part], self.loads.y_mm[part], self.loads.width_mm[part])
            at = self.body.fields(x.ravel(), y.ravel(), some).reshape(3, *x.shape, -1)
            out[:, :, part] = np.einsum("kbpn,bp->kbn", at, weight, optimize=True)
        return out


class LoadPosterior:
    """Learns which loads press by one body's dents, and from that the weights of the constant."""

    def __init__(
        self, dents: PossibleDents, gradient: Float, inverse_scale: Float, ring: Mask, correlation: tuple[Float, Float]
    ) -> None:
        """gradient (blocks, 2) of h, 1/mm; inverse_scale (blocks,) 1 / h; ring: blocks at the border."""
        self._dents, self._gradient, self._inverse_scale, self._ring = dents, gradient, inverse_scale, ring
        self._correlation = correlation

    def learn(self, read: BlockReadings, mixed: Float, open_mm2: float) -> tuple[Weights, float]:
        """Weights and the evidence, nats. mixed (blocks, 2), open_mm2: see `LoadConstant`."""
        used = read.used
        fields = self._dents.fields
        ring = self._weights(read)
        m = (ring * self._inverse_scale) @ fields[0]
        gradient = self._gradient[used].T.ravel()
        phi = np.concatenate([fields[1][used], fields[2][used]]) - np.outer(gradient, m)
        z = read.slope[used].T.ravel() - float(ring @ read.ratio) * gradient
        across = mixed[used].T.ravel()
        size2 = np.tile((read.slope[used] ** 2).sum(axis=1), 2)
        noise = self._noise(read)
        noise2 = np.concatenate([np.diag(one) for one in noise])
        model, gamma = _MODEL, None
        for again in (True, False):
            white = _Whitening(noise, model**2 * size2)
            seen, over, wanted = white(phi), white(z), white(across)
            gamma = learned_variances(seen, over, gamma)
            steep = size2 > _STEEP**2 * noise2
            if not (again and steep.any()):
                break
            left = z - white.explained(seen, gamma, over)
            found = np.sqrt(max(1.3 * float((left**2 - noise2)[steep].mean() / size2[steep].mean()), 0.0))
            found = min(max(found, _LEAST_MODEL), _MOST_MODEL)
            if found < model:
                break
            model = found
        assert gamma is not None
        self.gamma = gamma
        self.model = model
        loads = self._dents.loads
        gamma = spread_variances(gamma, loads.x_mm, loads.y_mm, loads.width_mm)
        a, var, chi2, evidence = _posterior(seen, gamma, over, m, wanted, open_mm2)
        a = white.back(a)
        evidence -= white.log_size
        of_slope = np.zeros((len(used), 2))
        of_slope[used] = a.reshape(2, -1).T
        # C = a0 - a.(y - a0 grad h)
        of_ratio = ring * (1.0 + float(a @ gradient))
        return Weights(of_ratio, of_slope, var, used, chi2), evidence

    def _noise(self, read: BlockReadings) -> tuple[Float, Float]:
        """Covariance of the slopes along x and along y of the used blocks."""
        of_blocks = np.kron(*self._correlation)[np.ix_(read.used, read.used)]
        sigma = np.sqrt(read.variance[read.used])
        return tuple(of_blocks * np.outer(s, s) for s in sigma.T)

    def _weights(self, read: BlockReadings) -> Float:
        """(blocks,) the ring's: by how flat it is."""
        ring = self._ring & read.used
        ring = ring if np.count_nonzero(ring) >= 16 else read.used
        steep2 = (read.slope**2).sum(axis=1) + 4 * read.variance.sum(axis=1)
        weights = np.where(ring, 1.0 / np.maximum(steep2, 1e-30), 0.0)
        return np.asarray(weights / weights.sum())


class _Whitening:
    """Turns data whose noise is correlated into data whose noise is white and of variance 1."""

    def __init__(self, noise: tuple[Float, Float], more: Float) -> None:
        """noise: covariances (n, n) of the first and the second half of the data; more: (2 n,) variances besides."""
        n = len(noise[0])
        self._roots = [
            np.linalg.cholesky(one + np.diag(part)) for one, part in zip(noise, (more[:n], more[n:]), strict=True)
        ]
        self.log_size = float(sum(np.log(np.diag(root)).sum() for root in self._roots))

    def __call__(self, values: Float) -> Float:
        """Of values (2 n, ...)."""
        halves = np.split(values, 2)
        return np.concatenate(
            [solve_triangular(r, h, lower=True, check_finite=False) for r, h in zip(self._roots, halves, strict=True)]
        )

    def back(self, weights: Float) -> Float:
        """Weights (2 n,) for the data of such for the white ones."""
        return np.concatenate(
            [
                solve_triangular(r, h, lower=True, trans=1, check_finite=False)
                for r, h in zip(self._roots, np.split(weights, 2), strict=True)
            ]
        )

    def explained(self, phi: Float, gamma: Float, data: Float) -> Float:
        """(2 n,) of the data before whitening that the loads explain."""
        used = gamma > 0.0
        some = phi[:, used]
        whole = np.eye(len(data)) + (some * gamma[used]) @ some.T
        white = some @ (gamma[used] * (some.T @ np.linalg.solve(whole, data)))
        return np.concatenate([r @ h for r, h in zip(self._roots, np.split(white, 2), strict=True)])


def _posterior(
    phi: Float, gamma: Float, z: Float, m: Float, across: Float, open_mm2: float
) -> tuple[Float, float, float, float]:
    """Weights (data,) of the white data in m.p, its variance, chi2 and evidence, weak loads everywhere mixed in."""
    some = gamma > 0.0
    whole = np.eye(len(z)) + (phi[:, some] * gamma[some]) @ phi[:, some].T
    everywhere = phi @ phi.T
    found = []
    for weak, prior in zip(_WEAK_MM, _WEAK_PRIOR, strict=True):
        all_gamma = gamma + weak**2
        factor = cho_factor(whole + weak**2 * everywhere, check_finite=False)
        a = cho_solve(factor, phi @ (all_gamma * m) - across, check_finite=False)
        chi2 = float(z @ cho_solve(factor, z, check_finite=False))
        evidence = np.log(prior) - 0.5 * chi2 - float(np.log(np.diag(factor[0])).sum())
        # of what is left when these weights are applied: sums of squares, where a difference would lose all digits
        var = float(all_gamma @ (m - a @ phi) ** 2 + a @ a + 2 * across @ a) + open_mm2
        found.append((evidence, a, var, chi2))
    evidences, weights, variances, chi2s = (np.array(one) for one in zip(*found, strict=True))
    share = np.exp(evidences - evidences.max())
    total = float(evidences.max() + np.log(share.sum()))
    share /= share.sum()
    means = weights @ z
    variance = float(share @ (variances + (means - means @ share) ** 2))
    return share @ weights, variance, float(share @ chi2s), total


class LoadConstant:
    """Finds the constant of depth by the loads that press, for one reader."""

    def __init__(
        self, bodies: Sequence[Elastic], x_mm: Float, y_mm: Float, scale: Float, gradient: Float, correlation: Float
    ) -> None:
        """x_mm, y_mm, scale h: (rows, cols) at rest; gradient of h (rows, cols, 2). correlation: of noise of nodes."""
        self._blocks = Blocks.of(x_mm.shape)
        self._correlation = np.concatenate([correlation[:0:-1], correlation])
        self._scale = scale
        self._x, self._y = x_mm, y_mm
        along = [np.stack(np.gradient(one), axis=-1) for one in (x_mm, y_mm)]
        self._per_mm = np.linalg.inv(np.stack(along, axis=-2))
        everywhere = np.ones(scale.shape, bool)
        both = np.concatenate([gradient, 1 / scale[..., None]], axis=-1)
        of_scale, _ = self._blocks.means(both, everywhere)
        sizes = [np.ptp(one) for one in (x_mm, y_mm)]
        block_mm = float(np.sqrt(sizes[0] * sizes[1] / self._blocks.count))
        low, high = np.array([x_mm.min(), y_mm.min()]), np.array([x_mm.max(), y_mm.max()])
        loads = possible_loads(low, high, block_mm)
        ring = self._border()
        self._posteriors = [
            LoadPosterior(PossibleDents(body, loads, self._blocks, x_mm, y_mm), of_scale[:, :2], of_scale[:, 2], ring, self._blocks.correlation(correlation))
            for body in bodies
        ]
        self.weights: Weights | None = None

    def _border(self) -> Mask:
        rows, cols = len(self._blocks.first_row), len(self._blocks.first_col)
        width = max(round(_RING * min(rows, cols)), 1)
        inner = np.ones((rows, cols), bool)
        inner[width:-width, width:-width] = False
        return inner.ravel()

    def blocks(self, slope: Float, variance: Float, depth: Float, x_mm: Float, y_mm: Float, island: Mask) -> BlockReadings:
        """Means over blocks, moved back to the points of rest."""
        away = np.stack([x_mm - self._x, y_mm - self._y], axis=-1)
        away = np.where(island[..., None], away, 0.0)
        there = np.where(island[..., None], slope, 0.0)
        nodes = np.einsum("...ij,...j->...i", self._per_mm, away)
        change = np.stack(np.gradient(there, axis=(0, 1)), axis=-1)
        moved = there - np.einsum("...ki,...i->...k", change, nodes)
        flat = (depth - (there * away).sum(axis=-1)) / self._scale
        values = np.concatenate([moved, flat[..., None], np.where(island[..., None], variance, 0.0)], axis=-1)
        means, used = self._blocks.means(values, island)
        return BlockReadings(means[:, :2], means[:, 2], means[:, 3:], used)

    def find(
        self, read: BlockReadings, node_variance: Float, island: Mask, linear: LinearIntegration
    ) -> tuple[float, float]:
        """(C, its sigma), mm, learned anew."""
        ring = self._posteriors[0]._weights(read)
        count = self._blocks.sums(island.astype(float))
        of_node = self._spread(ring / np.maximum(count, 1.0)) * island
        wanted = np.where(island, self._scale**2, 0.0)
        wanted = wanted / wanted.sum() - of_node / of_node.sum()
        slope_weights = linear.slope_weights(wanted, 1e-2)
        sigma = np.sqrt(np.where(island[..., None], node_variance, 0.0))
        noise = sigma * slope_weights
        for axis in (0, 1):
            noise = correlate1d(noise, self._correlation, axis=axis, mode="constant")
        mixed = self._blocks.sums(sigma * noise) / np.maximum(count, 1.0)[:, None]
        open_mm2 = float((sigma * slope_weights * noise).sum())
        found = [posterior.learn(read, mixed, open_mm2) for posterior in self._posteriors]
        share = np.array([evidence for _, evidence in found])
        share = np.exp(share - share.max())
        share /= share.sum()
        values = np.array([constant(weights, read) for weights, _ in found])
        mean = float(share @ values)
        variance = float(share @ (np.array([w.variance for w, _ in found]) + (values - mean) ** 2))
        self.weights = found[int(np.argmax(share))][0]
        return mean, float(np.sqrt(max(variance, 0.0)))

    def _spread(self, of_blocks: Float) -> Float:
        rows, cols = len(self._blocks.first_row), len(self._blocks.first_col)
        sizes = [np.diff(np.append(f, n)) for f, n in zip((self._blocks.first_row, self._blocks.first_col), self._blocks.shape)]
        return np.repeat(np.repeat(of_blocks.reshape(rows, cols), sizes[0], axis=0), sizes[1], axis=1)


def constant(weights: Weights, read: BlockReadings) -> float:
    """C, mm, of a reading with weights."""
    return float(weights.of_ratio @ read.ratio) - float((weights.of_slope * read.slope).sum())
