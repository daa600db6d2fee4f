"""Steps of slope from tooth to tooth of a saw, which no mirror has: teeth are not as the rig file says.

A tooth whose faces are others shifts its part of the picture as a whole, in all rows alike. On either side of
a seam the slope, mean over rows, follows one polynomial; what it jumps by there besides is the teeth's. It is
the same in every frame, and known from those in which little presses near the seam, at rest above all.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.bench_motion.watch import FRAMES, LEAST_LCD_PX, SIGMAS
from zeromethod.optics import Optics
from zeromethod.optics.saw_rays import seams

_SIDE, _APART = 7, 2
"""Nodes on either side of a seam that a polynomial goes through, and nodes beside the seam, left out:
what is drawn there is continued from its own side."""
_DEGREE = 3
"""Of the polynomial. The step may be off by as much as slope changes on either side: behind the seam a press
may bend as much."""
_LEAST_ROWS = 0.3
"""Share of the rows that must be read on both sides: what presses on a seam is rarely as long as the view."""
_BESIDE = 0.3
"""Shift of another tooth, over the largest, from which it is not one tooth alone."""


@dataclass
class _Seam:
    """One seam: columns on either side, LCD px per rad there, and the sum of frames by inverse variance."""

    columns: Ints
    turn: Float
    weights: Float = field(default_factory=lambda: np.zeros(2))
    total: Float = field(default_factory=lambda: np.zeros(2))
    least2: Float = field(default_factory=lambda: np.full(2, np.inf))


class SeamSteps:
    """Mean steps at the seams of a grid's measurable nodes, in LCD px."""

    def __init__(
        self, optics: Optics, u: Float, v: Float, seam: Mask, sensitivity: Float, shared: float
    ) -> None:
        """u, v: (rows, cols) of the nodes; seam: those at seams at rest. sensitivity: LCD px per rad.

        shared: number of nodes that share their noise.
        """
        there = np.diff(np.concatenate([[0], seam.mean(axis=0) > 0.5, [0]]).astype(int))
        side = np.arange(_SIDE)
        runs = zip(np.flatnonzero(there > 0), np.flatnonzero(there < 0), strict=True)
        all_columns = [np.concatenate([a - _APART - _SIDE + side, b + _APART + side]) for a, b in runs]
        self._seams = [
            _Seam(one, np.nanmean(sensitivity[:, one], axis=(0, 1)))
            for one in all_columns
            if one[0] >= 0 and one[-1] < seam.shape[1]
        ]
        self._sensitivity, self._shared = sensitivity, shared
        middle = len(v) // 2
        self._teeth = np.stack(seams(optics, u[middle], v[middle])[1:])

    def forget(self) -> None:
        """Begin again: the zero was taken."""
        self._seams = [_Seam(one.columns, one.turn) for one in self._seams]

    def look(self, slope: Float, x_mm: Float, good: Mask, variance: Float) -> None:
        """Take in a nulled frame: slope and its variance (rows, cols, 2), and nodes that were measured."""
        for one in self._seams:
            rows: Mask = np.asarray(good[:, one.columns].all(axis=1))
            used = np.count_nonzero(rows)
            if used < _LEAST_ROWS * len(rows):
                continue
            share = rows / used
            x, mean, noise = (
                np.einsum("r,r...->...", share, np.nan_to_num(each[:, one.columns]))
                for each in (x_mm, slope, variance)
            )
            place = 2.0 * (x - x.mean()) / np.ptp(x)
            jump = np.where(np.arange(2 * _SIDE) < _SIDE, -0.5, 0.5)
            weights = np.linalg.pinv(np.column_stack([jump, np.vander(place, _DEGREE + 1)]))[0]
            of_mean2 = one.turn**2 @ noise.mean(axis=0) * self._shared / used
            noise2 = float(weights @ weights) * of_mean2
            seen = mean @ one.turn.T
            doubt2 = np.maximum(np.ptp(seen[:_SIDE], axis=0), np.ptp(seen[_SIDE:], axis=0)) ** 2
            one.weights += 1.0 / (noise2 + doubt2)
            one.total += weights @ seen / (noise2 + doubt2)
            one.least2 = np.minimum(one.least2, (noise2 + doubt2) / FRAMES)

    def _found(self) -> tuple[Float, Float]:
        """Steps (seams, 2), LCD px, and their variances; what a null has gathered stays for some frames."""
        weights, total, least2 = (
            np.array([getattr(one, name) for one in self._seams]).reshape(-1, 2)
            for name in ("weights", "total", "least2")
        )
        known = weights > 0.0
        steps = np.where(known, total / np.where(known, weights, 1.0), 0.0)
        return steps, np.where(known, np.maximum(1.0 / np.where(known, weights, 1.0), least2), 0.0)

    @property
    def words(self) -> str:
        """Which tooth is not as the rig file says, and by how much; "" where none is seen to be."""
        steps, variance = self._found()
        seen = (np.abs(steps) > LEAST_LCD_PX) & (steps**2 > SIGMAS**2 * variance)
        if not seen.any():
            return ""
        away = np.concatenate([np.zeros((1, 2)), np.cumsum(np.where(seen, steps, 0.0), axis=0)])
        away = np.linalg.norm(away - np.median(away, axis=0), axis=1)
        most = int(np.argmax(away))
        by = f"by {np.abs(steps).max():.2g} LCD px at a seam"
        # at the border of the view it may as well be all the others
        if most in (0, len(away) - 1) or np.count_nonzero(away > _BESIDE * away[most]) > 1:
            return f"the teeth are not as the rig file says: the picture jumps {by}"
        ends = [0, *(int(one.columns[_SIDE]) for one in self._seams), self._teeth.shape[1]]
        entry, leaving = np.median(self._teeth[:, ends[most] : ends[most + 1]], axis=1).astype(int)
        either = f"tooth {entry}'s face to the camera, or tooth {leaving}'s to the LCD"
        return f"{either}, is not as the rig file says: the picture jumps {by}"

    def error(self) -> Float | None:
        """Slope (rows, cols, 2), rad, of the steps so far, beyond twice their noise; None for none."""
        found, variance = self._found()
        steps = np.sign(found) * np.sqrt(np.maximum(found**2 - 4.0 * variance, 0.0))
        if not steps.any():
            return None
        # what all teeth have in common looks like drift, and is judged as that
        away = np.zeros((*self._sensitivity.shape[:2], 2))
        for one, step in zip(self._seams, steps, strict=True):
            away[:, one.columns[_SIDE] - _APART :] += step
        return np.asarray(
            np.linalg.solve(self._sensitivity, (away - np.median(away, axis=(0, 1)))[..., None])[..., 0]
        )
