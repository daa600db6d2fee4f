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
from zeromethod.fine.demodulate import BAND_ROWS, UNKNOWNS, Design, middle_grey
from zeromethod.fine.frames import Steps

LIKELY_S = 1e-3
"""Standard deviation of a lateness before anything was seen: more would be a wrong `latency_s`."""
_LEAST_JITTER_S = 1e-7
"""Standard deviation of a jitter that is not seen."""


@numba.njit(cache=True, fastmath={"contract", "reassoc"})
def _products(images: Image, level: float, solution: Single, of_each: Float, of_grey: Float) -> None:
    """Sums over each row of products of the unknowns (5, cols) with each other and with the grey levels."""
    count, rows, cols = images.shape
    unknowns, zero = np.empty((5, cols), np.float32), np.float32(level)
    for row in range(rows):
        unknowns[:] = np.float32(0.0)
        for t in range(count):
            line = images[t, row]
            for k in range(5):
                weight = solution[row, k, t]
                for i in range(cols):
                    unknowns[k, i] += weight * (np.float32(line[i]) - zero)
        for k in range(5):
            for m in range(5):
                total = np.float32(0.0)
                for i in range(cols):
                    total += unknowns[k, i] * unknowns[m, i]
                of_each[row, k, m] = total
            for t in range(count):
                line = images[t, row]
                total = np.float32(0.0)
                for i in range(cols):
                    total += unknowns[k, i] * (np.float32(line[i]) - zero)
                of_grey[row, k, t] = total


def lateness(images: Sequence[Image], steps: Sequence[Steps], design: Design, noise_grey: float) -> Float:
    """(N,) seconds by which each frame's pictures came late; 0 where the target did not step.

    images: (rows, cols) grey levels of each. design: of these steps as logged. noise_grey: of a pixel.
    """
    count, level = len(steps), middle_grey(images)
    normal, right = np.zeros((count, count)), np.zeros(count)
    for first in range(0, len(images[0]), BAND_ROWS):
        rows = slice(first, first + BAND_ROWS)
        band = np.stack([one[rows] for one in images])
        per_late = np.stack([one.per_late_rad[rows] for one in steps], axis=1)
        basis, solution = design.basis[rows], design.solution[rows]
        of_each = np.empty((len(basis), UNKNOWNS, UNKNOWNS))
        of_grey = np.empty((len(basis), UNKNOWNS, count))
        _products(band, level, solution.astype(np.float32), of_each, of_grey)
        # d/d(phase) of Re[C w] is Re[i C w]: of C = (c, s) and w = (p, -q), that is (-q) c - p s
        turned = np.zeros((len(basis), count, UNKNOWNS))
        turned[..., 1::2] = per_late * basis[..., 2::2]
        turned[..., 2::2] = -per_late * basis[..., 1::2]
        left_over = np.eye(count) - basis @ solution
        normal += ((turned @ of_each @ np.swapaxes(turned, 1, 2)) * left_over).sum(axis=0)
        right += (turned * (np.swapaxes(of_grey, 1, 2) - basis @ of_each)).sum(axis=(0, 2))
    if not normal.any():
        return right
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
