"""Pairing of frames with pictures: which warps an exposure contains, by the log and the panel's timing.

A pixel in LCD row r starts to change at T = presentation + latency + s scanout (s = r / (rows - 1), from
the other end when the panel scans up) and follows as h(t) = 1 - exp(-(t - T) / tau), tau = rise / ln 9 for
a rise from 10 to 90 %. Light is linear in the pictures, so picture k weighs H_k - H_(k+1) in an exposure
[a, b], where H_k is the mean of h(t - T_k) over it:

    H = [b - c - tau (exp(-(c - T) / tau) - exp(-(b - T) / tau))] / (b - a),  c = max(a, T), 0 when b <= T

Near null the carrier's phase is linear in the warp, so a mix of pictures acts as the mix of their warps
with the same weights. `zeromethod.exposure.mixture` computes the remaining error and where it is too large.
What a moving target adds is no displacement: its phase in each frame is known (`exposure.target_phase`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from zeromethod.arrays import Float, Ints
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.mixture import Mixture, mixture
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.target_phase import Lit, Sight, TargetPhase, carrier_turns
from zeromethod.kernels import kernel, piece, read
from zeromethod.rig.model import DisplaySpec
from zeromethod.rounding import REORDERED
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Role, Warp

TABLE_ROWS = 257
"""Panel rows at which weights are computed, 65 us of scan-out apart at 60 Hz; linear between them."""

_SCAN = np.linspace(0.0, 1.0, TABLE_ROWS)

LEAST_WEIGHT = 1e-4
"""Pictures with less weight than this in every row are left out."""

SAME_ROW = 0.25
"""Panel rows between the assumed row and the mix's that need no second iteration: 4 us of scan-out."""

LIT_SHARE = 0.98
"""Least share of light from logged pictures; an exposure with less has no observation."""


@dataclass(frozen=True)
class PanelTiming:
    """Panel timing: when each LCD row follows a presentation. Times in ns; see the module."""

    latency_ns: float
    scanout_ns: float
    tau_ns: float
    rows: int
    upwards: bool

    @classmethod
    def of(cls, display: DisplaySpec) -> PanelTiming:
        """Timing stated in the rig file."""
        scanout_s = 1 / display.refresh_hz if display.scanout_s is None else display.scanout_s
        return cls(
            latency_ns=1e9 * display.latency_s,
            scanout_ns=1e9 * scanout_s,
            tau_ns=1e9 * display.rise_s / math.log(9),
            rows=display.rows,
            upwards=display.scan == "up",
        )

    @property
    def half_lit_ns(self) -> float:
        """From presentation to half the light's change in the panel's middle row."""
        return self.latency_ns + 0.5 * self.scanout_ns + self.tau_ns * math.log(2)


@dataclass(frozen=True, slots=True)
class Observation:
    """A frame and the warp that was shown in it.

    shown: the mix of the warps that were lit during the exposure. mixture: what the mixing does to the
    residual; None when one warp was lit alone. entries: (k,) presentation times, ns. weights: (k, n) share of
    each at n panel rows, equally spaced in scan-out order, adding up to 1 in each. age_ns: (n,) from
    mid-exposure of the frames by which the pictures were drawn to that of this one, weighted likewise; None
    where a picture was drawn by none. target: known phase of a moving target; None where all pictures show it
    where it stands in the rig file.
    """

    frame: Frame
    shown: Warp
    mixture: Mixture | None
    entries: Ints
    weights: Float
    age_ns: Float | None
    target: TargetPhase | None = None


def lit_share(start_ns: float | Float, end_ns: float | Float, change_ns: Float, tau_ns: float) -> Float:
    """H of the module: mean light over the exposure of a pixel that starts to change at `change_ns`, 0..1."""
    from_ns = np.clip(change_ns, start_ns, end_ns)
    lit = end_ns - from_ns
    if tau_ns > 0:
        late = np.exp(-np.maximum(from_ns - change_ns, 0) / tau_ns)
        lit = lit - tau_ns * (late - np.exp(-np.maximum(end_ns - change_ns, 0) / tau_ns))
    share: Float = lit / (end_ns - start_ns)
    return share


def lit_share_per_s(start_ns: float, end_ns: float, change_ns: Float, tau_ns: float) -> Float:
    """Change of `lit_share` per second by which the pixel starts to change later."""

    def risen(at_ns: float) -> Float:
        if tau_ns == 0:
            return np.asarray((at_ns >= change_ns) * 1.0)
        return np.asarray(-np.expm1(-np.maximum(at_ns - change_ns, 0) / tau_ns))

    return np.asarray(-1e9 * (risen(end_ns) - risen(start_ns)) / (end_ns - start_ns))


def entry_weights(times_ns: Ints, complete: bool, frame: Frame, timing: PanelTiming) -> tuple[Float, Float]:
    """Weight of every presentation in the exposure of `frame` at `TABLE_ROWS` rows, in scan-out order.

    Returns ((k, n) weights, (n,) share of light from before the first entry). The share is 0 when older
    entries are no longer in the log (`complete` False): the oldest entry then stands for them.
    """
    half = 0.5 * frame.exposure_ns
    changes = _changes_ns(times_ns, frame, timing)[:, None] + timing.scanout_ns * _SCAN
    weights = lit_share(-half, half, changes, timing.tau_ns)
    if not complete:
        weights[0] = 1.0
    dark = 1.0 - weights[0]
    weights[:-1] -= weights[1:]
    return weights, dark


def late_weights_per_s(times_ns: Ints, complete: bool, frame: Frame, timing: PanelTiming) -> Float:
    """(k, n) change of `entry_weights` per second by which all was lit later than `timing` says."""
    half = 0.5 * frame.exposure_ns
    changes = _changes_ns(times_ns, frame, timing)[:, None] + timing.scanout_ns * _SCAN
    rates = lit_share_per_s(-half, half, changes, timing.tau_ns)
    if not complete:
        rates[0] = 0.0
    rates[:-1] -= rates[1:]
    return rates


