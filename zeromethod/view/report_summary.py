"""The figures of a recording: what `--summary` writes and the page's first table says."""

from __future__ import annotations

from typing import Any

import numpy as np

from zeromethod.approach import Approach
from zeromethod.arrays import Float, Image, Mask
from zeromethod.interactive.pointers import PointerEvent
from zeromethod.loop.state import GOOD, READ, State
from zeromethod.recording.recording import Recording
from zeromethod.recording.schema import STATES
from zeromethod.rubbing import ContactStatus
from zeromethod.session.interaction import pointer_rows
from zeromethod.session.status_figures import status_figures
from zeromethod.session.watching import approach_rows
from zeromethod.view.report_history import WITHOUT_READING, episodes, shares

Figures = dict[str, Any]


def summarise_recording(recording: Recording) -> Figures:
    """All figures; keys ending in a unit carry it, times are s from the first step, None: unknown.

    Figures "while nulled" are of the steps whose picture was right; of all steps, where there is none.
    """
    steps, peaks, drops = recording.steps, read_peaks(recording), recording.drops
    spent = episodes(recording)
    share_of = shares(spent)
    ends = [one for one in spent if one.state != State.STOPPED] or spent
    frames = steps["time_ns"][steps["frame_number"] >= 0]
    span_s = 1e-9 * float(frames[-1] - frames[0]) if len(frames) > 1 else 0.0
    nulled = np.isin(steps["state"], [STATES.index(state) for state in READ])
    events = [event for step in steps[steps["events"] != 0] for event in recording.events_of(step)]
    return {
        "complete": recording.complete,
        "live": recording.live,
        "seconds": recording.seconds,
        "steps": len(steps),
        "frames": len(frames),
        "rate_hz": (len(frames) - 1) / span_s if span_s > 0 else None,
        "state": ends[-1].state if ends else None,
        "calibrated": not recording.rig.geometry.relative,
        "reason": ends[-1].reason if ends else "",
        "shares": share_of,
        "locked_share": sum(share_of.get(state, 0.0) for state in GOOD),
        "residual_px_rms": _spread(steps["residual_rms_px"], nulled),
        "valid_share": _spread(steps["valid_share"], nulled)["median"],
        "largest": peak_figures(largest_peak(peaks)),
        "last": peak_figures(peaks[-1:]),
        "loop_ms": _spread(steps["loop_ms"]),
        "draw_ms": _spread(steps["draw_ms"]),
        "delay_ms": _spread(steps["delay_ms"]),
        "read_ms": _spread(recording.peaks["read_ms"]),
        "without_reading": {str(event): events.count(event) for event in WITHOUT_READING},
        "dropped": {
            recording.text(by): int(drops["count"][drops["lost_by"] == by].sum())
            for by in set(drops["lost_by"])
        },
        "contacts": contact_figures(recording),
        "contact_status": status_figures(_status(recording)),
        **_events(recording),
        "fine": fine_figures(recording),
        "notes": [recording.text(text) for text in recording.notes["text"]],
    }


def contact_figures(recording: Recording) -> list[Figures]:
    """What touched, by id: when, and the medians of its figures."""
    rows, steps = recording.contacts, recording.steps
    start_ns = steps["time_ns"][0] if len(steps) else 0
    found = []
    for number in np.unique(rows["id"]):
        own = rows[rows["id"] == number]
        times_s = 1e-9 * (own["time_ns"] - start_ns)
        kinds = {name: own.dtype[name] for name in own.dtype.names or ()}
        names = [name for name, kind in kinds.items() if kind.kind == "f" and not kind.shape]
        medians = {name: float(np.median(own[name])) for name in names}
        found.append({"id": int(number), "from_s": float(times_s[0]), "to_s": float(times_s[-1]), **medians})
    return found


def _status(recording: Recording) -> list[tuple[float, ContactStatus]]:
    """How a texture rubbed, (time s, status) frame by frame."""
    rows, steps = recording.tables.contact_status(), recording.steps
    start_ns = steps["time_ns"][0] if len(steps) else 0
    return [(1e-9 * float(row["time_ns"] - start_ns), ContactStatus.of_row(row)) for row in rows]


def _events(recording: Recording) -> Figures:
    """What came before it touched, and what fingers did; None where the rig has no such thing."""
    steps, coming = recording.steps, recording.tables.approaches()
    start_ns = int(steps["time_ns"][0]) if len(steps) else 0
    at_ns = dict(zip(steps["number"].tolist(), steps["time_ns"].tolist(), strict=True))
    seen = ((at_ns.get(int(one["step"]), int(one["time_ns"])), Approach.of_row(one)) for one in coming)
    fingers = (PointerEvent.of_row(one) for one in recording.tables.pointers())
    return {
        "approaches": approach_rows(seen, start_ns),
        "pointers": None if recording.rig.projector is None else pointer_rows(fingers, start_ns),
    }


def fine_figures(recording: Recording) -> Figures | None:
    """How many fine surfaces were read, the last one's peak and the largest |peak|; None of none."""
    peaks = recording.fine_peaks
    if not len(peaks):
        return None
    names = ("depth_mm", "depth_sigma_mm", "x_mm", "y_mm", "valid_share")
    last, largest = peaks[-1], peaks[np.argmax(np.nan_to_num(np.abs(peaks["depth_mm"]), nan=-1.0))]
    found = {"surfaces": len(peaks)} | {name: float(last[name]) for name in names}
    return found | {"largest": {name: float(largest[name]) for name in names[:4]}}


def read_peaks(recording: Recording) -> Image:
    """Rows of `Recording.peaks` with a depth, and with a step: a killed writer may have lost some."""
    peaks = recording.peaks
    found: Image = peaks[np.isfinite(peaks["depth_mm"]) & np.isin(peaks["step"], recording.turns["number"])]
    return found


def largest_peak(peaks: Image) -> Image:
    """The row with the largest |depth|, a dent or a bulge, alone; none of none.

    Those of nulled steps come before all others.
    """
    nulled = peaks[np.isin(peaks["state"], [state.value for state in READ])]
    among = nulled if len(nulled) else peaks
    return np.asarray(among[np.argsort(-np.abs(among["depth_mm"]), kind="stable")[:1]])


def peak_figures(peaks: Image) -> Figures | None:
    """The first of these rows in figures; None of none."""
    if not len(peaks):
        return None
    peak = peaks[0]
    lengths = {name: float(peak[name]) for name in ("depth_mm", "x_mm", "y_mm", "x_sigma_mm", "y_sigma_mm")}
    about = {"step": int(peak["step"]), "time_s": float(peak["time_s"]), "state": str(peak["state"])}
    about["where"] = str(peak["where"])
    return about | {"sigma_mm": float(peak["depth_sigma_mm"])} | lengths


def _spread(values: Float, among: Mask | None = None) -> dict[str, float | None]:
    """Median and 99th percentile of what is finite, among those wanted where there are any."""
    finite = np.isfinite(values)
    if among is not None and (finite & among).any():
        finite &= among
    if not finite.any():
        return {"median": None, "p99": None}
    return {"median": float(np.median(values[finite])), "p99": float(np.percentile(values[finite], 99))}
