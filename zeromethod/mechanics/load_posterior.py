"""What is known of a sum over loads from data in which they show: Gaussian loads of given variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from zeromethod.arrays import Float

WEAK_MM = (0.0, 1e-5, 1e-4, 1e-3)
"""Standard deviations, mm, of loads everywhere that are too weak to be found one by one: from a frame's noise
to 1 µm, which would be found."""
_NONE_WEAK = 0.5
"""How likely it is before anything was seen that there are none; the others share the rest."""
_EACH = 8
"""One in so many loads stands for all, where only sums over all of them are asked."""


@dataclass(frozen=True)
class Posterior:
    """Weights (data,) of the data in the sum, the sum's variance, and the evidence in nats.

    shares: of `WEAK_MM`, adding up to 1. by_others: variance by loads that were not there, all equally likely
    and deep, for each unit of chi2 that they add. root: (data, data) lower root of the data's covariance
    with the likeliest weak loads.
    """

    weights: Float
    variance: float
    evidence: float
    shares: Float
    by_others: float
    root: Float


def posterior(
    phi: Float,
    gamma: Float,
    data: Float,
    of_loads: Float,
    shared: Float,
    open2: float,
    shares: Float | None = None,
) -> Posterior:
    """Posterior of sum(of_loads p) - e, with data = phi p + n, n white of variance 1, p_j ~ N(0, gamma_j).

    phi: (data, loads). e: noise of variance open2 with covariance shared (data,) with n. shares: of `WEAK_MM`
    as found before; None: by evidence.
    """
    some = gamma > 0.0
    pressed = phi[:, some] * np.sqrt(gamma[some])
    # a matrix times its own transpose takes half the time of two
    whole = np.eye(len(data)) + pressed @ pressed.T
    asked = np.ones(len(WEAK_MM), bool) if shares is None else shares > 0.0
    everywhere = phi @ phi.T if asked[1:].any() else np.zeros_like(whole)
    prior = np.array([_NONE_WEAK, *[(1.0 - _NONE_WEAK) / (len(WEAK_MM) - 1)] * (len(WEAK_MM) - 1)])
    found, roots = [], []
    for each_mm, likely in zip(np.array(WEAK_MM)[asked], prior[asked], strict=True):
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
    odds = np.exp(evidences - evidences.max())
    share = odds / odds.sum() if shares is None else shares[asked]
    sums = weights @ data
    variance = float(share @ (variances + (sums - share @ sums) ** 2))
    all_shares = np.zeros(len(WEAK_MM))
    all_shares[asked] = share
    whole_evidence = float(evidences.max() + np.log(odds.sum()))
    mean, root = share @ weights, roots[int(np.argmax(share))]
    seen = solve_triangular(root, phi[:, ::_EACH], lower=True, check_finite=False)
    by_others = float(((of_loads - mean @ phi)[::_EACH] ** 2).sum() / (seen**2).sum())
    return Posterior(mean, variance, whole_evidence, all_shares, by_others, root)