def _changes_ns(times_ns: Ints, frame: Frame, timing: PanelTiming) -> Float:
    """(k,) when the first row starts to change, from mid-exposure on."""
    # nanoseconds since boot need more digits than a double has to spare
    return np.asarray(times_ns - frame.time_ns, dtype=np.float64) + timing.latency_ns


@piece(fastmath=REORDERED, inline="always")
def _mix_at(warps: Float, slots: Ints, weights: Float, place: float, j: int, i: int) -> tuple[float, float]:
    """LCD position of the mix at a node that looks at this place among the panel rows of the weights."""
    n = min(int(place), weights.shape[0] - 2)
    t = place - n
    x = y = 0.0
    for k in range(slots.size):
        share = weights[n, k] + t * (weights[n + 1, k] - weights[n, k])
        x += share * warps[slots[k], j, i, 0]
        y += share * warps[slots[k], j, i, 1]
    return x, y


@kernel(
    read(numba.float64, 4),
    read(numba.int64, 1),
    read(numba.float64, 2),
    read(numba.float64, 3),
    numba.float64,
    numba.boolean,
    numba.float64[:, :, ::1],
    numba.float64[:, ::1],
    fastmath=REORDERED,
)
def _mix(
    warps: Float,
    slots: Ints,
    weights: Float,
    look_q: Float,
    rows_per_entry: float,
    upwards: bool,
    q: Float,
    place: Float,
) -> None:
    """Mix of `warps[slots]` by `weights` (n panel rows, entries) at each node's panel row, in `q`, `place`.

    The row is that of the mix itself, so that q and the weights are consistent at every point of the target;
    at most two iterations from `look_q` find it to far less than a row.
    """
    last = float(weights.shape[0] - 1)
    for j in range(q.shape[0]):
        for i in range(q.shape[1]):
            row = look_q[j, i, 1]
            for _ in range(2):
                at = min(max(row * rows_per_entry, 0.0), last)
                place[j, i] = last - at if upwards else at
                q[j, i, 0], q[j, i, 1] = _mix_at(warps, slots, weights, place[j, i], j, i)
                if abs(q[j, i, 1] - row) < SAME_ROW:
                    break
                row = q[j, i, 1]


def pair(
    log: PresentationLog,
    frame: Frame,
    timing: PanelTiming,
    look_q: Float,
    grid: NodeGrid,
    kind: str,
    sight: Sight | None = None,
) -> Observation | None:
    """Observation of one frame; None when no picture of the log was fully lit before its exposure.

    look_q: (rows, cols, 2) where the nodes look on the panel, LCD px, to some tens of rows: the latest
    estimate. kind: the target's. sight: None for single points, seen sharply. Where only one picture was lit
    its warp is returned as logged (a view): the usual case while the pattern does not change.
    """
    times = log.times_ns()
    if not len(times):
        return None
    # A picture whose last row has long settled replaces all before it; a picture that starts after the
    # exposure has no part in it.
    end_ns = frame.time_ns + 0.5 * frame.exposure_ns
    settled_ns = end_ns - frame.exposure_ns - timing.latency_ns - timing.scanout_ns - 12 * timing.tau_ns
    first = max(int(np.searchsorted(times, settled_ns, side="right")) - 1, 0)
    stop = int(np.searchsorted(times, end_ns - timing.latency_ns, side="left"))
    if stop <= first:
        return None
    alone = first > 0 or not log.complete
    weights, dark = entry_weights(times[first:stop], not alone, frame, timing)
    if dark.max() > 1 - LIT_SHARE:
        return None
    kept = np.flatnonzero(weights.max(axis=1) > LEAST_WEIGHT)
    weights = weights[kept]
    weights /= weights.sum(axis=0)
    index = first + kept
    age_ns = _age_ns(log, index, weights, frame.time_ns)
    diagonal = kind == "checker"
    turns = carrier_turns(log.shifts(index), diagonal)

    def late_per_s() -> Float:
        return late_weights_per_s(times[first:stop], not alone, frame, timing)[kept]

    def target(shown_q: Float) -> TargetPhase | None:
        if not turns.any():
            return None
        by = sight or Sight(timing.rows, timing.upwards, 0.0, np.zeros(2))
        return TargetPhase.of(Lit(turns, weights, late_per_s), diagonal, by, shown_q)

    if len(kept) == 1:
        shown = Warp.drawn(log.warp(int(index[0])), Role.SHOWN, frame.time_ns)
        return Observation(frame, shown, None, times[index], weights, age_ns, target(shown.q))
    q = np.empty_like(look_q)
    place = np.empty(q.shape[:2])
    per_row = (TABLE_ROWS - 1) / (timing.rows - 1)
    slots = log.slots(index)
    table = np.ascontiguousarray(weights.T)
    _mix(log.buffer, slots, table, look_q, per_row, timing.upwards, q, place)
    known = target(q)
    moving = None if known is None else (turns, known.rad)
    size = grid.spacing_px, grid.period_px
    mixing = mixture(log.buffer, slots, table, place, q, *size, kind, moving)
    shown = Warp.drawn(q, Role.SHOWN, frame.time_ns)
    return Observation(frame, shown, mixing, times[index], weights, age_ns, known)


def _age_ns(log: PresentationLog, index: Ints, weights: Float, time_ns: int) -> Float | None:
    seen = [log.source_ns(int(k)) for k in index]
    if None in seen:
        return None
    ages: Float = sum(
        float(time_ns - one) * row for one, row in zip(seen, weights, strict=True) if one is not None
    )
    return ages
