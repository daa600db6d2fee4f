"""Which warps an exposure saw: the presentation log through the panel's timing.

A pixel in LCD row r starts to change at T = presentation + latency + s scanout (s = r / (rows - 1), from
the other end when the panel scans up) and follows as h(t) = 1 - exp(-(t - T) / tau), tau = rise / ln 9 for
a rise from 10 to 90 %. Light is linear in the pictures, so picture k weighs H_k - H_(k+1) in an exposure
[a, b], where H_k is the mean of h(t - T_k) over it:

    H = [b - c - tau (exp(-(c - T) / tau) - exp(-(b - T) / tau))] / (b - a),  c = max(a, T), 0 when b <= T

Near null the carrier's phase is linear in the warp, so a mix of pictures acts as the mix of their warps
with the same weights; the error grows with the third power of how far apart they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.control.presentation import PresentationLog
from zeromethod.devices.protocols import Frame
from zeromethod.rig.model import DisplaySpec

Float = NDArray[np.float64]

TABLE_ROWS = 257
"""Panel rows at which weights are computed, 65 us of scan-out apart at 60 Hz; linear between them."""

LEAST_WEIGHT = 1e-4
"""Pictures that weigh less in every row are left out."""

SPREAD_WEIGHT = 0.02
"""Pictures that weigh less at a node do not count for its spread."""

SAME_LCD_PX = 1 / 16
"""Warps closer than this, at a node, are one for its spread: their difference is noise."""

LIT_SHARE = 0.98
"""An exposure that started before this share of the first picture's light is of no use."""


@dataclass(frozen=True)
class PanelTiming:
    """When an LCD row follows a presentation. Times in ns; see the module."""

    latency_ns: float
    scanout_ns: float
    tau_ns: float
    rows: int
    upwards: bool

    @classmethod
    def of(cls, display: DisplaySpec) -> PanelTiming:
        """Take the timing that the rig states."""
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
class Shown:
    """What was lit while a frame was exposed.

    q: (rows, cols, 2) mixed warp, LCD px. spread_px: (rows, cols) how far apart the warps in the mix are,
    camera px; None when there is one warp only. entries: (k,) presentation times, ns. weights: (k, n) share
    of each at n panel rows, equally spaced in scan-out order, adding up to 1 in each.
    """

    q: Float
    spread_px: Float | None
    entries: NDArray[np.int64]
    weights: Float


def lit_share(start_ns: float, end_ns: float, change_ns: Float, tau_ns: float) -> Float:
    """H above: mean over the exposure of the light of a pixel that starts to change at `change_ns`."""
    from_ns = np.clip(change_ns, start_ns, end_ns)
    lit = end_ns - from_ns
    if tau_ns > 0:
        late = np.exp(-np.maximum(from_ns - change_ns, 0) / tau_ns)
        lit = lit - tau_ns * (late - np.exp(-np.maximum(end_ns - change_ns, 0) / tau_ns))
    share: Float = lit / (end_ns - start_ns)
    return share


def entry_weights(
    times_ns: NDArray[np.int64], complete: bool, frame: Frame, timing: PanelTiming
) -> tuple[Float, Float]:
    """Weight of every presentation in the exposure of `frame` at `TABLE_ROWS` rows, in scan-out order.

    Returns ((k, n) weights, (n,) share of light from before the first entry; 0 when older entries are no
    longer in the log, `complete` False: the oldest one then stands for them).
    """
    scan = np.linspace(0.0, timing.scanout_ns, TABLE_ROWS)
    start = -0.5 * frame.exposure_ns
    # Relative to mid-exposure, as nanoseconds since boot need more digits than a double has to spare.
    changes = (times_ns - frame.time_ns)[:, None] + timing.latency_ns + scan
    lit = np.stack([lit_share(start, -start, change, timing.tau_ns) for change in changes])
    dark = 1 - lit[0]
    if not complete:
        lit[0] = 1.0
        dark = np.zeros(TABLE_ROWS)
    lit[:-1] -= lit[1:]
    return lit, dark


