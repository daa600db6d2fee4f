"""Prediction of a moving mirror over the loop's own delay.

What is commanded now is exposed later, a horizon h after the frame that it was made from. Where the mirror
moves steadily the command is therefore

    command = x + v h,      v = (x - x of the last frame) / (time between them),

x the controller's estimate, which itself contains no prediction (it is what the mirror did, not what it may
do next). v is averaged over (2 RADIUS + 1)^2 nodes: through the sensor's window fine modes are partly read
back from what was shown, and their prediction would feed itself.

v is used where three consecutive steps agree in direction and size, and where the controller's gain shows
motion at all. So a sudden press causes no prediction, not even one in the middle of an exposure (which
appears as two steps); a mirror at rest is not predicted, and its noise not raised.

The horizon is measured, not modelled. Every frame gives, per panel row, the age of the pictures in it:
the time from the mid-exposure of the frames they were made from to its own, weighted by their light. It
includes refresh, scan-out, rise, exposure, transfer and computing.

The cost: a motion that stops is predicted past its end, by v h at most, until frames show the stop and the
picture after them is shown: about one delay longer than without prediction. Acceleration is not predicted, so
that motions no longer than a few delays gain little.
"""

from __future__ import annotations

import math
from collections import deque

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.control.box import box_mean, box_sum
from zeromethod.warp.rest import Rest

RADIUS = 3
"""v is averaged over (2 RADIUS + 1)^2 nodes."""

AGREEMENT_RADIUS = 8
"""Agreement is computed over (2 AGREEMENT_RADIUS + 1)^2 nodes: a press moves as a whole or not."""

RESTS_BELOW_GAIN, MOVES_ABOVE_GAIN = 0.25, 0.5
"""Gain K up to which a node is at rest, and from which it moves: innovations of 1.4, 1.7 sigma."""

AGREES_FROM, AGREES_AT = 0.5, 0.8
"""Agreement 2 v.v' / (v^2 + v'^2) of two steps up to which v is ignored, and from which it is fully used.

It is 0.8 for steps of 1 : 2, 0.47 for 1 : 4, negative for opposite ones.
"""

HORIZON_FRAMES = 7
"""The horizon is the median over so many frames, so that a single frozen command has no influence."""

LARGEST_JUMP_PERIODS = 0.33
"""Largest change of the command from picture to picture, in carrier periods, that prediction may cause.

Pictures half a period apart are ambiguous within one exposure (`mixture`); prediction must not cause that.
"""

LONGEST_S = 0.25
"""Longest time between frames from which a velocity is computed."""


@numba.njit(cache=True)
def _median(values: Float) -> Float:
    """Median (n,) of rows (k, n), which are sorted in place; without the cost of numpy's."""
    count, half = values.shape[0], values.shape[0] // 2
    for end in range(count - 1, half - 2, -1):
        for k in range(end):
            for i in range(values.shape[1]):
                a, b = values[k, i], values[k + 1, i]
                values[k, i], values[k + 1, i] = min(a, b), max(a, b)
    median: Float = values[half].copy() if count % 2 else 0.5 * (values[half - 1] + values[half])
    return median


class Horizon:
    """Mean age of the pictures at the time of exposure, s, from the panel's first row to its last."""

    def __init__(self, upwards: bool) -> None:
        self._upwards = upwards
        self._ages: deque[Float] = deque(maxlen=HORIZON_FRAMES)
        self.age_s: Float | None = None
        """(n,) s at equally spaced rows; None before the first known age."""

    def learn(self, age_ns: Float | None) -> None:
        """Take in the ages of one frame, (n,) ns in scan-out order; None where unknown."""
        if age_ns is not None:
            self._ages.append(1e-9 * (age_ns[::-1] if self._upwards else age_ns))
            self.age_s = _median(np.array(self._ages))


@numba.njit(cache=True)
def _split(x: Float, out: Float) -> None:
    """Components of x (rows, cols, 2) apart, (2, rows, cols)."""
    for j in range(x.shape[0]):
        for i in range(x.shape[1]):
            out[0, j, i], out[1, j, i] = x[j, i, 0], x[j, i, 1]


@numba.njit(cache=True)
def _steps(x: Float, k: int, last: Float, since_s: float, out: Float) -> None:
    """Speed of component k since `last` (rows, cols), in `out`."""
    for j in range(last.shape[0]):
        for i in range(last.shape[1]):
            out[j, i] = (x[j, i, k] - last[j, i]) / since_s


@numba.njit(cache=True)
def _products(v: Float, last: Float, both: Float, size: Float) -> None:
    """2 v.v' and v^2 + v'^2 of every node, in `both` and `size`."""
    for j in range(both.shape[0]):
        for i in range(both.shape[1]):
            a, b, c, d = v[0, j, i], v[1, j, i], last[0, j, i], last[1, j, i]
            both[j, i] = 2.0 * (a * c + b * d)
            size[j, i] = a * a + b * b + c * c + d * d


