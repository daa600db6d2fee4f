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
from zeromethod.sensing.residual import Residual
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


@numba.njit(cache=True)
def _correct(
    x: Float,
    variance: Float,
    q: Float,
    q_rest: Float,
    sigma: Float,
    valid: Mask,
    least: float,
    most: float,
    scratch: Float,
    gain: Float,
    target: Float,
    radius: int,
) -> None:
    """Gain per node and target = x + K (z - x) at valid nodes (x elsewhere); variance is updated.

    radius: of the boxes, nodes; as an argument, as boxes of a fixed one would be compiled again.
    """
    rows, cols = valid.shape
    innovation, count, box = scratch[0], scratch[1], scratch[2]
    for j in range(rows):
        for i in range(cols):
            innovation[j, i] = 0.0
            count[j, i] = 0.0
            if valid[j, i]:
                count[j, i] = 2.0
                for k in range(2):
                    e = q[j, i, k] - q_rest[j, i, k] - x[j, i, k]
                    expected = sigma[j, i, k] * sigma[j, i, k] + variance[j, i, k]
                    innovation[j, i] += e * e / max(expected, 1e-12)
    box_sum(innovation, radius, box)
    box_sum(count, radius, innovation)
    for j in range(rows):
        for i in range(cols):
            gain[j, i] = 0.0
            for k in range(2):
                target[j, i, k] = x[j, i, k]
            if valid[j, i]:
                # S = box / innovation; both are positive at a valid node unless nothing moved at all.
                kalman = 1.0 - MARGIN * innovation[j, i] / max(box[j, i], 1e-12)
                share = min(max(kalman, least), most)
                gain[j, i] = share
                rest = 1.0 - share
                for k in range(2):
                    target[j, i, k] += share * (q[j, i, k] - q_rest[j, i, k] - x[j, i, k])
                    r = sigma[j, i, k] * sigma[j, i, k]
                    variance[j, i, k] = rest * rest * variance[j, i, k] + share * share * r


@numba.njit(cache=True)
def _drop_unobservable(target: Float, observable: Float, gain: Float, valid: Mask, x: Float) -> None:
    """Set x to target less a share K of its unobservable part; less all of it where nothing is measured.

    Taking out all of it everywhere would cost every dent the pass band's ripple over K, not the ripple.
    """
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            share = gain[j, i] if valid[j, i] else 1.0
            for k in range(2):
                x[j, i, k] = target[j, i, k] + share * (observable[j, i, k] - target[j, i, k])


@numba.njit(cache=True)
def _from_rest(rest: Float, x: Float, estimate: Float, commanded: Float) -> None:
    """Rest and x, twice."""
    for j in range(x.shape[0]):
        for i in range(x.shape[1]):
            for k in range(2):
                estimate[j, i, k] = commanded[j, i, k] = rest[j, i, k] + x[j, i, k]


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
        self._target = np.empty(shape)
        self._observable = np.empty(shape)
        self._scratch = np.empty((3, *shape[:2]))
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
        x, target = self._x, self._target
        _correct(
            x,
            self._variance,
            measured.q,
            self._rest.q,
            measured.sigma,
            valid,
            self._least,
            self._most,
            self._scratch,
            self.gain,
            target,
            RADIUS,
        )
        if unsteady is not None:
            slow = np.where(valid, SLOW_GAIN, 0.0)[unsteady]
            self.gain[unsteady] = slow
            away = np.nan_to_num(measured.q[unsteady] - self._rest.q[unsteady] - x[unsteady])
            target[unsteady] = x[unsteady] + slow[:, None] * away
            valid = valid | unsteady
        continue_smoothly(target, self._own_side.extended(target, valid), out=target)
        observable = observable_part(target, out=self._observable)
        _drop_unobservable(target, observable, self.gain, valid, x)
        self._flags = measured.flags
        self.estimate, self.commanded = np.empty_like(x), np.empty_like(x)
        _from_rest(self._rest.q, x, self.estimate, self.commanded)
        self._predictor.add(self.commanded, x, self.gain, measured.time_ns, horizon_s)
        return True

    def filtered(self, time_ns: int) -> Warp:
        """The estimate, without prediction; sigma by the filter's recursion, flags of the last frame."""
        return Warp(self.estimate, np.sqrt(self._variance), self._flags, time_ns)
