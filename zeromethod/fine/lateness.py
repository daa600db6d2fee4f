"""Lateness of each frame's pictures against the log, from the frames themselves.

A picture that comes late shifts the seen phases of a whole frame by a known profile over its rows, a mirror
that stays does not. What the fit of all frames leaves over says by how much each came late. A lateness whose
sign changes with the steps' would look like a displacement, along u and along v; as the two carriers turn at
different times, none does along both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from zeromethod.arrays import Float, Image, Single
from zeromethod.fine.demodulate import UNKNOWNS, Design
from zeromethod.fine.frames import Steps

LIKELY_S = 1e-3
"""Standard deviation of a lateness before anything was seen: more would be a wrong `latency_s`."""
_LEAST_JITTER_S = 1e-7
"""Standard deviation of a jitter that is not seen."""


@numba.njit(cache=True, fastmath={"contract", "reassoc"})
def _products(
    images: Image, row: int, level: float, solution: Single, of_each: Float, of_grey: Float
) -> None:
    """Sums over a row of products of the unknowns (5, cols) with each other and with the grey levels."""
    count, cols = images.shape[0], images.shape[2]
    unknowns, zero = np.zeros((5, cols), np.float32), np.float32(level)
    for t in range(count):
        line = images[t, row]
        for k in range(5):
            weight = solution[k, t]
            for i in range(cols):
                unknowns[k, i] += weight * (np.float32(line[i]) - zero)
    for k in range(5):
        for m in range(5):
            total = np.float32(0.0)
            for i in range(cols):
                total += unknowns[k, i] * unknowns[m, i]
            of_each[k, m] = total
        for t in range(count):
            line = images[t, row]
            total = np.float32(0.0)
            for i in range(cols):
                total += unknowns[k, i] * (np.float32(line[i]) - zero)
            of_grey[k, t] = total


def lateness(images: Image, steps: Sequence[Steps], design: Design, noise_grey: float) -> Float:
    """(N,) seconds by which each frame's pictures came late; 0 where the target did not step.

    images: (N, rows, cols) grey levels. design: of these steps as logged. noise_grey: of a pixel.
    """
    count = len(steps)
    normal, right = np.zeros((count, count)), np.zeros(count)
    of_each, of_grey = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros((UNKNOWNS, count))
    level, single = float(images[:, ::64, ::64].mean()), design.solution.astype(np.float32)
    for row in range(images.shape[1]):
        per_late = np.array([one.per_late_rad[row] for one in steps])
        if not per_late.any():
            continue
        basis, solution = design.basis[row], design.solution[row]
        _products(images, row, level, single[row], of_each, of_grey)
        # d/d(phase) of Re[C w] is Re[i C w]: of C = (c, s) and w = (p, -q), that is (-q) c - p s
        turned = np.zeros((count, UNKNOWNS))
        for axis in (0, 1):
            re, im = 1 + 2 * axis, 2 + 2 * axis
            turned[:, re] = per_late[:, axis] * basis[:, im]
            turned[:, im] = -per_late[:, axis] * basis[:, re]
        normal += (turned @ of_each @ turned.T) * (np.eye(count) - basis @ solution)
        right += (turned * (of_grey.T - basis @ of_each)).sum(axis=1)
    return _likeliest(normal / noise_grey**2, right / noise_grey**2)


def _likeliest(normal: Float, right: Float) -> Float:
    """Latenesses (N,), s, by normal equations in units of their noise.

    All may be late by the same, and each by a jitter that the scatter beyond their noise says.
    """
    count = len(right)
    common = np.full((count, count), LIKELY_S**2)
    jitter2 = LIKELY_S**2
    for _ in range(2):
        prior = np.linalg.inv(common + jitter2 * np.eye(count))
        covariance = np.linalg.inv(normal + prior)
        late = covariance @ right
        noise2 = float(np.trace(covariance) - covariance.sum() / count) / (count - 1)
        jitter2 = max(float(late.var(ddof=1)) - noise2, 0.0) + _LEAST_JITTER_S**2
    return np.asarray(late)
