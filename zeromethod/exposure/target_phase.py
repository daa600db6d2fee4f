"""The phase of a moving target in one exposure, exactly known from what was lit.

Picture k shows the target shifted by s_k periods (`zeromethod.pattern.stepping`). Light adds up, so where all
pictures were drawn with one warp a carrier is seen as

    exp(i k x) Z,  Z = sum_k w_k exp(2 pi i s_k),

w_k the share of picture k in the light of the panel's row n. arg Z is the target's phase in that frame, |Z|
the share of its contrast that is left. If all was lit later than assumed by L, w_k changes by L dw_k / dL,
and with it the phase: a fit of many frames can solve for one L each.

Blur (lens, pixel, lit apertures) of variance s^2 mixes rows whose shares differ, and a carrier whose contrast
changes on its way is displaced by it: it is seen as Z + i s^2 (k . grad n) dZ/dn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.exposure.panel_rows import at_rows, places

Complex = NDArray[np.complex128]

LEAST_CONTRAST = 1e-3
"""Contrast below which the phase means nothing; of pictures half a period apart alone."""


class Sight(NamedTuple):
    """How the camera sees the panel's rows, in the middle of the view.

    rows: of the panel. upwards: it is scanned from its last row on. window_rows: over which half of a node's
    sensing window reaches. blur_rows: (2,) s^2 (k . grad n) of the two carriers.
    """

    rows: int
    upwards: bool
    window_rows: float
    blur_rows: Float

    @classmethod
    def of(
        cls, q: Float, period_px: int, diagonal: bool, panel: tuple[int, bool], blur: tuple[float, float]
    ) -> Sight:
        """Sight by the warp at rest; what a press changes of it is of no account.

        q: (rows, cols, 2) LCD px at nodes half a period apart. diagonal: the carriers are. panel: its rows,
        and whether it is scanned upwards. blur: variances, of lens and pixel in camera px^2 and of the lit
        apertures along the LCD's columns in LCD px^2.
        """
        j, i = q.shape[0] // 2, q.shape[1] // 2
        along_u, along_v = (
            np.median(q[:, i + 1] - q[:, i - 1], axis=0),
            np.median(q[j + 1] - q[j - 1], axis=0),
        )
        slope = np.stack([along_u, along_v], axis=-1) / period_px  # d(column, row) / d(u, v)
        of_row = np.linalg.inv(slope)[:, 1] if np.linalg.det(slope) else np.zeros(2)
        spread = blur[0] * slope[1] + blur[1] * of_row
        axes = np.array([[1.0, 1.0], [1.0, -1.0]]) if diagonal else np.eye(2)
        window_rows = float(np.hypot(*slope[1])) * period_px
        return cls(*panel, window_rows, 2 * np.pi / period_px * axes @ spread)


class Lit(NamedTuple):
    """The light of one exposure, picture by picture.

    turns: (k, 2) rad, each picture's phase along the two carriers. weights: (k, n) share of each at n panel
    rows, equally spaced in scan-out order. late_per_s: makes their change per second of lateness.
    """

    turns: Float
    weights: Float
    late_per_s: Callable[[], Float]


@dataclass(frozen=True, slots=True)
class TargetPhase:
    """Phase of the target's two carriers, along u and v (of a checker: along u + v and u - v).

    What lateness changes is worked out when it is asked for: no command waits for it.

    Convention: of a mirror at rest the camera sees a carrier as cos(2 pi u / P + rad), so `rad` is to be
    taken out of what was demodulated. whole: (n, 4) at n panel rows, equally spaced in scan-out order: rad of
    the two carriers, and share of their amplitude that is left, 0..1. diagonal: whether they are a checker's.
    at_nodes: (rows, cols, 4) where each node looks on the shown warp, in the mean over the sensing window:
    rad, and 1 / share. place: (rows, cols) the row of n there.
    """

    whole: Float
    diagonal: bool
    at_nodes: Float
    place: Float
    lit: Lit
    sight: Sight

    @classmethod
    def of(cls, lit: Lit, diagonal: bool, sight: Sight, shown_q: Float) -> TargetPhase:
        """Phase by the pictures lit, whose carriers are diagonal or not.

        shown_q: (rows, cols, 2) LCD px at which the nodes look.
        """
        count = lit.weights.shape[1]
        per_row = (count - 1) / (sight.rows - 1)
        phasors = _phasors(lit.weights, np.exp(1j * lit.turns), _signed_blur(sight, per_row))
        windowed = _polar(_averaged(phasors, sight.window_rows * per_row))
        windowed[:, 2:] = 1.0 / windowed[:, 2:]
        place = places(shown_q[..., 1], sight.rows, count, sight.upwards)
        return cls(_polar(phasors), diagonal, at_rows(windowed, place), place, lit, sight)

    @property
    def rad(self) -> Float:
        """(n, 2) at the panel rows, rad."""
        return self.whole[:, :2]

    @property
    def contrast(self) -> Float:
        """(n, 2) share of the carrier's amplitude that is left, 0..1."""
        return self.whole[:, 2:]

    @property
    def late_rad_per_s(self) -> Float:
        """(n, 2) change of `rad` per second by which all was lit later than assumed."""
        return self._late(0.0)

    @property
    def node_rad(self) -> Float:
        """(rows, cols, 2) as `rad`, where each node looks, in the mean over the sensing window."""
        return self.at_nodes[..., :2]

    @property
    def node_contrast(self) -> Float:
        """(rows, cols, 2) as `contrast`, where each node looks, in the mean over the sensing window."""
        return 1.0 / self.at_nodes[..., 2:]

    @property
    def node_late_rad_per_s(self) -> Float:
        """(rows, cols, 2) as `late_rad_per_s`, where each node looks, in the mean over the sensing window."""
        return at_rows(self._late(self.sight.window_rows), self.place)

    def _late(self, window_rows: float) -> Float:
        """(n, 2) change of the phase per second of lateness, over a window that reaches so many rows."""
        per_row = (len(self.whole) - 1) / (self.sight.rows - 1)
        waves, blur = np.exp(1j * self.lit.turns), _signed_blur(self.sight, per_row)
        total, change = (
            _averaged(_phasors(shares, waves, blur), window_rows * per_row)
            for shares in (self.lit.weights, self.lit.late_per_s())
        )
        lengths = np.maximum(np.abs(total), LEAST_CONTRAST)
        return np.asarray((change * total.conj()).imag / lengths**2)

    def at(self, panel_rows: Float) -> tuple[Float, Float, Float]:
        """(rad, contrast, late_rad_per_s) at LCD rows of any shape (...), each (..., 2)."""
        place = places(panel_rows, self.sight.rows, len(self.whole), self.sight.upwards)
        rad, contrast, late = (at_rows(one, place) for one in (self.rad, self.contrast, self.late_rad_per_s))
        return rad, contrast, late


