"""The sensing window: triangle = box * box, each exactly one period wide.

Weights w_k = (P - |k|) / P^2, |k| < P, sum 1, on each axis. Its transfer function has a *double* zero at
every harmonic of the carrier, so that neither the mean nor its gradient nor the carrier's harmonics reach
the residual (a single box leaks 0.135 px at a brightness gradient of 0.2 %/px).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float, Single


def triangle(period_px: int) -> Float:
    """(2 P - 1,) weights of the window along one axis, offsets -(P - 1) .. P - 1 px; sum 1."""
    offset = np.arange(1 - period_px, period_px)
    return (period_px - np.abs(offset)) / period_px**2


def sums_along(values: Single, taps: Single) -> Single:
    """Sums over windows of two periods every half period along the last axis: (m, ..., nodes).

    values: (..., px), in whole half periods. taps: (m, 2 P) weights; the first window begins at pixel 0.
    """
    count, half = len(taps), taps.shape[1] // 4
    quarters = taps.reshape(count, 4, half).swapaxes(0, 1).reshape(4 * count, half)
    # what each block of half a period adds to the four windows that share it
    parts = (quarters @ values.reshape(-1, half).T).reshape(4, count, *values.shape[:-1], -1)
    last = parts.shape[-1] - 3
    return np.asarray(sum(parts[k, ..., k : last + k] for k in range(4)))


def transfer(period_px: int, cycles_per_px: ArrayLike) -> Float:
    """Response of the residual (one axis) to a displacement of that frequency near null, 0..1.

    W(f) = (sin(pi f P) / (P sin(pi f)))^2; the two axes multiply. Modes with W near 0 are unobservable.
    """
    f = np.asarray(cycles_per_px, dtype=float)
    kernel = np.sinc(f * period_px) / np.sinc(f)
    return np.asarray(kernel**2)


def curvature_bias_px2(period_px: int) -> float:
    """Bias of one linear step per Laplacian of the displacement: (P^2 - 1) / 12, px^2.

    The measured d is the window's average of the phase, so that d_measured - d = (P^2 - 1)/12 x
    (d_uu + d_vv) + higher orders. It vanishes with d itself: at the null the loop has no such bias.
    """
    return (period_px**2 - 1) / 12


def carrier_power(period_px: int) -> Float:
    """(4,) sums of w_k^2 cos(2 pi n k / P) for n = 0..3: noise gain of the window along the carrier."""
    offset = np.arange(1 - period_px, period_px)
    turns = np.outer(np.arange(4), offset) / period_px
    return np.asarray(np.cos(2 * np.pi * turns) @ triangle(period_px) ** 2)
