"""The figures of a run, as `--summary` writes them and the terminal prints them."""

from __future__ import annotations

import platform
import statistics
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from zeromethod.errors import check_type
from zeromethod.loop.state import GOOD, LOCK_FRAMES, LOCK_RESIDUAL_PX, NULLED, READ, State
from zeromethod.loop.step import StepFigures
from zeromethod.rig.model import SIMULATED
from zeromethod.session.contact_figures import contact_rows, force_figures, true_contact_rows
from zeromethod.session.interaction import pointer_rows
from zeromethod.session.result import RunResult
from zeromethod.session.status_figures import status_figures
from zeromethod.session.watching import approach_rows

Figures = dict[str, Any]

_FOLLOWING = GOOD | {State.NULLING}
"""A moving press is never quite nulled; every frame that was measured counts."""

_SEES_TARGET = GOOD | {State.UNCALIBRATED, State.MOVED, State.COVERED}
"""States that no run is blamed for: it is nulled, or something covers the mirror."""
_TAIL_S, _LEAST_TAIL_S = 5.0, 1.0
"""End of a run without a scenario that must be nulled, and its least length in a short run."""

_LIBRARIES = ("zeromethod", "numpy", "scipy", "numba", "opencv-contrib-python-headless", "moderngl")


@cache
def _versions() -> Mapping[str, str]:
    return {name: version(name) for name in _LIBRARIES}


def lock_frames(records: list[StepFigures]) -> int | None:
    """Frames from the start of the hold (of the run, where there is none) to the first locked one.

    Locked: residual rms below 0.05 camera px for three consecutive frames; the first of the three counts.
    None: never locked.
    """
    inside = [record for record in records if record.phase == "hold"] or records
    run_length = 0
    for index, record in enumerate(inside):
        run_length = run_length + 1 if record.residual_rms_px < LOCK_RESIDUAL_PX else 0
        if run_length == LOCK_FRAMES:
            return index - LOCK_FRAMES + 2
    return None


def not_nulled(records: list[StepFigures], *, read_counts: bool = False) -> str | None:
    """When a run did not hold the null though it should have, in words; None where it did.

    A scenario's hold must be nulled at some time; of a run that ends before, the end. Without a scenario, so
    must the last 5 s, or half of a shorter run (1 s at least), as a loop that began at rest may have been
    thrown off by the first press.
    read_counts: so does a frame that was read without: where fingers press a cloth, and their places and
    forces are wanted, the mirror beside them bends too fast for the null.
    """

    def counts(record: StepFigures) -> bool:
        return record.state in _SEES_TARGET or (read_counts and bool(np.isfinite(record.read_ms)))

    held = [record for record in records if record.phase == "hold"]
    running = [record for record in records if record.state is not State.STOPPED]
    if not any(map(counts, held or running)):
        return "during the hold" if held else "in the whole run"
    if any(record.phase for record in records):
        lost = running[-1].state is State.NULLING and not counts(running[-1])
        return "when the run ended" if lost and not held else None
    length_s = running[-1].time_s - running[0].time_s
    tail_s = max(min(_TAIL_S, 0.5 * length_s), _LEAST_TAIL_S)
    tail = [record for record in running if record.time_s >= running[-1].time_s - tail_s]
    if any(one.state is State.NULLING for one in tail) and not any(
        counts(one) or one.state is State.PAUSED for one in tail
    ):
        return f"in the last {tail_s:.1f} s"
    return None


def _percentiles(values: Iterable[float]) -> Figures:
    finite = [value for value in values if np.isfinite(value)]
    if not finite:
        return {"median": None, "p99": None}
    return {"median": float(np.median(finite)), "p99": float(np.percentile(finite, 99))}


