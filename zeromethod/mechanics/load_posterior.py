"""What is known of a sum over loads from data in which they show: Gaussian loads of given variances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky

from zeromethod.arrays import Float

WEAK_MM = (0.0, 1e-5, 1e-4, 1e-3)
"""Standard deviations, mm, of loads everywhere that are too weak to be found one by one: from a frame's noise
to 1 µm, which would be found."""
_NONE_WEAK = 0.5
"""How likely it is before anything was seen that there are none; the others share the rest."""


@dataclass(frozen=True)
class Posterior:
    """Weights (data,) of the data in the sum, the sum's variance, and the evidence in nats.

    root: (data, data) lower root of the data's covariance with the likeliest weak loads.
    """

    weights: Float
    variance: float
    evidence: float
    root: Float


def posterior(
    phi: Float,
    gamma: Float,
    data: Float,
    of_loads: Float,
    shared: Float,
    open2: float,
    weak_mm: Sequence[float],
) -> Posterior:
    """Posterior of sum(of_loads p) - e, with data = phi p + n, n white of variance 1, p_j ~ N(0, gamma_j).

    phi: (data, loads). e: noise of variance open2 with covariance shared (data,) with n. weak_mm: as
    `WEAK_MM`, mixed by evidence.
    """
    some = gamma > 0.0
    whole = np.eye(len(data)) + (phi[:, some] * gamma[some]) @ phi[:, some].T
    everywhere = phi @ phi.T if any(weak_mm) else np.zeros_like(whole)
    prior = np.full(len(weak_mm), (1.0 - _NONE_WEAK) / max(len(weak_mm) - 1, 1))
    prior[0] = _NONE_WEAK
    found, roots = [], []
    for each_mm, likely in zip(weak_mm, prior, strict=True):
        of_all = gamma + each_mm**2
        root = cholesky(whole + each_mm**2 * everywhere, lower=True, check_finite=False)
        both = np.stack([phi @ (of_all * of_loads) - shared, data], axis=1)
        a, seen = cho_solve((root, True), both, check_finite=False).T
        evidence = float(np.log(likely) - 0.5 * data @ seen - np.log(np.diag(root)).sum())
        # of what is left with these weights: a sum of squares, where a difference would lose all digits
        variance = float(of_all @ (of_loads - a @ phi) ** 2 + a @ a + 2 * shared @ a) + open2
        # without loads noise is all that is seen, and known: 0 but for rounding
        found.append((evidence, a, max(variance, 0.0)))
        roots.append(root)
    evidences, weights, variances = (np.array(one) for one in zip(*found, strict=True))
    best = int(np.argmax(evidences))
    share = np.exp(evidences - evidences[best])
    whole_evidence = float(evidences[best] + np.log(share.sum()))
    share /= share.sum()
    sums = weights @ data
    variance = float(share @ (variances + (sums - share @ sums) ** 2))
    return Posterior(share @ weights, variance, whole_evidence, roots[best])
