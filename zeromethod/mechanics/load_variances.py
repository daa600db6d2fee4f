"""Variances of many possible loads, each its own, by the evidence of what was seen.

Data t = Phi p + n, n white and of variance 1, p_j ~ N(0, gamma_j): most gamma are 0 where the evidence is largest.
The load that gains most is added, all that are used are estimated again, and so on until nothing gains. Source:
Tipping & Faul 2003, Fast marginal likelihood maximisation for sparse Bayesian models, AISTATS.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Ints

_COST = 2.0
"""Nats that another load must gain besides: of neighbours in place and width some seven look nearly alike."""
_GAIN = 0.1
"""Nats below which a change is not worth its time."""
_MOST_ROUNDS = 100


def learned_variances(phi: Float, data: Float, start: Float | None = None) -> Float:
    """(loads,) variances gamma.

    phi: (data, loads), data: (data,), both over the noise's standard deviation. start: variances to begin with.
    """
    gamma = np.zeros(phi.shape[1]) if start is None else start.copy()
    own, met = np.einsum("nj,nj->j", phi, phi), data @ phi
    used = list(np.flatnonzero(gamma))
    with_used = phi.T @ phi[:, used]
    for _ in range(_MOST_ROUNDS):
        at: Ints = np.array(used, dtype=np.intp)
        changed = _estimate_again(gamma, with_used[at], met[at], at)
        if not gamma[at].all():
            kept = gamma[at] > 0.0
            used, with_used, at = list(at[kept]), with_used[:, kept], at[kept]
        spread = np.linalg.inv(with_used[at] + np.diag(1.0 / gamma[at]))
        s = own - np.einsum("ja,ja->j", with_used @ spread, with_used)
        q = met - with_used @ (spread @ met[at])
        s[at], q[at] = 1.0, 0.0
        s = np.maximum(s, 1e-9 * own)
        wanted = np.maximum((q**2 - s) / s**2, 0.0)
        gains = _evidence(wanted, s, q) - _COST
        best = int(np.argmax(gains))
        if gains[best] < _GAIN:
            if changed < _GAIN:
                break
            continue
        gamma[best] = wanted[best]
        used.append(best)
        with_used = np.column_stack([with_used, phi[:, best] @ phi])
    return gamma


def _estimate_again(gamma: Float, products: Float, met: Float, used: Ints) -> float:
    """Estimate the variances of all loads that are used once more, one after the other; nats gained.

    products (n, n), met (n,): of their columns with each other and with the data.
    """
    gained = 0.0
    if not len(used):
        return gained
    spread = np.linalg.inv(products + np.diag(1.0 / gamma[used]))
    for k, load in enumerate(used):
        mean = spread[k] @ met
        # without the load's own share
        s, q = 1.0 / spread[k, k] - 1.0 / gamma[load], mean / spread[k, k]
        wanted = max((q**2 - s) / s**2, 0.0) if s > 0.0 else gamma[load]
        gain = float(_evidence(wanted, s, q) - _evidence(gamma[load], s, q)) + (_COST if wanted == 0.0 else 0.0)
        if gain < _GAIN:
            continue
        gained += gain
        step = (1.0 / wanted if wanted else _NONE) - 1.0 / gamma[load]
        spread -= np.outer(spread[:, k], spread[k]) * (step / (1.0 + step * spread[k, k]))
        gamma[load] = wanted
    return gained


_NONE = 1e30
"""One over the variance, 1/mm^2, of a load that is taken away."""


def _evidence(gamma: Float, s: Float, q: Float) -> Float:
    """Nats of each load's own part: 1/2 (q^2 gamma / (1 + gamma s) - ln(1 + gamma s))."""
    grown = 1.0 + gamma * s
    return np.asarray(0.5 * (gamma * q**2 / grown - np.log(grown)))


def spread_variances(gamma: Float, x_mm: Float, y_mm: Float, width_mm: Float) -> Float:
    """Variances shared out among neighbours in place and width, the whole kept.

    Without it the posterior is as sure as if the few loads that are used were all that there can be.
    """
    used: Ints = np.flatnonzero(gamma)
    wide = np.log(width_mm)
    apart2 = (x_mm[:, None] - x_mm[used]) ** 2 + (y_mm[:, None] - y_mm[used]) ** 2
    reach2 = (_REACH * np.maximum(width_mm[:, None], width_mm[used])) ** 2
    near = np.exp(-0.5 * apart2 / reach2 - 0.5 * ((wide[:, None] - wide[used]) / _OCTAVES) ** 2)
    near /= near.sum(axis=0)
    return np.asarray((1.0 - _SHARED) * gamma + _SHARED * (near @ gamma[used]))


import os
_SHARED = float(os.environ.get("SH","0.03"))
"""Part of each variance that its neighbours take."""
_REACH, _OCTAVES = 0.8, 0.5
"""How far neighbours reach, over the wider one's width and in the logarithm of the widths."""
