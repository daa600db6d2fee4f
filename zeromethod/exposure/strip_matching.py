"""The delay of one frame: its strips matched against the presentation log.

For a delay x between presentation and the panel's first row, the timing model (`zeromethod.exposure.pairing`)
predicts the level of every bit of both strips from the pictures of the log and their codes:

    level = sum over pictures of weight(x, panel row) * bit.

The x that fits all ten levels is found. Any number of pictures may share an exposure. The bit that changes
and the check bit must agree, or nothing fits. No picture is taken for another whose code repeats 16 pictures
later, as the delays searched span less. A frame exposed to one picture alone fits over a range of x, which
then only bounds the delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import PanelTiming, lit_share
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.strip_reading import StripReading
from zeromethod.pattern.strips import CODES, bits_of

MODEL_SIGMA = 0.03
"""Model error of a level, standard deviation: the panel's rise is not exactly exponential, mirrors move."""

FITS_WITHIN = 0.2
"""Largest misfit of any level at which the strips fit."""

POSSIBLE_WITHIN = 0.51
"""Misfit on the coarse scan up to which a fit may lie between its points: half a level at sharp changes.

Where it is above everywhere, no timing explains the strips: a whole bit is wrong.
"""

_MOST_COARSE = 400
_FINE = 61
_LIT = 1 - 1e-4
_LIT_FROM_START = 0.98

_BITS = np.array([bits_of(code) for code in range(CODES)], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Match:
    """Delays that explain a frame's strips, ns: the best, and the ends of the range within 3 sigma of it.

    blur_ns: width of the range due to noise alone. fits: whether any delay explains them; the rest is
    undefined where False. contradicts: whether no picture of the log can have given these strips.
    """

    fits: bool
    contradicts: bool = False
    best_ns: float = math.nan
    low_ns: float = math.nan
    high_ns: float = math.nan
    blur_ns: float = math.nan

    @property
    def plateau_ns(self) -> float:
        """Width of the plateau of delays that fit equally well without noise, ns."""
        return self.high_ns - self.low_ns - self.blur_ns

    @property
    def delay_ns(self) -> float:
        """The best delay, ns; the middle of a plateau that is wider than noise."""
        flat = self.plateau_ns > 1.5 * self.blur_ns
        return 0.5 * (self.low_ns + self.high_ns) if flat else self.best_ns

    @property
    def sigma_ns(self) -> float:
        """Standard deviation of this frame's delay, ns."""
        return (self.high_ns - self.low_ns) / 6


def _scan(
    delays: Float,
    times: Float,
    bits: Float,
    exposure: float,
    tau: float,
    levels: Float,
    scan: Float,
    sigma: Float,
) -> tuple[Float, Float]:
    """Misfit at each delay (n,): sum of squares over variance, and the largest of a level.

    Infinite where a picture before the first was lit. times (k,), bits (k, bits), levels and scan (strips,
    bits), sigma (strips,).
    """
    changes = delays[:, None, None] + scan + times[:, None, None, None]
    lit = lit_share(-0.5 * exposure, 0.5 * exposure, changes, tau)
    lit[lit > _LIT] = 1.0
    # a picture's light is its own and that of all after it, so that each adds what its bits change
    change = np.diff(bits, axis=0)[:, None, None]
    off = np.abs(levels - bits[0] - (lit[1:] * change).sum(axis=0))
    total = (off * off / (sigma * sigma)[:, None]).sum(axis=(1, 2))
    worst = off.max(axis=(1, 2))
    unknown = lit[0].min(axis=(1, 2)) < _LIT_FROM_START
    total[unknown] = worst[unknown] = np.inf
    return total, worst


def _runs(within: Mask) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], within.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def match(
    readings: tuple[StripReading, ...],
    log: PresentationLog,
    frame: Frame,
    timing: PanelTiming,
    span_ns: tuple[float, float],
) -> Match | None:
    """Find the delay within `span_ns` at which the log explains the readings.

    None without evidence: no readings, or a picture without code may have been lit as well.
    """
    pictures = _possible(log, frame, timing, span_ns)
    if not readings or pictures is None:
        return None
    rows = np.stack([reading.panel_rows for reading in readings]) / (timing.rows - 1)
    given = (
        *pictures,
        float(frame.exposure_ns),
        timing.tau_ns,
        np.stack([reading.levels for reading in readings]),
        timing.scanout_ns * (1 - rows if timing.upwards else rows),
        np.hypot(MODEL_SIGMA, np.array([reading.sigma for reading in readings])),
    )
    low, high = span_ns
    coarse = min(_MOST_COARSE, math.ceil(8 * (high - low) / frame.exposure_ns)) + 2
    total, worst = _scan(np.linspace(low, high, coarse), *given)
    if not np.isfinite(total).any():
        return None
    step = (high - low) / (coarse - 1)
    runs = _runs(worst < POSSIBLE_WITHIN)
    # a level's noise, over the change of two levels (a bit and the check) by delay
    blur_ns = 6 * MODEL_SIGMA * frame.exposure_ns / math.sqrt(2)
    found: list[Match] = []
    for begin, end in runs:
        around = max(low, low + (begin - 1) * step), min(high, low + (end + 1) * step)
        here = _refined(around, span_ns, blur_ns, given)
        if here is None:
            return None
        if here.fits:
            found.append(here)
    if len(found) == 1:
        return found[0]
    # a delay at which a picture without code is lit is never ruled out
    return Match(fits=False, contradicts=not runs and bool(np.isfinite(total).all()))


