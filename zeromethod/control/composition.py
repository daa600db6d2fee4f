"""The controller: filter absolute measurements of the warp, command what they say.

Every frame measures the warp absolutely, whatever was shown in it and however late it comes (adaptive
optics calls this pseudo-open-loop control). So there is no integrator to wind up: the command is the
filtered measurement, and delay makes it late but never unstable. Per node

    x <- x + K (z - x),      K = 1 - M / S  within [K_min, gain],

x displacement from rest, z the measured one, S the mean of innovation^2 / expected variance over the
nodes around (innovation-based adaptive Kalman filter; Mehra 1970, doi:10.1109/TAC.1970.1099422). At rest
S is near 1 and K at its least, which passes sqrt(K / (2 - K)) = 0.33 of a frame's noise; a press drives S
up and K to `gain` within the frame that shows it. Where the mirror moves steadily the command leads x by
the loop's delay (`zeromethod.control.velocity`); x itself does not.
"""

from __future__ import annotations

from typing import Protocol

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.control.box import box_sum
from zeromethod.control.velocity import Lead
from zeromethod.sensing.residual import Residual
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.rest import Rest
from zeromethod.warp.unseen import filter_unseen
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

LEAST_GAIN = 0.2
"""K_min: filtered noise is 0.33 of a single frame's; what moves more raises K by itself."""

MARGIN = 1.5
"""M: S scatters by about 0.25 at rest, as the 49 nodes averaged share pixels; below 1.9 it is noise."""

RADIUS = 3
"""S is averaged over (2 RADIUS + 1)^2 nodes."""

HOLD_ABOVE = 0.03
"""Share of the nodes with mixed pictures above which the whole command is held."""

_MIXED = np.uint16(Flag.MIXED)


class Controller(Protocol):
    """What turns measured warps into the commanded one."""

    @property
    def commanded(self) -> Float:
        """(rows, cols, 2) LCD px that the loop wants shown next, finite everywhere."""

    @property
    def estimate(self) -> Float:
        """(rows, cols, 2) LCD px where the nodes looked in the last frame, finite everywhere."""

    @property
    def gain(self) -> Float:
        """(rows, cols) share of the last correction applied at each node."""

    def update(self, residual: Residual, measured: Warp, horizon_s: Float | None = None) -> bool:
        """Take one frame in; False when the command was held.

        horizon_s: (n,) s from a frame's mid-exposure until what it leads to is seen, from the panel's first
        row to its last; None where not known.
        """

    def filtered(self, time_ns: int) -> Warp:
        """Give the controller's estimate of the warp, less noisy than one frame's."""


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
) -> None:
    """Gain per node and target = x + K (z - x) at valid nodes (x elsewhere); variance is updated."""
    rows, cols = valid.shape
    surprise, count, box = scratch[0], scratch[1], scratch[2]
    for j in range(rows):
        for i in range(cols):
            surprise[j, i] = 0.0
            count[j, i] = 0.0
            if valid[j, i]:
                count[j, i] = 2.0
                for k in range(2):
                    e = q[j, i, k] - q_rest[j, i, k] - x[j, i, k]
                    expected = sigma[j, i, k] * sigma[j, i, k] + variance[j, i, k]
                    surprise[j, i] += e * e / max(expected, 1e-12)
    box_sum(surprise, RADIUS, box)
    box_sum(count, RADIUS, surprise)
    for j in range(rows):
        for i in range(cols):
            gain[j, i] = 0.0
            for k in range(2):
                target[j, i, k] = x[j, i, k]
            if valid[j, i]:
                # S = box / surprise; both are positive at a valid node unless nothing moved at all.
                wanted = 1.0 - MARGIN * surprise[j, i] / max(box[j, i], 1e-12)
                share = min(max(wanted, least), most)
                gain[j, i] = share
                rest = 1.0 - share
                for k in range(2):
                    target[j, i, k] += share * (q[j, i, k] - q_rest[j, i, k] - x[j, i, k])
                    r = sigma[j, i, k] * sigma[j, i, k]
                    variance[j, i, k] = rest * rest * variance[j, i, k] + share * share * r


@numba.njit(cache=True)
def _settle(target: Float, seen: Float, gain: Float, valid: Mask, x: Float) -> None:
    """X = target without a share K of what the sensor cannot see; all of it where nothing is measured.

    Taking out all of it everywhere would cost the pass band's ripple over K of every dent, not the ripple.
    """
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            share = gain[j, i] if valid[j, i] else 1.0
            for k in range(2):
                x[j, i, k] = target[j, i, k] + share * (seen[j, i, k] - target[j, i, k])


class Composition:
    """Filtered composition against what was shown; see the module. `gain` 0..1 is the upper limit of K.

    Invalid nodes follow a smooth continuation of their neighbours' displacement; nothing leaks to rest.
    A share K of what the sensor cannot see is taken out of the command in every frame, so that it decays as
    fast as the rest is learnt and cannot random-walk.

    Nodes whose pictures are too mixed count as not measured. When they are many the whole command is held:
    what is shown then stays the same until an exposure sees it alone, so that new measurements never starve.
    """

    def __init__(self, rest: Rest, gain: float = 1.0) -> None:
        shape = rest.q.shape
        self._rest = rest
        self._most = gain
        self._least = min(LEAST_GAIN, gain)
        self._x = np.zeros(shape)
        self._variance = np.zeros(shape)
        self._flags = rest.flags.copy()
        self._target = np.empty(shape)
        self._seen = np.empty(shape)
        self._scratch = np.empty((3, *shape[:2]))
        self._gain = np.zeros(shape[:2])
        self._lead = Lead(rest)
        self._estimate = rest.q.copy()
        self.commanded: Float = rest.q.copy()

    @property
    def estimate(self) -> Float:
        """(rows, cols, 2) LCD px, rest and x: the command without its lead."""
        return self._estimate

    @property
    def gain(self) -> Float:
        """(rows, cols) K of the last update; 0 where nothing was measured."""
        return self._gain

    def update(
        self,
        residual: Residual,  # noqa: ARG002 - the integrator needs it
        measured: Warp,
        horizon_s: Float | None = None,
    ) -> bool:
        """Take one frame in; False when its pictures were too mixed and the command was held."""
        mixed = (measured.flags & _MIXED) != 0
        if np.count_nonzero(mixed) > HOLD_ABOVE * mixed.size:
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
            self._gain,
            target,
        )
        continue_smoothly(target, valid, out=target)
        seen = filter_unseen(target, out=self._seen)
        _settle(target, seen, self._gain, valid, x)
        self._flags = measured.flags
        self._estimate = self._rest.q + x
        self.commanded = self._estimate.copy()
        self._lead.add(self.commanded, x, self._gain, measured.time_ns, horizon_s)
        return True

    def filtered(self, time_ns: int) -> Warp:
        """Give x as a warp, without the lead; sigma by the filter's recursion, flags of the last frame."""
        return Warp(self._estimate, np.sqrt(self._variance), self._flags, time_ns)
