"""Procedures that close the loop on a simulated bench in simulated time.

"run": as `zeromethod run` does. "averaging": depth noise left by the mean of several frames at rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.control.stability_margin import stability_margin
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.errors import MeasurementError
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED
from zeromethod.optics import Optics, check_geometry
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.session.result import RunResult
from zeromethod.session.session import Session
from zeromethod.session.summary import summarise
from zeromethod.study.task import Figures, Procedure, Task
from zeromethod.surface import SurfaceReader
from zeromethod.warp.mean import RunningMean

DEFAULT_SECONDS = 1.0

_SETTLING_FRAMES = 8
"""Nulled frames that pass before any is averaged."""

_SPARE_FRAMES = 60

_TRUTH = {
    "depth_peak_mm": "true depth of the peak, mm",
    "depth_peak_error_percent": "error of the peak's depth, worst frame, percent",
    "depth_peak_error_mean_percent": "error of the peak's depth, mean, percent",
    "depth_rms_error_um": "rms error of depth over nodes and frames, um",
    "slope_rms_error_mrad": "rms error of slope over nodes and frames, mrad",
}

_STATUS = {
    "share": "share of the area in contact",
    "spots_per_cm2": "spots in contact, 1/cm2",
    "spot_mm2": "mean size of a spot, mm2",
    "spot_life_s": "mean time that a spot stays in contact, s",
    "speed_mm_s": "sliding, frames that slip and are not aliased, mm/s",
    "direction_deg": "direction of sliding, deg",
    "pitch_mm": "pitch of the texture, mm",
    "ridge_deg": "the way across its rows, deg",
    "force_n": "force, N",
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
    "delay_frames": "from a frame to the one that shows the answer to it, camera frames",
    "largest_stable_gain": "gain at which a linear model of the loop is at its limit at that delay",
    **{f"truth.{key}": f"{words}, in the hold" for key, words in _TRUTH.items()},
    **{f"truth_slide.{key}": f"{words}, while the press slides" for key, words in _TRUTH.items()},
    **{f"contact_status.{key}": f"rubbing: {words}, median" for key, words in _STATUS.items()},
    "contact_status.aliased": "rubbing: share of the frames that slip that are aliased",
    "untouched.depth_rms_nm": "depth noise at rest, single frames, rms over nodes, nm",
    "untouched.depth_filtered_rms_nm": "depth noise at rest after the controller's filter, nm",
}


@contextmanager
def opened(task: Task) -> Iterator[Devices]:
    """Devices of the task's true bench, its press in place."""
    check_geometry(task.rig)
    bench = task.bench or task.rig
    with open_devices(bench) as devices:
        if task.press is not None:
            camera: Any = devices.camera
            camera.scenario = task.press.scenario(bench)
        yield devices


def close_loop(task: Task) -> Figures:
    """Figures of one run."""
    with opened(task) as devices:
        # what a wrong geometry does is what is studied: the loop runs as if it were right
        exact = task.rig.model_copy(update={"geometry": GeometrySpec(known="exact")})
        session = Session(exact, devices=devices)
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


def average(task: Task) -> Figures:
    """Depth of the mean of `averaged_frames` measured warps, while the picture is nulled.

    Raises MeasurementError where the loop does not null so many frames.
    """
    wanted = int(task.settings["averaged_frames"])
    mean, filtered, settled = RunningMean(), None, 0
    with opened(task) as devices:
        optics = Optics(task.rig)
        # a true bench that differs from the rig is what is studied
        loop = Loop(
            task.rig, devices.camera, devices.display, devices.clock, optics=optics, watches_bench=False
        )
        reader = SurfaceReader(task.rig, optics, loop.grid)
        for step in loop.run(frames=wanted + _SETTLING_FRAMES + _SPARE_FRAMES):
            if step.measured is None or step.state not in NULLED:
                continue
            settled += 1
            if settled <= _SETTLING_FRAMES:
                continue
            mean.add(step.measured)
            filtered = step.filtered
            if mean.frames == wanted:
                break
    if mean.frames < wanted or filtered is None:
        raise MeasurementError(f"only {mean.frames} of {wanted} frames were nulled")
    surface = reader.read(mean.warp)
    by_filter = reader.read(filtered)
    if not surface.valid.any():
        raise MeasurementError("nothing of the mirror could be read")
    return {
        "depth_rms_nm": 1e6 * _rms(surface.depth_mm[surface.valid]),
        "stated_depth_rms_nm": 1e6 * _rms(surface.sigma_depth_mm[surface.valid]),
        "slope_rms_urad": 1e6 * _rms(surface.slope[surface.valid]),
        "filtered_depth_rms_nm": 1e6 * _rms(by_filter.depth_mm[by_filter.valid]),
        "averaged_s": wanted / task.rig.camera.rate_hz,
    }


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


AVERAGING = Procedure(
    average,
    {
        "depth_rms_nm": "depth read of a mirror at rest, rms over nodes, nm",
        "stated_depth_rms_nm": "standard deviation stated for it, rms over nodes, nm",
        "slope_rms_urad": "slope read of a mirror at rest, rms over nodes, microradian",
        "filtered_depth_rms_nm": "depth rms of the controller's own filter at the end, nm",
        "averaged_s": "time that so many frames take, s",
    },
    {"averaged_frames": 1},
)
