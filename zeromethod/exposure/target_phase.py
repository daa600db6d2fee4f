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
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float

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
        """Sight by a warp.

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


@dataclass(frozen=True, slots=True)
class TargetPhase:
    """Phase of the target's two carriers, along u and v (of a checker: along u + v and u - v).

    Convention: of a mirror at rest the camera sees a carrier as cos(2 pi u / P + rad), so `rad` is to be
    taken out of what was demodulated. rad: (n, 2) at n panel rows, equally spaced in scan-out order, rad.
    contrast: (n, 2) share of the carrier's amplitude that is left, 0..1. late_rad_per_s: (n, 2) change of
    `rad` per second by which all was lit later than assumed. rows: of the panel. upwards: it is scanned from
    its last row on. diagonal: whether it is a checker's. node_rad, node_contrast, node_late_rad_per_s: (rows,
    cols, 2) the same where each node looks on the shown warp, in the mean over the sensing window.
    """

    rad: Float
    contrast: Float
    late_rad_per_s: Float
    rows: int
    upwards: bool
    diagonal: bool
    node_rad: Float
    node_contrast: Float
    node_late_rad_per_s: Float

    @classmethod
    def of(
        cls,
        turns: Float,
        diagonal: bool,
        weights: Float,
        late_per_s: Float,
        sight: Sight,
        node_rows: Float,
    ) -> TargetPhase:
        """Phase by the pictures lit.

        turns: (k, 2) rad, each picture's phase along the two carriers, which are diagonal or not. weights,
        late_per_s: (k, n) share of each, and its change per second of lateness. node_rows: (rows, cols) LCD
        rows at which the nodes look.
        """
        rows = weights.shape[1]
        both = (np.concatenate([weights, late_per_s], axis=1).T @ np.exp(1j * turns)).reshape(2, rows, 2)
        panel, per_row = (sight.rows, sight.upwards), (rows - 1) / (sight.rows - 1)
        both += 1j * sight.blur_rows * (-per_row if sight.upwards else per_row) * _gradient(both)
        whole, of_nodes = _polar(both), _polar(_averaged(both, _window(sight.window_rows * per_row)))
        at_nodes = _at(of_nodes, node_rows, *panel)
        rad, contrast, late = whole
        return cls(rad, contrast, late, *panel, diagonal, at_nodes[0], at_nodes[1], at_nodes[2])

    def node_px(self, period_px: float) -> Float:
        """(rows, cols, 2) camera px: the phase at the nodes as a displacement along u and v."""
        carriers = period_px / (2 * math.pi) * self.node_rad
        if not self.diagonal:
            return carriers
        p, m = carriers[..., 0], carriers[..., 1]
        return 0.5 * np.stack([p + m, p - m], axis=-1)

    def at(self, panel_rows: Float) -> tuple[Float, Float, Float]:
        """(rad, contrast, late_rad_per_s) at LCD rows of any shape (...), each (..., 2)."""
        table = np.stack([self.rad, self.contrast, self.late_rad_per_s])
        rows = np.atleast_2d(np.asarray(panel_rows, dtype=np.float64))
        found = _at(table, rows.reshape(1, -1), self.rows, self.upwards)
        rad, contrast, late = found.reshape(3, *np.shape(panel_rows), 2)
        return rad, contrast, late


def _polar(both: Complex) -> Float:
    """(3, n, 2) of rad, contrast, late_rad_per_s, by (2, n, 2) phasors and their change per s of lateness."""
    total, change = both
    out = np.empty((3, *total.shape))
    out[0] = np.angle(total)
    turns = np.rint(np.diff(out[0], axis=0) / (2 * np.pi))
    if turns.any():
        out[0, 1:] -= 2 * np.pi * np.cumsum(turns, axis=0)
    np.maximum(np.abs(total), LEAST_CONTRAST, out=out[1])
    out[2] = (change * total.conj()).imag / out[1] ** 2
    return out


def _gradient(values: Complex) -> Complex:
    """(k, n, 2) change from row to row."""
    out = np.empty_like(values)
    step = values[:, 1:] - values[:, :-1]
    out[:, 0], out[:, -1] = step[:, 0], step[:, -1]
    out[:, 1:-1] = 0.5 * (step[:, 1:] + step[:, :-1])
    return out


def _window(reach: float) -> Float:
    """Weights of the sensing window, a triangle that reaches so many rows of a table to either side."""
    # of that variance when sampled at whole rows
    sampled = math.hypot(reach, 1.0)
    rows = np.arange(-math.floor(sampled), math.floor(sampled) + 1)
    weights = sampled - np.abs(rows)
    return np.asarray(weights / weights.sum())


def _averaged(phasors: Complex, window: Float) -> Complex:
    """(k, n, 2) averaged over a window of rows; beyond the panel as in its last row."""
    half, rows = len(window) // 2, phasors.shape[1]
    padded = phasors[:, np.clip(np.arange(-half, rows + half), 0, rows - 1)]
    averaged = np.zeros_like(phasors)
    for k, weight in enumerate(window):
        averaged += weight * padded[:, k : k + rows]
    return averaged


def _at(table: Float, panel_rows: Float, rows: int, upwards: bool) -> Float:
    """(quantities, rows, cols, 2) of a (quantities, n, 2) table at LCD rows (rows, cols)."""
    out = np.empty((table.shape[0], *panel_rows.shape, 2))
    _interpolate(table, panel_rows, (table.shape[1] - 1) / (rows - 1), upwards, out)
    return out


@numba.njit(cache=True)
def _interpolate(table: Float, panel_rows: Float, per_row: float, upwards: bool, out: Float) -> None:
    last = table.shape[1] - 1
    for j in range(panel_rows.shape[0]):
        for i in range(panel_rows.shape[1]):
            x = panel_rows[j, i] * per_row
            x = min(max(x, 0.0), float(last)) if math.isfinite(x) else 0.0
            x = last - x if upwards else x
            n = min(int(x), last - 1)
            t = x - n
            for k in range(table.shape[0]):
                for c in range(2):
                    out[k, j, i, c] = (1.0 - t) * table[k, n, c] + t * table[k, n + 1, c]


def carrier_turns(shifts: Float, diagonal: bool) -> Float:
    """(k, 2) rad: phases along the two carriers of pictures shifted by (k, 2) periods along u and v."""
    if diagonal:
        shifts = np.stack([shifts[:, 0] + shifts[:, 1], shifts[:, 0] - shifts[:, 1]], axis=-1)
    return np.asarray(2 * np.pi * shifts)
