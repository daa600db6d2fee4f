"""Leading a moving mirror by the loop's own delay.

What is commanded now is seen later: by the frames that are exposed to the new picture, a horizon h after
the frame that it was made from. Where the mirror moves steadily the command is therefore

    command = x + v h,      v = (x - x of the last frame) / (time between them),

x the controller's estimate, which itself stays without the lead (it is what the mirror did, not what it may
do next). v is averaged over (2 RADIUS + 1)^2 nodes: through the sensor's window fine modes are partly read
back from what was shown, and a lead on these would feed itself.

v counts where three steps running agree in direction and size, and where the controller's gain says that
there is motion at all. So a press of a moment leads to nothing, not even one in the middle of an exposure
(which makes two steps of it); a standing mirror is not led, and its noise not raised.

The horizon is measured, not modelled. Every frame tells, per panel row, how old the pictures in it were:
the time from the mid-exposure of the frames they were made from to its own, weighted by their light. Refresh,
scan-out, rise, exposure, transfer and computing are all in it.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.control.box import box_mean

Float = NDArray[np.float64]

RADIUS = 3
"""v is averaged over (2 RADIUS + 1)^2 nodes."""

MOVES_ABOVE_GAIN = 0.5
"""Gain K from which on a node is believed to move: innovations of twice their expected size."""

AGREES_FROM, AGREES_AT = 0.5, 0.8
"""Agreement 2 v.v' / (v^2 + v'^2) of two steps under which v counts for nothing, and from which it does wholly.

Steps of 1 : 2 agree by 0.8, of 1 : 4 by 0.47, against each other by less than 0.
"""

HORIZON_MEMORY = 0.3
"""Share of each frame's ages in the horizon: it settles within some frames of a change of pace."""

LONGEST_S = 0.25
"""Steps further apart than this say nothing of the motion now."""


class Horizon:
    """Mean age of what is shown when it is seen, per panel row in scan-out order, s."""

    def __init__(self) -> None:
        self._age_s: Float | None = None

    def learn(self, age_ns: Float | None) -> None:
        """Take in the ages (n,) of one frame, ns."""
        if age_ns is None:
            return
        age_s = 1e-9 * age_ns
        if self._age_s is None:
            self._age_s = age_s
        else:
            self._age_s = self._age_s + HORIZON_MEMORY * (age_s - self._age_s)

    def per_row(self) -> Float | None:
        """(n,) s; None before any frame has told."""
        return self._age_s


@numba.njit(cache=True, fastmath={"contract", "reassoc"})
def _agreement(v: Float, last: Float, j: int, i: int) -> float:
    both = v[0, j, i] * last[0, j, i] + v[1, j, i] * last[1, j, i]
    size = v[0, j, i] ** 2 + v[1, j, i] ** 2 + last[0, j, i] ** 2 + last[1, j, i] ** 2
    if not size > 0.0:
        return 0.0
    return min(max((2.0 * both / size - AGREES_FROM) / (AGREES_AT - AGREES_FROM), 0.0), 1.0)


@numba.njit(cache=True)
def _lead(
    v: Float,
    last: Float,
    agreed: Float,
    gain: Float,
    q: Float,
    horizon_s: Float,
    rows_per_entry: float,
    upwards: bool,
    out: Float,
) -> None:
    """Add to q (rows, cols, 2) the lead, in `out`; `agreed` goes from the last step's to this one's."""
    end = horizon_s.size - 1
    for j in range(gain.shape[0]):
        for i in range(gain.shape[1]):
            agrees = _agreement(v, last, j, i)
            share = min(agrees, agreed[j, i])
            agreed[j, i] = agrees
            share *= min(gain[j, i] / MOVES_ABOVE_GAIN, 1.0) if gain[j, i] > LEAST_GAIN else 0.0
            x = min(max(q[j, i, 1] * rows_per_entry, 0.0), float(end))
            if upwards:
                x = end - x
            n = min(int(x), end - 1)
            h = share * ((1.0 + n - x) * horizon_s[n] + (x - n) * horizon_s[n + 1])
            out[j, i, 0] = q[j, i, 0] + h * v[0, j, i]
            out[j, i, 1] = q[j, i, 1] + h * v[1, j, i]


LEAST_GAIN = 0.25
"""A gain above this is not the one at rest."""


class Lead:
    """Velocity of every node from frame to frame, and the command that it leads to."""

    def __init__(self, shape: tuple[int, int], panel_rows: int, upwards: bool) -> None:
        self._panel_rows = panel_rows
        self._upwards = upwards
        self._before = np.zeros((2, *shape))
        self._v = np.zeros((2, *shape))
        self._last = np.zeros((2, *shape))
        self._agreed = np.zeros(shape)
        self._time_ns: int | None = None
        self._moves = False

    def apply(self, x: Float, gain: Float, q: Float, time_ns: int, horizon_s: Float | None) -> Float:
        """Give q with its lead.

        x: (rows, cols, 2) displacement by the frame of `time_ns`, LCD px. gain: (rows, cols) its K. q: rest
        and x. horizon_s: (n,) s per panel row in scan-out order; None: no lead.
        """
        since_s = math.inf if self._time_ns is None else 1e-9 * (time_ns - self._time_ns)
        self._time_ns = time_ns
        self._v, self._last = self._last, self._v
        moves = bool(gain.max() > LEAST_GAIN) and since_s < LONGEST_S
        for k in range(2):
            if moves:
                np.subtract(x[..., k], self._before[k], out=self._v[k])
                self._v[k] /= since_s
                box_mean(self._v[k], RADIUS)
            elif self._moves:
                self._v[k] = 0.0
            self._before[k] = x[..., k]
        was_moving, self._moves = self._moves, moves
        if not moves or horizon_s is None:
            if was_moving:
                self._agreed[:] = 0.0
                self._v[:] = 0.0
                self._last[:] = 0.0
            return q
        out = np.empty_like(q)
        per_row = (horizon_s.size - 1) / (self._panel_rows - 1)
        _lead(self._v, self._last, self._agreed, gain, q, horizon_s, per_row, self._upwards, out)
        return out