@numba.njit(cache=True, fastmath={"contract", "reassoc"})
def _apart(w: Float, j: int, i: int, dx: float, dy: float, inverse_spacing: float) -> float:
    """Camera px, to first order, that a step (dx, dy) LCD px is on warp `w` at node (j, i)."""
    j0, j1 = max(j - 1, 0), min(j + 1, w.shape[0] - 1)
    i0, i1 = max(i - 1, 0), min(i + 1, w.shape[1] - 1)
    du, dv = inverse_spacing / (i1 - i0), inverse_spacing / (j1 - j0)
    xu, yu = du * (w[j, i1, 0] - w[j, i0, 0]), du * (w[j, i1, 1] - w[j, i0, 1])
    xv, yv = dv * (w[j1, i, 0] - w[j0, i, 0]), dv * (w[j1, i, 1] - w[j0, i, 1])
    away: float = math.hypot(yv * dx - xv * dy, xu * dy - yu * dx) / max(abs(xu * yv - xv * yu), 1e-12)
    return away


@numba.njit(cache=True, fastmath={"contract", "reassoc"})
def _mix(
    warps: Float,
    slots: NDArray[np.int64],
    weights: Float,
    look_q: Float,
    rows_per_entry: float,
    upwards: bool,
    inverse_spacing: float,
    q: Float,
    spread: Float,
) -> None:
    """Mix of `warps[slots]` by `weights` (n panel rows, entries) and its spread in camera px."""
    count, rows, cols = slots.size, q.shape[0], q.shape[1]
    last = weights.shape[0] - 1
    share = np.empty(count)
    for j in range(rows):
        for i in range(cols):
            x = min(max(look_q[j, i, 1] * rows_per_entry, 0.0), float(last))
            if upwards:
                x = last - x
            n = min(int(x), last - 1)
            t = x - n
            a = b = 0.0
            best = 0
            for k in range(count):
                share[k] = (1.0 - t) * weights[n, k] + t * weights[n + 1, k]
                a += share[k] * warps[slots[k], j, i, 0]
                b += share[k] * warps[slots[k], j, i, 1]
                if share[k] > share[best]:
                    best = k
            q[j, i, 0] = a
            q[j, i, 1] = b
            spread[j, i] = 0.0
            w = warps[slots[best]]
            for k in range(count):
                if k != best and share[k] > SPREAD_WEIGHT:
                    dx = warps[slots[k], j, i, 0] - w[j, i, 0]
                    dy = warps[slots[k], j, i, 1] - w[j, i, 1]
                    if abs(dx) > SAME_LCD_PX or abs(dy) > SAME_LCD_PX:
                        spread[j, i] = max(spread[j, i], _apart(w, j, i, dx, dy, inverse_spacing))


def pair(
    log: PresentationLog, frame: Frame, timing: PanelTiming, look_q: Float, spacing_px: float
) -> Shown | None:
    """Tell what the exposure of `frame` saw; None when no picture of the log was fully lit before it.

    look_q: (rows, cols, 2) where the nodes look on the panel, LCD px, to a few rows: the latest estimate.
    spacing_px: camera px between nodes. Where one picture was alone its warp is returned as logged (a
    view), and that is the usual case with patterns that are held.
    """
    times = log.times_ns()
    if not len(times):
        return None
    # A picture whose last row has long settled hides all before it; a picture that starts after the
    # exposure was not seen.
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
    entries = times[first + kept]
    if len(kept) == 1:
        return Shown(log.warp(first + int(kept[0])), None, entries, weights)
    q = np.empty_like(look_q)
    spread = np.empty(q.shape[:2])
    per_row = (TABLE_ROWS - 1) / (timing.rows - 1)
    slots = log.slots(first + kept)
    table = np.ascontiguousarray(weights.T)
    _mix(log.buffer, slots, table, look_q, per_row, timing.upwards, 1 / spacing_px, q, spread)
    return Shown(q, spread, entries, weights)