def _against_truth(records: list[StepFigures], phase: str, states: frozenset[State]) -> Figures | None:
    """Errors over one phase's frames in `states`: the peak's worst frame, rms over all nodes and frames."""
    among = [record for record in records if record.phase == phase and record.state in states]
    errors = [record.truth for record in among if record.truth is not None]
    if not errors:
        return None
    worst = max(errors, key=lambda error: np.nan_to_num(abs(error.depth_peak_error_percent), nan=-1.0))

    def rms(values: list[float]) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    return {
        "frames": len(errors),
        "depth_peak_mm": float(np.median([error.depth_peak_mm for error in errors])),
        "depth_deepest_mm": float(np.median([error.depth_deepest_mm for error in errors])),
        "depth_peak_error_percent": worst.depth_peak_error_percent,
        "depth_peak_error_sigma_percent": worst.depth_peak_error_sigma_percent,
        "depth_peak_error_mean_percent": float(np.mean([error.depth_peak_error_percent for error in errors])),
        "depth_rms_error_um": rms([error.depth_rms_error_um for error in errors]),
        "slope_rms_error_mrad": rms([error.slope_rms_error_mrad for error in errors]),
        "usable_share": float(np.mean([error.usable_share for error in errors])),
        "valid_share": float(np.min([error.valid_share for error in errors])),
        "contacts": true_contact_rows(among),
    }


def _untouched(records: list[StepFigures]) -> Figures | None:
    values = [record.untouched_rms_nm for record in records if record.untouched_rms_nm is not None]
    if not values:
        return None
    single, filtered = np.median(np.array(values), axis=0)
    return {"frames": len(values), "depth_rms_nm": float(single), "depth_filtered_rms_nm": float(filtered)}


_WHERE = "peak_where"
_PEAK = tuple(f"{of}_{what}mm" for of in ("depth_peak", "peak_x", "peak_y") for what in ("", "sigma_"))


def _peak(among: list[StepFigures]) -> Figures:
    """Peak and its sigmas: median over the hold; without a scenario, the deepest one that was read."""
    read = [record for record in among if np.isfinite(record.depth_peak_mm)]
    if not read:
        return dict.fromkeys((*_PEAK, _WHERE))
    peaks = [record.peak for record in read if record.peak is not None]
    figures = np.array([(p.depth_mm, p.sigma_mm, p.x_mm, p.sigma_x_mm, p.y_mm, p.sigma_y_mm) for p in peaks])
    largest = int(np.argmax(np.abs(figures[:, 0])))
    if read[0].phase == "hold":
        chosen, where = np.median(figures, axis=0), statistics.mode(peak.where for peak in peaks)
    else:
        chosen, where = figures[largest], peaks[largest].where
    return dict(zip(_PEAK, chosen.tolist(), strict=True)) | {_WHERE: where.value}


def read_until_s(records: list[StepFigures]) -> float | None:
    """When a run that ends *nulling* was read for the last time; None of any other run."""
    running = [record for record in records if record.state is not State.STOPPED]
    if not running or running[-1].state is not State.NULLING:
        return None
    return next((record.time_s for record in reversed(running) if record.state in READ), None)


def _last_reason(records: list[StepFigures]) -> str:
    """Why the last of the frames that were not nulled was not."""
    return next((one.reason for one in reversed(records) if one.state is State.NULLING), "no frame measured")


