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
from zeromethod.kernels import kernel, read
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
            # np.median takes ten times as long
            ages, half = np.sort(self._ages, axis=0), len(self._ages) // 2
            self.age_s = 0.5 * (ages[half] + ages[~half])


def _dot(a: Float, b: Float) -> Float:
    """Products (rows, cols) of vectors (2, rows, cols)."""
    both = a * b
    total: Float = both[0] + both[1]
    return total


@kernel(
    read(numba.float64, 3), read(numba.float64, 2), read(numba.float64, 3), read(numba.float64, 1),
    numba.float64, read(numba.float64, 3), numba.float64[:, :, ::1], numba.float64[::1],
)  # fmt: skip
def _wanted(
    v: Float,
    share: Float,
    q: Float,
    horizon_s: Float,
    entries_per_row: float,
    shift: Float,
    change: Float,
    squares: Float,
) -> None:
    """What share v h changes of a shift, in `change`; those arrays have components first, q has them last.

    squares: of the largest v, share v h, shift, and change; 0 before.
    """
    end = horizon_s.size - 1
    for j in range(share.shape[0]):
        for i in range(share.shape[1]):
            x = min(max(q[j, i, 1] * entries_per_row, 0.0), float(end))
            n = min(int(x), end - 1)
            ahead_s = share[j, i] * (horizon_s[n] + (x - n) * (horizon_s[n + 1] - horizon_s[n]))
            a, b, c, d = v[0, j, i], v[1, j, i], shift[0, j, i], shift[1, j, i]
            squares[0] = max(squares[0], a * a + b * b)
            a, b = ahead_s * a, ahead_s * b
            squares[1] = max(squares[1], a * a + b * b)
            squares[2] = max(squares[2], c * c + d * d)
            a, b = a - c, b - d
            squares[3] = max(squares[3], a * a + b * b)
            change[0, j, i], change[1, j, i] = a, b


def _ramp(values: Float, start: float, end: float) -> Float:
    """0 up to `start`, 1 from `end` on, in between straight; in place."""
    values -= start
    values *= 1.0 / (end - start)
    return np.clip(values, 0.0, 1.0, out=values)


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
        last_x, self._x = self._x, np.stack([x[..., 0], x[..., 1]])
        if moves:
            steps = self._x - last_x
            self._last, self._v = self._v, np.stack([box_mean(step, RADIUS) for step in steps])
            self._v /= since_s
        elif self._moves:
            self._v[:] = self._last[:] = 0.0
            self._agreed[:] = 0.0
            self._shift[:] = 0.0
        self._moves = moves
        if moves and horizon_s is not None:
            change, squares = np.empty_like(self._v), np.zeros(4)
            per_row = (horizon_s.size - 1) / (self._panel_rows - 1)
            _wanted(self._v, self._trust(gain), q, horizon_s, per_row, self._shift, change, squares)
            speed, most, before, largest = np.sqrt(squares)
            part = 1.0
            if most > before:
                room = max(self._largest_jump - speed * since_s, 0.5 * self._largest_jump)
                part = min(1.0, room / largest)
            change *= part
            self._shift += change
            q[..., 0] += self._shift[0]
            q[..., 1] += self._shift[1]

    def _trust(self, gain: Float) -> Float:
        """Share (rows, cols) of v to predict with, by the agreement of this step and the last."""
        both = 2.0 * box_sum(_dot(self._v, self._last), AGREEMENT_RADIUS)
        size = box_sum(_dot(self._v, self._v) + _dot(self._last, self._last), AGREEMENT_RADIUS)
        agrees = _ramp(both / np.where(size > 0.0, size, math.inf), AGREES_FROM, AGREES_AT)
        share = np.minimum(agrees, self._agreed)
        self._agreed = agrees
        # unmeasured nodes have no gain; their x, and so v, continues their neighbours'
        share *= _ramp(np.where(gain > 0.0, gain, math.inf), RESTS_BELOW_GAIN, MOVES_ABOVE_GAIN)
        return share
