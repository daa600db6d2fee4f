"""Lateness of each frame's pictures against the log, from the frames themselves.

A picture that comes late shifts the seen phases of a whole frame by a known profile over its rows, a mirror
that stays, or moves steadily, does not. What the fit of all frames leaves over says by how much each came
late. A lateness whose sign changes with the steps' would look like a displacement, along u and along v; as
the two carriers turn at different times, none does along both.

Rows that are scanned more slowly than the rig file says come late in all frames alike, and more so the later
their turn: a panel at 59.94 Hz in place of 60 is 17 us late in its last row.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.fine.demodulate import UNKNOWNS, Design, middle_grey
from zeromethod.fine.frames import Steps
from zeromethod.fine.lattice import BAND_ROWS

LIKELY_S = 1e-3
"""Standard deviation of a lateness before anything was seen: more would be a wrong `latency_s`."""
_LEAST_JITTER_S = 1e-7
"""Standard deviation of a jitter that is not seen."""


def lateness(
    images: Sequence[Image],
    steps: Sequence[Steps],
    design: Design,
    noise_grey: float,
    scan: Float,
    box: tuple[slice, slice] | None = None,
) -> Float:
    """(N, rows) seconds by which each frame's pictures came late; 0 where the target did not step.

    images: (rows, cols) grey levels of each. design: of these steps as logged. noise_grey: of a pixel. scan:
    (rows,) places of the image's rows along the panel's columns, in a unit of their own. box: rows and
    columns that show the target alone; None for all.
    """
    count, level = len(steps), np.float32(middle_grey(images))
    # of each frame's lateness, and of that which goes with the place
    normal, right = np.zeros((2, 2, count, count)), np.zeros((2, count))
    down, across = box or (slice(0, len(images[0])), slice(None))
    for first in range(down.start, down.stop, BAND_ROWS):
        rows = slice(first, min(first + BAND_ROWS, down.stop))
        grey = np.stack([one[rows, across] for one in images], axis=1, dtype=np.float32, casting="unsafe")
        grey -= level
        per_late = np.stack([one.per_late_rad[rows] for one in steps], axis=1)
        basis, solution = design.basis[rows], design.solution[rows]
        # products of the unknowns (rows, 5, cols) with each other and with the grey levels, summed over a row
        unknowns = solution.astype(np.float32) @ grey
        of_each, of_grey = (unknowns @ np.swapaxes(by, 1, 2) for by in (unknowns, grey))
        # d/d(phase) of Re[C w] is Re[i C w]: of C = (c, s) and w = (p, -q), that is (-q) c - p s
        turned = np.zeros((len(basis), count, UNKNOWNS))
        turned[..., 1::2] = per_late * basis[..., 2::2]
        turned[..., 2::2] = -per_late * basis[..., 1::2]
        left_over = _left_over(basis)
        of_row = (turned @ of_each @ np.swapaxes(turned, 1, 2)) * left_over
        of_place = np.stack([np.ones(len(basis)), scan[rows]])
        normal += np.einsum("ar,br,rst->abst", of_place, of_place, of_row)
        right += of_place @ ((turned @ of_grey) * left_over).sum(axis=2)
    if not normal.any():
        return np.zeros((count, len(scan)))
    whole = np.block([[normal[0, 0], normal[0, 1].sum(axis=1, keepdims=True)],
                      [normal[0, 1].sum(axis=0, keepdims=True), normal[1, 1].sum()]])  # fmt: skip
    late = _likeliest(whole / noise_grey**2, np.append(right[0], right[1].sum()) / noise_grey**2)
    return np.asarray(late[:-1, None] + late[-1] * scan)


def _left_over(basis: Float) -> Float:
    """(rows, N, N) what unknowns of basis (rows, N, 5) leave over if all but the mean may change steadily."""
    count = basis.shape[1]
    steadily = basis[..., 1:] * np.linspace(-1.0, 1.0, count)[:, None]
    every = np.linalg.qr(np.concatenate([basis, steadily], axis=-1))[0]
    return np.asarray(np.eye(count) - every @ np.swapaxes(every, 1, 2))


def _likeliest(normal: Float, right: Float) -> Float:
    """Latenesses (N,), and that of the last rows against the first, s, by normal equations over noise^2.

    All may be late by the same, and each by a jitter that the scatter beyond their noise says.
    """
    count = len(right) - 1
    likely, each = np.diag([*np.zeros(count), LIKELY_S**2]), np.diag([*np.ones(count), 0.0])
    likely[:count, :count] = LIKELY_S**2
    jitter2 = LIKELY_S**2
    for _ in range(2):
        covariance = np.linalg.inv(normal + np.linalg.inv(likely + jitter2 * each))
        late = covariance @ right
        of_frames = covariance[:count, :count]
        noise2 = float(np.trace(of_frames) - of_frames.sum() / count) / (count - 1)
        jitter2 = max(float(late[:count].var(ddof=1)) - noise2, 0.0) + _LEAST_JITTER_S**2
    return np.asarray(late)
