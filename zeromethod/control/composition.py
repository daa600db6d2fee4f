"""The composition controller: an adaptive filter of absolute warp measurements, whose output is commanded.

Every frame measures the warp absolutely, whatever was shown in it and however late it arrives (adaptive
optics calls this pseudo-open-loop control). There is no integrator that could wind up: the command is the
filtered measurement, and delay makes it late but never unstable. Per node

    x <- x + K (z - x),      K = 1 - M / S  within [K_min, gain],

x the displacement from rest, z the measured one, S the mean of innovation^2 / expected variance over the
neighbouring nodes (innovation-based adaptive Kalman filter; Mehra 1970, doi:10.1109/TAC.1970.1099422). At
rest S is near 1 and K at its minimum, which passes sqrt(K / (2 - K)) = 0.33 of a frame's noise; a press
raises S, and K to `gain`, within the frame that shows it. Where the mirror moves steadily the command is
predicted ahead by the loop's delay (`zeromethod.control.velocity`); x itself is not.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.control.box import box_sum
from zeromethod.control.own_side import OwnSide
from zeromethod.control.velocity import VelocityPredictor
from zeromethod.kernels import kernel, read
from zeromethod.sensing.residual import Residual
from zeromethod.warp.components import twice
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.observable import observable_part
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

LEAST_GAIN = 0.2
"""K_min: filtered noise is 0.33 of a single frame's; larger motion raises K by itself."""

SLOW_GAIN = 0.1
"""K of nodes that fail again and again."""

MARGIN = 1.5
"""M: S scatters by about 0.25 at rest, as the 49 averaged nodes share pixels; below 1.9 it is noise."""

RADIUS = 3
"""S is averaged over (2 RADIUS + 1)^2 nodes."""

FREEZE_ABOVE = 0.03
"""Share of the nodes with mixed pictures above which the whole command is frozen."""

_MIXED = np.uint16(Flag.MIXED)


@kernel(
    read(numba.float64, 3), read(numba.float64, 3), read(numba.boolean, 2), read(numba.float64, 2),
    read(numba.float64, 2), numba.float64, numba.float64, numba.float64[:, :, ::1], numba.float64[:, ::1],
    numba.float64[:, :, ::1],
)  # fmt: skip
def _correct(
    away: Float,
    sigma: Float,
    valid: Mask,
    total: Float,
    count: Float,
    least: float,
    most: float,
    variance: Float,
    gain: Float,
    x: Float,
) -> None:
    """Add K (z - x) to x and update the variance at valid nodes; K, 0 elsewhere, in `gain`.

    away: z - x. total, count: sum of squared innovations over their variance, and their number, of which S is
    the ratio; both are positive at a valid node unless nothing moved at all.
    """
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            gain[j, i] = 0.0
            if valid[j, i]:
                share = min(max(1.0 - MARGIN * count[j, i] / max(total[j, i], 1e-12), least), most)
                gain[j, i] = share
                for k in range(2):
                    x[j, i, k] += share * away[j, i, k]
                    kept, new = (1.0 - share) ** 2 * variance[j, i, k], (share * sigma[j, i, k]) ** 2
                    variance[j, i, k] = kept + new


class Composition:
    """The adaptive filter of the module's equations. gain: upper limit of K, 0..1.

    Invalid nodes follow a smooth continuation of their neighbours' displacement, next to a saw's seam from
    their own side of it; nothing decays to rest.
    A share K of the displacement that the sensor cannot observe is taken out of the command in every frame,
    so that it decays as fast as the observable part is learnt and cannot random-walk.

    Nodes whose pictures are too mixed count as not measured. When they are many the whole command is frozen:
    the picture then stays the same until one exposure contains it alone, so that measurements resume.
    """

    keeps_pictures = True

    def __init__(self, rest: Rest, gain: float = 1.0) -> None:
        shape = rest.q.shape
        self._rest = rest
        self._most = gain
        self._least = min(LEAST_GAIN, gain)
        self._x = np.zeros(shape)
        self._variance = np.zeros(shape)
        self._flags = rest.flags.copy()
        self._observable = np.empty(shape)
        self.gain = np.zeros(shape[:2])
        """(rows, cols) K of the last update; 0 where nothing was measured."""
        self._predictor = VelocityPredictor(rest)
        self._own_side = OwnSide(rest)
        self.estimate: Float = rest.q.copy()
        """(rows, cols, 2) LCD px, rest and x: the command without prediction."""
        self.commanded: Float = rest.q.copy()

    def set_gain(self, gain: float) -> None:
        """Let K be at most `gain`, 0..1, from now on."""
        self._most, self._least = gain, min(LEAST_GAIN, gain)

    def update(
        self,
        residual: Residual,  # noqa: ARG002 - only the integrator uses it
        measured: Warp,
        horizon_s: Float | None = None,
        unsteady: Mask | None = None,
    ) -> bool:
        """Take in one frame; False when the command was frozen: pictures too mixed, or no valid node."""
        mixed = (measured.flags & _MIXED) != 0
        if np.count_nonzero(mixed) > FREEZE_ABOVE * mixed.size:
            return False
        valid = measured.valid
        if not valid.any():
            return False
        x = self._x
        target = self._corrected(measured, valid)
        if unsteady is not None:
            slow = np.where(valid, SLOW_GAIN, 0.0)[unsteady]
            self.gain[unsteady] = slow
            away = np.nan_to_num(measured.q[unsteady] - self._rest.q[unsteady] - x[unsteady])
            target[unsteady] = x[unsteady] + slow[:, None] * away
            valid = valid | unsteady
        continue_smoothly(target, self._own_side.extended(target, valid), out=target)
        observable = observable_part(target, out=self._observable)
        # Of the unobservable part a share K, and all of it where nothing is measured: all of it everywhere
        # would cost every dent the pass band's ripple over K, not the ripple.
        np.subtract(observable, target, out=x)
        x *= twice(np.where(valid, self.gain, 1.0))
        x += target
        self._flags = measured.flags
        self.estimate = self._rest.q + x
        self.commanded = self.estimate.copy()
        self._predictor.add(self.commanded, x, self.gain, measured.time_ns, horizon_s)
        return True

    def _corrected(self, measured: Warp, valid: Mask) -> Float:
        """The sum x + K (z - x) at valid nodes, x elsewhere; K and the variance are updated."""
        away = measured.q - self._rest.q
        away -= self._x
        innovation = away * away
        innovation /= np.maximum(measured.sigma**2 + self._variance, 1e-12)
        over: Float = np.where(valid, innovation[..., 0] + innovation[..., 1], 0.0)
        sums = box_sum(over, RADIUS), box_sum(np.where(valid, 2.0, 0.0), RADIUS)
        target = self._x.copy()
        limits = self._least, self._most
        _correct(away, measured.sigma, valid, *sums, *limits, self._variance, self.gain, target)
        return target

    def filtered(self, time_ns: int) -> Warp:
        """The estimate, without prediction; sigma by the filter's recursion, flags of the last frame."""
        return Warp(self.estimate, np.sqrt(self._variance), self._flags, time_ns)