def _signed_blur(sight: Sight, per_row: float) -> Float:
    """(2,) of the sight, in rows of a table in scan-out order."""
    return sight.blur_rows * (-per_row if sight.upwards else per_row)


def _phasors(shares: Float, waves: Complex, blur: Float) -> Complex:
    """(n, 2) Z of the module, by shares (k, n) of waves (k, 2)."""
    sharp = shares.T @ waves
    n = np.arange(len(sharp))
    before, after = np.maximum(n - 1, 0), np.minimum(n + 1, len(sharp) - 1)
    return np.asarray(sharp + 1j * blur * (sharp[after] - sharp[before]) / (after - before)[:, None])


def _averaged(phasors: Complex, reach: float) -> Complex:
    """(n, 2) averaged over the sensing window, a triangle that reaches so many rows to either side.

    Beyond the panel as in its last row.
    """
    sampled = math.hypot(reach, 1.0)  # of that variance when sampled at whole rows
    half = int(sampled)
    weights = sampled - np.abs(np.arange(-half, half + 1))
    weights /= weights.sum()
    padded = np.pad(phasors, ((half, half), (0, 0)), mode="edge")
    return np.stack([np.convolve(one, weights, mode="valid") for one in padded.T], axis=-1)


def _polar(phasors: Complex) -> Float:
    """Phases, without leaps from row to row, and lengths (n, 4) of phasors (n, 2)."""
    lengths = np.maximum(np.abs(phasors), LEAST_CONTRAST)
    return np.concatenate([np.unwrap(np.angle(phasors), axis=0), lengths], axis=1)


def carrier_turns(shifts: Float, diagonal: bool) -> Float:
    """(k, 2) rad: phases along the two carriers of pictures shifted by (k, 2) periods along u and v."""
    if diagonal:
        shifts = np.stack([shifts[:, 0] + shifts[:, 1], shifts[:, 0] - shifts[:, 1]], axis=-1)
    return np.asarray(2 * np.pi * shifts)
