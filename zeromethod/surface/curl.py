"""Curl test: whether slopes read under a press contain what no depth of the mirror can make.

Three of the six modes of rigid motion look like a stiff displacement of the mirror; the others leave steps
from node to node that do not close. Those that are left over by the integration are compared with what each
mode leaves over, with the integration's own weights. An error of the anchor's constant moves the mirror along
its rays and leaves steps as well: it is fitted with them and given up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.watch import LEAST_LCD_PX
from zeromethod.surface.differences import depth_differences_adjoint
from zeromethod.surface.integrate import SlopeIntegrator, share_changed
from zeromethod.surface.node_passes import sum_on
from zeromethod.surface.noise import SlopeNoise
from zeromethod.surface.settling import Reading

MOVED_STATISTIC = 5.0
"""Curl over its sigma (rms of its components) from which the bench counts as moved."""

_UNKNOWN_GEOMETRY = 0.01
"""False motion by a geometry that is not exactly known, over the rms shift of the warp by the press."""

_MOST_VISIBLE = 3
"""Six modes less the three that a stiff displacement of the mirror makes as well."""

_LIKELY_LCD_PX = 1.0
"""Motion of the size that happens: what is known worse than this is left out of the motion found."""

_VISIBLE = 1e-3
"""Curl energy of a combination of modes, over the largest, from which it counts as visible."""

_SOLVED = 1e-6
"""Error of the modes' depths, relative."""

_KEEP_SHARE, _KEEP_FACTOR = 0.05, 4.0
"""Templates are kept while the mask differs on fewer nodes than this share, and while under new weights noise
changed by more than this factor, relative to all others', on fewer: they are orthogonal to every depth
whatever the weights, and their covariance is that of the noise but for a few percent."""


@dataclass(frozen=True, slots=True)
class Curl:
    """Rigid motion found under a press.

    statistic: over its sigma, per component, with a fifth of `LEAST_LCD_PX` in it. motion: (modes,) LCD px,
    the least motion that explains it, a sum of `zeromethod.bench_motion.modes.BenchModes`. seen: (modes,
    sums) orthonormal sums of modes that show at all. teeth: which tooth of a saw is not as the rig file says,
    in words; "" where none is seen.
    """

    statistic: float
    motion: Float
    seen: Float
    teeth: str = ""

    @property
    def moved(self) -> bool:
        """Whether the bench moved, or is another one."""
        return bool(self.teeth) or self.statistic > MOVED_STATISTIC


@dataclass(frozen=True, slots=True)
class _Templates:
    """What was worked out for a mask (rows, cols), variance (rows, cols, 2) and weights, by their number.

    across, down: (terms, ...) weighted steps left over by each visible combination, the constant last.
    inverse: (terms, terms) from their products with the steps found to amplitudes. covariance: (visible,
    visible) of the amplitudes, for noise of variance `noise`. directions: (modes, visible). depth: (modes,
    rows, cols) mm of depth / h that 1 LCD px of each mode reads as.
    """

    mask: Mask
    variance: Float
    weighting: int
    across: Float
    down: Float
    inverse: Float
    covariance: Float
    noise: float
    directions: Float
    depth: Float

    def fit(self, island: Mask, weighting: int, variance: Float) -> bool:
        """Whether they may be kept for another mask, and other weights by this variance (rows, cols, 2)."""
        if np.count_nonzero(island ^ self.mask) > _KEEP_SHARE * np.count_nonzero(island):
            return False
        if self.weighting == weighting:
            return True
        both = np.repeat((island & self.mask).ravel(), 2)
        changed = share_changed(variance.ravel(), self.variance.ravel(), both, _KEEP_FACTOR)
        return bool(changed <= _KEEP_SHARE)


def _products(templates: Float, steps: Float, depth: Float, island: Mask, axis: int) -> Float:
    """Sum (terms,) of what depth lacks of the steps along an axis, on the island, times each template.

    Templates kept may have nodes lost since. In the same order whatever the number of threads, which products
    by BLAS are not.
    """
    there = island[:, 1:] & island[:, :-1] if axis else island[1:] & island[:-1]
    lacking = np.where(there, steps - np.diff(depth, axis=axis), 0.0)
    return np.asarray(np.einsum("kij,ij->k", templates, lacking))