def _finite(value: Any) -> Any:
    """The same figures with None for what is not a number, which JSON cannot say."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def summarise(result: RunResult) -> Figures:
    """All figures of a run. Keys ending in a unit carry it; None where nothing could be measured.

    Parameters
    ----------
    result : RunResult
        Of a session, also while it runs.

    Returns
    -------
    dict
        The figures, ready for JSON.
    """
    check_type("summarise: result", result, RunResult, "the result of a session")
    records = result.records
    # The figures of a hold are those of its nulled frames; a hold that was never nulled says so by None.
    hold = [record for record in records if record.phase == "hold"]
    held = hold or records
    nulled = [record for record in held if record.state in NULLED]
    read = [record for record in held if record.state in READ]
    last = result.last
    unheld = not_nulled(records, read_counts=result.rig.projector is not None)
    simulated = result.rig.camera.driver == SIMULATED
    figures = {
        "rig": result.rig.name,
        "scenario": result.rig.scenario if simulated else None,
        "controller": result.rig.control.controller,
        "gain": result.rig.control.gain,
        "seed": result.rig.simulation.seed if simulated else None,
        "frames": result.frames,
        "steps": result.steps,
        "steps_in_figures": len(records),
        "dropped": result.dropped,
        "interrupted": result.interrupted,
        "notes": result.notes,
        "recording_trouble": result.recording_trouble,
        "dropped_refreshes": result.dropped_refreshes,
        "delay_ms": result.delay_ms,
        "auto_exposure": result.exposure,
        "stability_margin": result.margin.margin if result.margin else None,
        "state": str(result.state),
        "reason": last.reason if last else "",
        "figures_of": "hold" if hold else "run",
        "nulled_frames": len(nulled),
        "read_until_s": None if hold else read_until_s(records),
        "not_nulled": unheld,
        "not_nulled_reason": "" if unheld is None else _last_reason(held),
        "events": result.events,
        "lock_frames": None if unheld or result.rig.control.passive else lock_frames(records),
        "residual_px_rms": _median_residual_px(read or held),
        "calibrated": all(record.calibrated for record in records),
        **_depth_figures(result, read),
        "fine": _fine(result),
        "contacts": contact_rows(records),
        "approaches": approach_rows(((one.time_ns, one.approach) for one in records), result.start_ns),
        "pointers": None
        if result.rig.projector is None
        else pointer_rows((event for one in records for event in one.pointers), result.start_ns),
        "contact_status": status_figures(
            [(one.time_s, one.contact_status) for one in records if one.contact_status is not None]
        ),
        "force": force_figures(records, result.rig),
        "loop_ms": _percentiles(record.loop_ms for record in records),
        "draw_ms": _percentiles(record.draw_ms for record in records),
        "read_ms": _percentiles(record.read_ms for record in records),
        "surface_latency_ms": _percentiles(record.latency_ms for record in records),
        **_read_figures(records),
        "gl_renderer": result.gl_renderer,
        "python": platform.python_version(),
        "versions": dict(_versions()),
    }
    return {key: _finite(value) for key, value in figures.items()}


def _fine(result: RunResult) -> Figures | None:
    """Of the last fine surface of the hold, or of the run where there is no hold."""
    of = [one for one in result.fine if one.phase == "hold"] or result.fine
    if not of:
        return None
    errors = ("depth_peak_error_percent", "depth_rms_error_um")
    truth = {name: getattr(of[-1], name) for name in errors}
    known = bool(np.isfinite(truth["depth_rms_error_um"]))
    return {
        "rows": of[-1].rows,
        "cols": of[-1].cols,
        "depth_peak_mm": of[-1].depth_peak_mm,
        "surfaces": len(result.fine),
        "truth": truth if known else None,
    }


def _read_figures(records: list[StepFigures]) -> Figures:
    """How many of the frames whose surface was asked for were read, and the longest run that were not."""
    was_read = [bool(np.isfinite(record.read_ms)) for record in records if record.readable]
    longest = unread = 0
    for each in was_read:
        unread = 0 if each else unread + 1
        longest = max(longest, unread)
    return {"frames_to_read": len(was_read), "frames_read": sum(was_read), "longest_unread": longest}


def _median_residual_px(records: list[StepFigures]) -> float | None:
    values = [record.residual_rms_px for record in records if np.isfinite(record.residual_rms_px)]
    return float(np.median(values)) if values else None


def _depth_figures(result: RunResult, read: list[StepFigures]) -> Figures:
    """Depth, how much of the view it covers, and its errors where the truth is known."""
    records = result.records
    # without a scenario, every nulled frame was compared
    truth = _against_truth(records, "hold" if any(record.phase for record in records) else "", GOOD)
    valid = (record.valid_share for record in reversed(records) if np.isfinite(record.residual_rms_px))
    return {
        "usable_share": truth["usable_share"] if truth else result.usable_share_at_rest,
        "valid_share": truth["valid_share"] if truth else next(valid, None),
        **_peak(read),
        "truth": truth,
        "truth_slide": _against_truth(records, "slide", _FOLLOWING),
        "untouched": _untouched(records),
    }