def _possible(
    log: PresentationLog, frame: Frame, timing: PanelTiming, span_ns: tuple[float, float]
) -> tuple[Float, Float] | None:
    """(k,) ns after mid-exposure and (k, bits) of the pictures that a frame may have seen.

    None where a picture without code may be among them.
    """
    codes = log.codes()
    coded = codes >= 0
    if not len(coded) or not coded[-1]:
        return None
    first = int(np.max(np.flatnonzero(~coded), initial=-1)) + 1
    after_start = log.times_ns() - frame.time_ns
    # all that began to change long before the exposure, whatever the delay, but for the last of them
    settled = -0.5 * frame.exposure_ns - span_ns[1] - timing.scanout_ns - 12 * timing.tau_ns
    first = max(first, int(np.searchsorted(after_start, settled, side="right")) - 1)
    stop = int(np.searchsorted(after_start, 0.5 * frame.exposure_ns - span_ns[0], side="left"))
    if stop <= first:
        return None
    return after_start[first:stop].astype(np.float64), _BITS[codes[first:stop]]


def _refined(
    around: tuple[float, float], span_ns: tuple[float, float], blur_ns: float, given: tuple[Any, ...]
) -> Match | None:
    """The best match around a possible delay, found in two finer scans.

    None where the delays fit up to where the uncoded picture before all of these would be seen: that may have
    had a part in the exposure, and then nothing can be said.
    """
    a, b = around
    for _ in range(2):
        fine, fine_worst = _scan(np.linspace(a, b, _FINE), *given)
        best = int(np.argmin(fine))
        near = np.flatnonzero(fine < fine[best] + 9)
        here = _located(a, b, fine, best, near, blur_ns)
        pad = (b - a) / (_FINE - 1)
        a, b = max(span_ns[0], here.low_ns - pad), min(span_ns[1], here.high_ns + pad)
    if fine_worst[best] >= FITS_WITHIN:
        return Match(fits=False)
    if near[-1] + 1 < _FINE and math.isinf(fine[near[-1] + 1]):
        return None
    return here


def _located(a: float, b: float, fine: Float, best: int, near: Ints, blur_ns: float) -> Match:
    """Best delay and the ends of the range as good, of a scan from a to b."""
    step = (b - a) / (len(fine) - 1)
    shift = 0.0
    if 0 < best < len(fine) - 1 and np.isfinite(fine[best - 1] + fine[best + 1]):
        left, middle, right = fine[best - 1 : best + 2]
        bend = left - 2 * middle + right
        shift = 0.5 * (left - right) / bend if bend > 0 else 0.0
    low, high = a + int(near[0]) * step, a + int(near[-1]) * step
    return Match(True, False, a + (best + shift) * step, low, high, blur_ns)