class CurlTest:
    """Templates of the modes on one integrator's lattice, kept while its mask is the same or comes back."""

    def __init__(self, integrator: SlopeIntegrator, slopes: Float, constant: Float) -> None:
        """Slopes: (modes, rows, cols, 2) rad per LCD px that each mode reads as at rest.

        constant: (rows, cols, 2) rad per mm of an error of the anchor's constant, h d(slope)/d(depth).
        """
        self._integrator = integrator
        self._slopes, self._constant = slopes, constant
        self._made: _Templates | None = None
        self._earlier: _Templates | None = None

    def false_depth(self, motion: Float, noise: SlopeNoise, x_mm: Float, y_mm: Float) -> tuple[Float, Float]:
        """What a motion (modes,) LCD px reads as: depth / h, mm, up to a constant; slopes (rows, cols, 2)."""
        depth = np.tensordot(motion, self._templates(noise, x_mm, y_mm).depth, axes=1)
        return depth, np.tensordot(motion, self._slopes, axes=1)

    def test(self, read: Reading, noise: SlopeNoise, shift_px: float) -> Curl:
        """Test one reading, converged; shift_px: rms shift of the warp from rest, LCD px."""
        made = self._templates(noise, read.point[..., 0], read.point[..., 1])
        island = self._integrator.island
        across, down = read.steps
        products = _products(made.across, across, read.depth, island, 1)
        products += _products(made.down, down, read.depth, island, 0)
        found = (made.inverse @ products)[:-1]
        covariance = made.covariance * (self._mean_variance(noise) / made.noise)
        model_px = np.hypot(_UNKNOWN_GEOMETRY * shift_px, LEAST_LCD_PX / MOVED_STATISTIC)
        covariance = covariance + model_px**2 * np.eye(len(found))
        chi2 = float(found @ np.linalg.solve(covariance, found)) / max(len(found), 1)
        likely = np.linalg.solve(np.eye(len(found)) + covariance / _LIKELY_LCD_PX**2, found)
        return Curl(float(np.sqrt(chi2)), made.directions @ likely, made.directions)

    def _mean_variance(self, noise: SlopeNoise) -> float:
        island = self._integrator.island
        return sum_on(noise.variance, island) / (2 * np.count_nonzero(island))

    def _templates(self, noise: SlopeNoise, x_mm: Float, y_mm: Float) -> _Templates:
        like = self._integrator.island, self._integrator.weighting, noise.variance
        if self._made is None or not self._made.fit(*like):
            self._made, self._earlier = self._earlier, self._made
        if self._made is None or not self._made.fit(*like):
            self._made = self._make(noise, x_mm, y_mm)
        self._made = replace(self._made, weighting=self._integrator.weighting)
        return self._made

    def _make(self, noise: SlopeNoise, x_mm: Float, y_mm: Float) -> _Templates:
        integrator, island = self._integrator, self._integrator.island
        weight_across, weight_down = integrator.step_weights
        slopes = np.where(island[..., None], np.nan_to_num([*self._slopes, self._constant]), 0.0)
        count = len(self._slopes)
        depth = np.stack([integrator.integrate(one, x_mm, y_mm, share=_SOLVED) for one in slopes])
        left = [
            integrator.left_over(integrator.steps(one, x_mm, y_mm), part)
            for one, part in zip(slopes, depth, strict=True)
        ]
        across, down = (np.stack(parts) for parts in zip(*left, strict=True))
        weighted = weight_across * across, weight_down * down
        gram = np.einsum("aij,bij->ab", weighted[0], across) + np.einsum("aij,bij->ab", weighted[1], down)
        values, vectors = np.linalg.eigh(gram[:count, :count])
        directions = vectors[:, values > _VISIBLE * values[-1]][:, -_MOST_VISIBLE:]
        combine = np.zeros((count + 1, directions.shape[1] + 1))
        combine[:count, :-1], combine[-1, -1] = directions, 1.0
        inverse = np.linalg.pinv(combine.T @ gram @ combine)
        across, down = (np.tensordot(combine.T, one, axes=1) for one in weighted)
        reach = depth_differences_adjoint(across, down, x_mm, y_mm, island)
        shared = noise.on(island).covariance(reach)
        covariance = inverse @ np.einsum("aijk,bijk->ab", reach, shared) @ inverse
        variance = self._mean_variance(noise)
        found = across, down, inverse, covariance[:-1, :-1], variance, directions, depth[:count]
        return _Templates(island.copy(), noise.variance, integrator.weighting, *found)
