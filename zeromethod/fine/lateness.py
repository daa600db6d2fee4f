"""Lateness of each frame's pictures against the log, from the frames themselves.

A picture that comes late shifts the seen phases of a whole frame by a known profile over its rows, a mirror
that stays does not. What the fit of all frames leaves over says by how much each came late. A lateness whose
sign changes with the steps' would look like a displacement, along u and along v; as the two carriers turn at
different times, none does along both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.fine.demodulate import Design
from zeromethod.fine.frames import Steps

LIKELY_S = 1e-3
"""Standard deviation of a lateness before anything was seen: more would be a wrong `latency_s`."""
_EVERY = 8
"""Every such row is looked at: the rest would add less than a microsecond."""


def lateness(images: Image, steps: Sequence[Steps], design: Design, noise_grey: float) -> Float:
    """(N,) seconds by which each frame's pictures came late; 0 where the target did not step.

    images: (N, rows, cols) grey levels. design: of these steps as logged. noise_grey: of a pixel.
    """
    count = len(steps)
    normal, right = np.eye(count) * (noise_grey / LIKELY_S) ** 2, np.zeros(count)
    for row in range(_EVERY // 2, images.shape[1], _EVERY):
        per_late = np.stack([one.per_late_rad[row] for one in steps])
        if not per_late.any():
            continue
        grey = images[:, row].astype(np.float64)
        basis, solution = design.basis[row], design.solution[row]
        unknowns = solution @ grey
        left = grey - basis @ unknowns
        # d/d(phase) of Re[C w] is Re[i C w]
        turned = np.zeros_like(grey)
        for axis in (0, 1):
            wave = basis[:, 1 + 2 * axis] - 1j * basis[:, 2 + 2 * axis]
            amplitude = unknowns[1 + 2 * axis] + 1j * unknowns[2 + 2 * axis]
            turned += per_late[:, axis, None] * np.real(1j * np.outer(wave, amplitude))
        normal += (turned @ turned.T) * (np.eye(count) - basis @ solution)
        right += (turned * left).sum(axis=1)
    return np.asarray(np.linalg.solve(normal, right))
