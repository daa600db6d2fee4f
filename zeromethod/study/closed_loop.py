"""The procedure "run": the loop closed on a simulated bench in simulated time, as `zeromethod run` does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from zeromethod.control.stability_margin import stability_margin
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.loop.state import NULLED
from zeromethod.optics import check_geometry
from zeromethod.session.result import RunResult
from zeromethod.session.session import Session
from zeromethod.session.summary import summarise
from zeromethod.study.task import Figures, Procedure, Task

DEFAULT_SECONDS = 1.0

_TRUTH = {
    "depth_peak_mm": "true depth of the peak, mm",
    "depth_peak_error_percent": "error of the peak's depth, worst frame, percent",
    "depth_peak_error_mean_percent": "error of the peak's depth, mean, percent",
    "depth_rms_error_um": "rms error of depth over nodes and frames, um",
    "slope_rms_error_mrad": "rms error of slope over nodes and frames, mrad",
}

FIGURES = {
    "state": "state of the loop at the end",
    "nulled_frames": "frames of the hold (of the run, without a hold) that were nulled",
    "locked_share": "share of the frames of the hold (of the run, without one) that were nulled",
    "lock_frames": "frames from the touch until residual rms stays below 0.05 camera px; none: never",
    "residual_px_rms": "residual, rms over nodes, median over nulled frames (all, if none), camera px",
    "residual_end_px": "residual, rms over nodes, median over the last quarter of the frames, camera px",
    "usable_share": "share of the nodes that are reflected and see the LCD",
    "valid_share": "share of the usable nodes that were read",
    "depth_peak_mm": "depth of the peak as read, median over the hold, mm",
    "depth_peak_sigma_mm": "standard deviation stated for it, mm",
    "dropped": "frames dropped",
    "delay_frames": "from a frame to the one that sees what was made of it, camera frames",
    "largest_stable_gain": "gain at which a linear model of the loop is at its limit at that delay",
    **{f"truth.{key}": f"{words}, in the hold" for key, words in _TRUTH.items()},
    **{f"truth_slide.{key}": f"{words}, while the press slides" for key, words in _TRUTH.items()},
    "untouched.depth_rms_nm": "depth noise at rest, single frames, rms over nodes, nm",
    "untouched.depth_filtered_rms_nm": "depth noise at rest after the controller's filter, nm",
}


@contextmanager
def opened(task: Task) -> Iterator[Devices]:
    """Devices of the task's true bench, its press in place."""
    check_geometry(task.rig)
    with open_devices(task.bench or task.rig) as devices:
        if task.press is not None:
            camera: Any = devices.camera
            camera.scenario = task.press.scenario()
        yield devices


def close_loop(task: Task) -> Figures:
    """Figures of one run."""
    with opened(task) as devices:
        session = Session(task.rig, devices=devices)
        frames, seconds = task.frames, task.seconds
        if frames is None and seconds is None and task.press is not None:
            seconds = DEFAULT_SECONDS
        for _ in session.run(frames, seconds):
            pass
        delay_frames = session.loop.horizon_s * task.rig.camera.rate_hz
        return _figures(session.result, delay_frames)


def _figures(result: RunResult, delay_frames: float) -> dict[str, Any]:
    figures = flat(summarise(result))
    records = result.records
    held = [record for record in records if record.phase == "hold"] or records
    last = [record.residual_rms_px for record in records[-max(1, len(records) // 4) :]]
    known = [value for value in last if np.isfinite(value)]
    figures["locked_share"] = sum(record.state in NULLED for record in held) / max(len(held), 1)
    figures["residual_end_px"] = float(np.median(known)) if known else None
    figures["delay_frames"] = delay_frames
    if np.isfinite(delay_frames):
        figures["largest_stable_gain"] = stability_margin(result.rig.control, delay_frames).largest_gain
    return {name: figures.get(name) for name in FIGURES}


def flat(figures: Figures, before: str = "") -> dict[str, Any]:
    """Nested tables as one, keys dotted."""
    result: dict[str, Any] = {}
    for key, value in figures.items():
        if isinstance(value, dict):
            result |= flat(value, f"{before}{key}.")
        else:
            result[f"{before}{key}"] = value
    return result


CLOSED_LOOP = Procedure(close_loop, FIGURES)