@numba.njit(cache=True)
def _trust(both: Float, size: Float, gain: Float, agreed: Float, share: Float) -> None:
    """Share of v to predict with; `agreed` is updated from the last step's agreement to this one's."""
    for j in range(gain.shape[0]):
        for i in range(gain.shape[1]):
            agrees = both[j, i] / size[j, i] if size[j, i] > 0.0 else 0.0
            agrees = min(max((agrees - AGREES_FROM) / (AGREES_AT - AGREES_FROM), 0.0), 1.0)
            trust = min(agrees, agreed[j, i])
            agreed[j, i] = agrees
            # unmeasured nodes have no gain; their x, and so v, continues their neighbours'
            k = gain[j, i]
            if k > 0.0:
                moves = (k - RESTS_BELOW_GAIN) / (MOVES_ABOVE_GAIN - RESTS_BELOW_GAIN)
                trust *= min(max(moves, 0.0), 1.0)
            share[j, i] = trust


@numba.njit(cache=True)
def _wanted(
    v: Float, share: Float, q: Float, horizon_s: Float, rows_per_entry: float, last: Float, out: Float
) -> tuple[float, float, float, float]:
    """Shift share v h in `out`; squares of the largest v, shift, last shift, and difference of the two."""
    end = horizon_s.size - 1
    speed = size = before = change = 0.0
    for j in range(share.shape[0]):
        for i in range(share.shape[1]):
            x = min(max(q[j, i, 1] * rows_per_entry, 0.0), float(end))
            n = min(int(x), end - 1)
            ahead_s = share[j, i] * (horizon_s[n] + (x - n) * (horizon_s[n + 1] - horizon_s[n]))
            a, b = ahead_s * v[0, j, i], ahead_s * v[1, j, i]
            out[0, j, i], out[1, j, i] = a, b
            speed = max(speed, v[0, j, i] ** 2 + v[1, j, i] ** 2)
            size = max(size, a * a + b * b)
            before = max(before, last[0, j, i] ** 2 + last[1, j, i] ** 2)
            change = max(change, (a - last[0, j, i]) ** 2 + (b - last[1, j, i]) ** 2)
    return speed, size, before, change


@numba.njit(cache=True)
def _apply(wanted: Float, part: float, shift: Float, q: Float) -> None:
    """Move `shift` (2, rows, cols) by `part` of the way to `wanted`, and add it to q (rows, cols, 2)."""
    for j in range(q.shape[0]):
        for i in range(q.shape[1]):
            for k in range(2):
                shift[k, j, i] += part * (wanted[k, j, i] - shift[k, j, i])
                q[j, i, k] += shift[k, j, i]


class VelocityPredictor:
    """Per-node velocity from frame to frame, and commands predicted ahead with it."""

    def __init__(self, rest: Rest) -> None:
        shape = rest.q.shape[:2]
        self._panel_rows = rest.display_size[1]
        # two nodes are a period apart
        period_lcd_px = 2 * float(np.median(np.hypot(*np.diff(rest.q, axis=1)[rest.grid.inner].T)))
        self._largest_jump = LARGEST_JUMP_PERIODS * period_lcd_px
        self._shift = np.zeros((2, *shape))
        self._x = np.zeros((2, *shape))
        self._v = np.zeros((2, *shape))
        self._last = np.zeros((2, *shape))
        self._agreed = np.zeros(shape)
        self._work = np.zeros((2, *shape))
        self._share = np.zeros(shape)
        self._time_ns: int | None = None
        self._moves = False

    def add(self, q: Float, x: Float, gain: Float, time_ns: int, horizon_s: Float | None) -> None:
        """Add v h to the command `q`, (rows, cols, 2) LCD px, in place.

        x: (rows, cols, 2) displacement measured by the frame of `time_ns`, LCD px. gain: (rows, cols) its K.
        horizon_s: (n,) s from the panel's first row to its last; None: no prediction.
        """
        since_s = math.inf if self._time_ns is None else 1e-9 * (time_ns - self._time_ns)
        self._time_ns = time_ns
        moves = horizon_s is not None and bool(gain.max() > MOVES_ABOVE_GAIN) and 0 < since_s < LONGEST_S
        if moves:
            self._v, self._last = self._last, self._v
            for k in range(2):
                _steps(x, k, self._x[k], since_s, self._share)
                box_mean(self._share, RADIUS, self._v[k])
        elif self._moves:
            self._v[:] = self._last[:] = 0.0
            self._agreed[:] = 0.0
            self._shift[:] = 0.0
        self._moves = moves
        _split(x, self._x)
        if moves and horizon_s is not None:
            both, size = self._work
            _products(self._v, self._last, both, size)
            box_sum(both, AGREEMENT_RADIUS, self._share)
            box_sum(size, AGREEMENT_RADIUS, both)
            _trust(self._share, both, gain, self._agreed, self._share)
            per_row = (horizon_s.size - 1) / (self._panel_rows - 1)
            squares = _wanted(self._v, self._share, q, horizon_s, per_row, self._shift, self._work)
            speed, most, before, change = (math.sqrt(square) for square in squares)
            part = 1.0
            if most > before:
                room = max(self._largest_jump - speed * since_s, 0.5 * self._largest_jump)
                part = min(1.0, room / change)
            _apply(self._work, part, self._shift, q)
