"""What is known of a sum over loads from data in which they show: Gaussian loads of given variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from zeromethod.arrays import Float

_WEAK_MM = (0.0, 3e-6, 1e-5, 3e-5, 1e-4, 1e-3)
"""Standard deviations, mm, of loads everywhere that are too weak to be found one by one: 3 nm, a tenth of a frame's
noise, to 1 µm, which would be found."""
_WEAK_PRIOR = (0.5, 0.1, 0.1, 0.1, 0.1, 0.1)
"""How likely each of them is before anything was seen."""


@dataclass(frozen=True)
class Posterior:
    """Weights (data,) of the data in the sum, the sum's variance, and the evidence in nats."""

    weights: Float
    variance: float
    evidence: float


def posterior(phi: Float, gamma: Float, data: Float, of_loads: Float, shared: Float, open2: float) -> Posterior:
    """Posterior of sum(of_loads p) - e, with data = phi p + n, n white of variance 1, p_j ~ N(0, gamma_j).

    phi: (data, loads). e: noise of variance open2 with covariance shared (data,) with n. Weak loads everywhere are mixed
    in as their evidence says.
    """
    some = gamma > 0.0
    whole = np.eye(len(data)) + (phi[:, some] * gamma[some]) @ phi[:, some].T
    everywhere = phi @ phi.T
    found = []
    for weak_mm, prior in zip(_WEAK_MM, _WEAK_PRIOR, strict=True):
        of_all = gamma + weak_mm**2
        factor = cho_factor(whole + weak_mm**2 * everywhere, check_finite=False)
        a = cho_solve(factor, phi @ (of_all * of_loads) - shared, check_finite=False)
        chi2 = float(data @ cho_solve(factor, data, check_finite=False))
        evidence = float(np.log(prior) - 0.5 * chi2 - np.log(np.diag(factor[0])).sum())
        # of what is left with these weights: a sum of squares, where a difference would lose all digits
        variance = float(of_all @ (of_loads - a @ phi) ** 2 + a @ a + 2 * shared @ a) + open2
        found.append((evidence, a, variance))
    evidences, weights, variances = (np.array(one) for one in zip(*found, strict=True))
    share = np.exp(evidences - evidences.max())
    whole_evidence = float(evidences.max() + np.log(share.sum()))
    share /= share.sum()
    sums = weights @ data
    variance = float(share @ (variances + (sums - share @ sums) ** 2))
    return Posterior(share @ weights, variance, whole_evidence)
