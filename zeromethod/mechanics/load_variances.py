"""Variances of many possible loads, each its own, by the evidence of what was seen.

Data t = Phi p + n, n white and of variance 1, p_j ~ N(0, gamma_j): most gamma are 0 where the evidence is
largest. The loads that gain most are added, all that are used are estimated again, and so on until nothing
gains. What touches rubber pushes and does not pull: a load of negative pressure is taken only where others
press more than it pulls.
Source: Tipping & Faul 2003, Fast marginal likelihood maximisation for sparse Bayesian models, AISTATS.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Ints
from zeromethod.mechanics.gaussian_load import Loads

COST = 2.0
"""Nats that another load must gain besides: of neighbours in place and width some seven look nearly alike."""
_GAIN = 0.1
"""Nats below which a change is not worth its time."""
_MOST_ROUNDS = 40
"""More than nearly all readings need that loads explain (`benchmarks.anchors`); where they do not, as beside
dirt, rounds would go on and on, and what is left counts as the model's error."""
_AT_ONCE, _ALIKE = 24, 0.3
"""Loads of which those apart are added together; largest cosine between what two of these look like."""
_NONE = 1e30
"""One over the variance, 1/mm^2, of a load that is taken away."""


def learned_variances(phi: Float, data: Float, loads: Loads, start: Float | None = None) -> Float:
    """(loads,) variances gamma, mm^2.

    phi: (data, loads), 1/mm, data: (data,), both over the noise's standard deviation. start: from earlier.
    """
    gamma = np.zeros(len(loads)) if start is None else start.copy()
    own, met = np.einsum("nj,nj->j", phi, phi), data @ phi
    own[own == 0.0] = 1.0  # dents that end before the view: nothing is seen of them
    used: Ints = np.flatnonzero(gamma)
    with_used, pressed_by = phi.T @ phi[:, used], _pressure(loads, used)
    for _ in range(_MOST_ROUNDS):
        changed = _estimate_again(gamma, with_used[used], met[used], used, pressed_by[used])
        if not gamma[used].all():
            kept = gamma[used] > 0.0
            used, with_used, pressed_by = used[kept], with_used[:, kept], pressed_by[:, kept]
        spread = np.linalg.inv(with_used[used] + np.diag(1.0 / gamma[used]))
        means = spread @ met[used]
        s = np.maximum(own - np.einsum("ja,ja->j", with_used @ spread, with_used), 1e-9 * own)
        q = met - with_used @ means
        # pressure over that of a load 1 mm deep and 1 mm wide
        pulls_freely = pressed_by @ means * loads.width_mm < -q / s
        wanted = np.where(pulls_freely, 0.0, np.maximum((q**2 - s) / s**2, 0.0))
        wanted[used] = 0.0
        more = _apart(phi, own, _evidence(wanted, s, q) - COST)
        if not len(more) and changed < _GAIN:
            break
        gamma[more] = wanted[more]
        used = np.append(used, more)
        with_used = np.column_stack([with_used, phi.T @ phi[:, more]])
        pressed_by = np.column_stack([pressed_by, _pressure(loads, more)])
    return gamma


def _pressure(loads: Loads, by: Ints) -> Float:
    """(loads, by) pressure in each load's middle by others 1 mm deep, over that of one 1 mm wide."""
    apart2 = (
        np.subtract.outer(loads.x_mm, loads.x_mm[by]) ** 2
        + np.subtract.outer(loads.y_mm, loads.y_mm[by]) ** 2
    )
    return np.asarray(np.exp(-0.5 * apart2 / loads.width_mm[by] ** 2) / loads.width_mm[by])


def _apart(phi: Float, own: Float, gains: Float) -> Ints:
    """Loads that gain most, and look so different that each gains nearly the same beside the others."""
    best: list[int] = []
    for load in np.argsort(gains)[:-_AT_ONCE:-1]:
        if gains[load] < max(_GAIN, 0.5 * gains[best[0]] if best else 0.0):
            break
        alike = np.abs(phi[:, load] @ phi[:, best]) / np.sqrt(own[load] * own[best])
        if not best or alike.max() < _ALIKE:
            best.append(int(load))
    return np.array(best, dtype=np.intp)


def _estimate_again(gamma: Float, products: Float, met: Float, used: Ints, pressed_by: Float) -> float:
    """Estimate the variances of all loads that are used once more, one after the other; nats gained.

    products (n, n), met (n,): of their columns with each other and with the data.
    """
    gained = 0.0
    if not len(used):
        return gained
    spread = np.linalg.inv(products + np.diag(1.0 / gamma[used]))
    for k, load in enumerate(used):
        means = spread @ met
        # without the load's own share
        s, q = 1.0 / spread[k, k] - 1.0 / gamma[load], means[k] / spread[k, k]
        pulls = means[k] < 0.0 and pressed_by[k] @ means < 0.0
        wanted = 0.0 if pulls else max((q**2 - s) / s**2, 0.0) if s > 0.0 else gamma[load]
        gain = float(_evidence(wanted, s, q) - _evidence(gamma[load], s, q)) + (
            COST if wanted == 0.0 else 0.0
        )
        if gain < _GAIN and not pulls:
            continue
        gained += abs(gain)
        step = (1.0 / wanted if wanted else _NONE) - 1.0 / gamma[load]
        spread -= np.outer(spread[:, k], spread[k]) * (step / (1.0 + step * spread[k, k]))
        gamma[load] = wanted
    return gained


def _evidence(gamma: Float | float, s: Float | float, q: Float | float) -> Float:
    """Nats of each load's own part: 1/2 (q^2 gamma / (1 + gamma s) - ln(1 + gamma s))."""
    grown = 1.0 + gamma * s
    return np.asarray(0.5 * (gamma * q**2 / grown - np.log(grown)))


def spread_variances(gamma: Float, loads: Loads) -> Float:
    """Variances shared out among neighbours in place and width, the whole kept.

    Without it the posterior is as sure as if the few loads that are used were all that there can be.
    """
    used: Ints = np.flatnonzero(gamma)
    wide = np.log(loads.width_mm)
    apart2 = (
        np.subtract.outer(loads.x_mm, loads.x_mm[used]) ** 2
        + np.subtract.outer(loads.y_mm, loads.y_mm[used]) ** 2
    )
    reach2 = (_REACH * np.maximum.outer(loads.width_mm, loads.width_mm[used])) ** 2
    near = np.exp(-0.5 * apart2 / reach2 - 0.5 * (np.subtract.outer(wide, wide[used]) / _OCTAVES) ** 2)
    near /= near.sum(axis=0)
    return np.asarray((1.0 - _SHARED) * gamma + _SHARED * (near @ gamma[used]))


_SHARED = 0.02
"""Part of each variance that its neighbours take: sigma is then as large as errors (`benchmarks.anchors`)."""
_REACH, _OCTAVES = 0.8, 0.5
"""How far neighbours reach, over the wider one's width and in the logarithm of the widths."""
