"""Far field of a dent: its depth where the view ends, from how slope and depth decay together.

A round dent whose depth is A r^-n exp(-k r^2 / 2) about its centre has the slope

    r dd/dr = -(n + k r^2) d:

n = 1, k = 0 is what any load leaves on a deep elastic body (Boussinesq; K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 3.2, doi:10.1017/CBO9781139171731), n = 0 a Gaussian's skirt. Depth D is read up to C
h, and then slope with C grad h, so that

    r . s - C r . grad h = -(n + k r^2) (D - C h)

gives C with n and k wherever slope is still measurable: weighted least squares of the left side, which
contains the noise, over the far field. Dents that decay differently (two of them, edges, surrounding bulges)
are recognised by the misfit, and by a different C from the outer half of the far field than from the whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask

_CORE_SHARE = 0.2
"""Depth over the largest at which the dent's core, which gives its centre, ends and the far field begins."""
_MODEL_SHARE = 0.1
"""Relative error of the law's slope that is allowed for at each node."""
_MOST_MISFIT = 2.0
_LEAST_NODES = 200
_MODEL_SIGMA = 2.0
"""Sigma per difference between the outer half's C and the whole's: that half may be wrong too."""
_SPAN = 6.0
_STEPS = 121


@dataclass(frozen=True, slots=True)
class FarField:
    """Multiple C of h, mm, by which depth was read too deep, and its standard deviation."""

    constant_mm: float
    sigma_mm: float


def centre_of(slope: Float, x_mm: Float, y_mm: Float, core: Mask) -> tuple[float, float] | None:
    """Point that the lines of steepest descent of the core's nodes pass closest to; None for parallel lines.

    Minimises sum |s x (p - c)|^2, which also works for a dent that is cut off by the view or has a hole.
    """
    sx, sy = slope[core].T
    cross = sx * y_mm[core] - sy * x_mm[core]
    normal = np.array([[(sy * sy).sum(), -(sx * sy).sum()], [-(sx * sy).sum(), (sx * sx).sum()]])
    if not np.linalg.det(normal) > 1e-3 * np.trace(normal) ** 2:
        return None
    x, y = np.linalg.solve(normal, [-(sy * cross).sum(), (sx * cross).sum()])
    return float(x), float(y)


def fit_far_field(
    slope: Float,
    variance: Float,
    depth_mm: Float,
    scale: Float,
    scale_gradient: Float,
    x_mm: Float,
    y_mm: Float,
    island: Mask,
    bound_mm: float,
    overlap: float,
) -> FarField | None:
    """Fit the law of the module to the nodes outside the dent's core; None where it does not apply.

    slope, variance, scale_gradient: (rows, cols, 2), rad, rad^2, 1/mm; depth_mm, scale, x_mm, y_mm: (rows,
    cols). bound_mm: approximate limit of |C|. overlap: number of nodes that share their noise.
    """
    size = np.where(island, np.abs(depth_mm), 0.0)
    core = size > _CORE_SHARE * size.max()
    centre = centre_of(slope, x_mm, y_mm, core)
    far = island & ~core
    if centre is None or np.count_nonzero(far) < _LEAST_NODES:
        return None
    away = np.stack([x_mm - centre[0], y_mm - centre[1]], axis=-1)[far]
    square = (away**2).sum(axis=-1)
    middle = float(np.median(square))
    outward = (slope[far] * away).sum(axis=-1)
    lift = (scale_gradient[far] * away).sum(axis=-1)
    D, h, q = depth_mm[far], scale[far], square / middle
    noise2 = (variance[far] * away**2).sum(axis=-1)
    columns = np.stack([outward, lift, D, h, q * D, q * h])
    weight = 1.0 / (noise2 + _MODEL_SHARE**2 * (D**2 + bound_mm**2))
    whole = _minimum((columns * weight) @ columns.T, bound_mm, overlap, len(D))
    outer = q > 1.0
    part = (columns[:, outer] * weight[outer]) @ columns[:, outer].T
    half = _minimum(part, bound_mm, overlap, int(np.count_nonzero(outer)))
    if whole is None or half is None:
        return None
    constant, sigma = whole
    return FarField(constant, float(np.hypot(sigma, _MODEL_SIGMA * (constant - half[0]))))


def _minimum(gram: Float, bound_mm: float, overlap: float, nodes: int) -> tuple[float, float] | None:
    """C of least misfit and its standard deviation; None where the law does not fit or C is out of range.

    gram: (6, 6) weighted products of outward slope, lift, D, h, q D, q h; n and k enter linearly, are never
    negative, and are eliminated for every C of a grid that closes in on the minimum.
    """
    low, high = -_SPAN * bound_mm, _SPAN * bound_mm
    for _ in range(4):
        trial = np.linspace(low, high, _STEPS)
        best = int(np.argmin(_misfit(gram, trial)))
        if best in {0, _STEPS - 1}:
            return None
        low, high = trial[best - 1], trial[best + 1]
    constant = float(trial[best])
    step = max(0.02 * abs(constant), 1e-6 * bound_mm)
    before, at, after = _misfit(gram, np.array([constant - step, constant, constant + step]))
    bend = (before + after - 2 * at) / (2 * step**2)
    if at > _MOST_MISFIT * nodes or not bend > 0.0:
        return None
    return constant, float(np.sqrt(overlap * max(at / nodes, 1.0) / bend))


def _misfit(gram: Float, constants: Float) -> Float:
    """Weighted sum of squares (m,) at each C with the best n, k >= 0."""
    combine = np.zeros((len(constants), 3, 6))
    combine[:, (0, 1, 2), (0, 2, 4)] = 1.0
    combine[:, (0, 1, 2), (1, 3, 5)] = -constants[:, None]
    g = combine @ gram @ combine.transpose(0, 2, 1)
    a, b, c, p, q = g[:, 1, 1], g[:, 1, 2], g[:, 2, 2], -g[:, 0, 1], -g[:, 0, 2]
    area = np.maximum(a * c - b * b, 1e-12 * a * c)
    n, k = (c * p - b * q) / area, (a * q - b * p) / area
    inside = (n >= 0.0) & (k >= 0.0)
    gain = np.where(inside, n * p + k * q, 0.0)
    alone = np.maximum(np.maximum(p, 0.0) ** 2 / a, np.maximum(q, 0.0) ** 2 / c)
    result: Float = g[:, 0, 0] - np.where(inside, gain, alone)
    return result
