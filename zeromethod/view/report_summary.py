"""The figures of a recording: what `--summary` writes and the page's first table says."""

from __future__ import annotations

from typing import Any

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.loop.state import NULLED, State
from zeromethod.recording.recording import Recording
from zeromethod.view.report_history import (
    WITHOUT_READING,
    at_turns,
    episodes,
    seconds,
    shares,
    start_ns,
    states,
    words,
)

Figures = dict[str, Any]


def summarise_recording(recording: Recording) -> Figures:
    """All figures; keys ending in a unit carry it, times are s from the first turn, None: unknown.

    Figures "while nulled" are of the turns locked or resting; of all turns, where there is none.
    """
    turns, peaks, drops = recording.steps, recording.peaks, recording.drops
    spent = episodes(recording)
    share_of = shares(spent)
    ends = [one for one in spent if one.state != State.STOPPED] or spent
    frames = turns["time_ns"][turns["frame_number"] >= 0]
    span_s = 1e-9 * float(frames[-1] - frames[0]) if len(frames) > 1 else 0.0
    nulled = nulled_turns(recording)
    return {
        "complete": bool(recording.complete),
        "live": bool(recording.live),
        "seconds": float(recording.seconds),
        "turns": len(turns),
        "frames": len(frames),
        "rate_hz": (len(frames) - 1) / span_s if span_s > 0 else None,
        "state": ends[-1].state if ends else None,
        "reason": ends[-1].reason if ends else "",
        "shares": share_of,
        "locked_share": sum(share_of.get(str(state), 0.0) for state in NULLED),
        "residual_px_rms": _spread(turns["residual_rms_px"], nulled),
        "valid_share": _spread(turns["valid_share"], nulled)["median"],
        "largest": peak_figures(recording, largest_peak(recording)),
        "last": peak_figures(recording, last_peak(recording)),
        "loop_ms": _spread(turns["loop_ms"]),
        "draw_ms": _spread(turns["draw_ms"]),
        "delay_ms": _spread(turns["delay_ms"]),
        "read_ms": _spread(peaks["read_ms"]),
        "without_reading": {
            str(event): int(sum(event in recording.events_of(turn) for turn in turns[turns["events"] != 0]))
            for event in WITHOUT_READING
        },
        "dropped": {
            words(by): int(drops["count"][drops["lost_by"] == by].sum()) for by in set(drops["lost_by"])
        },
        "notes": [words(text) for text in recording.notes["text"]],
    }


def nulled_turns(recording: Recording) -> Mask:
    """(turns,) which were locked or resting."""
    return np.isin(states(recording), [str(state) for state in NULLED])


def largest_peak(recording: Recording, among: Mask | None = None) -> int | None:
    """Row of the peak with the largest |depth|, a dent or a bulge; None where none was read.

    among: (peaks,) rows to choose from. Those of nulled turns come before all others.
    """
    known = _known(recording) & (True if among is None else among)
    index, _ = at_turns(recording, recording.peaks["step"])
    depth = np.abs(recording.peaks["depth_mm"])
    if not known.any():
        return None
    nulled = known & nulled_turns(recording)[index]
    return int(np.argmax(np.where(nulled if nulled.any() else known, depth, -1.0)))


def last_peak(recording: Recording) -> int | None:
    """Row of the last peak that was read; None without."""
    rows = np.flatnonzero(_known(recording))
    return int(rows[-1]) if len(rows) else None


def _known(recording: Recording) -> Mask:
    """(peaks,) which have a depth, and a turn in the recording."""
    _, there = at_turns(recording, recording.peaks["step"])
    return np.asarray(there & np.isfinite(recording.peaks["depth_mm"]))


def peak_figures(recording: Recording, row: int | None) -> Figures | None:
    """One row of the peaks, whose turn is in the recording, with its time and state; None for None."""
    if row is None:
        return None
    peak = recording.peaks[row]
    turn = recording.row(int(peak["step"]))
    return {
        "turn": int(peak["step"]),
        "time_s": float(seconds(turn["time_ns"], start_ns(recording))),
        "state": str(recording.state_of(turn)),
        "sigma_mm": float(peak["depth_sigma_mm"]),
        **{name: float(peak[name]) for name in ("depth_mm", "x_mm", "y_mm")},
    }


def _spread(values: Float, among: Mask | None = None) -> dict[str, float | None]:
    """Median and 99th percentile of what is finite, among those wanted where there are any."""
    finite = np.isfinite(values)
    if among is not None and (finite & among).any():
        finite &= among
    if not finite.any():
        return {"median": None, "p99": None}
    return {"median": float(np.median(values[finite])), "p99": float(np.percentile(values[finite], 99))}
