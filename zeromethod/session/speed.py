"""Speed of this computer on a rig: loop, drawing, reading and recording, each against the camera's rate."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zeromethod.devices.opening import open_devices
from zeromethod.errors import MeasurementError
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.recording.recorder import Recorder
from zeromethod.rig.model import Rig
from zeromethod.simulation.clone import simulated_clone
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.warp.rest import Rest

FRAMES = 36
"""Simulated frames that the loop answers; the first `WARM_UP_FRAMES` are not counted."""
WARM_UP_FRAMES = 6
RECORDING_S = 3.0
"""How long recording is timed."""
SLICES = 6
"""Steps of the progress bar while recording."""
STEPS = FRAMES + SLICES
_FLOWS = 9
"""Frames between which OpenCV's flow is timed."""
_WAITING_BYTES = 64 << 20
_KEPT = 8
"""Different frames that are recorded, in turn."""

Read = tuple[Step, Surface, Peak, float]


def percentiles(values: Iterable[float]) -> dict[str, float | None]:
    """Median, p90 and p99 of the finite values; None where there are none."""
    finite = [value for value in values if np.isfinite(value)]
    if not finite:
        return dict.fromkeys(("median", "p90", "p99"))
    return {key: float(np.percentile(finite, at)) for key, at in (("median", 50), ("p90", 90), ("p99", 99))}


def measure_speed(rig: Rig, folder: Path, advance: Callable[[str], None]) -> dict[str, Any]:
    """Figures of this computer on frames of the rig's size, from its simulated bench.

    A part is fast enough if nine of ten frames take it less than the time between two frames of the camera;
    recording (into a temporary file in `folder`), if it keeps as many frames per second as the camera gives.
    advance: called `STEPS` times, with the name of what comes next. Raises MeasurementError where the loop
    measures nothing.
    """
    rig = simulated_clone(rig)
    steps, read, renderer, rest = _loop(rig, advance)
    dis_fast_ms = _dis_fast_ms(steps)
    parts = {
        name: _timed_part(values, rig.camera.rate_hz)
        for name, values in (
            ("loop", [step.loop_ms for step in steps]),
            ("drawing", [step.draw_ms for step in steps]),
            ("reading", [read_ms for *_, read_ms in read]),
        )
    }
    parts["recording"] = _recording(rig, rest, read[-_KEPT:], folder, advance)
    for name in ("loop", "reading"):
        parts[name]["of_dis_fast"] = dis_fast_ms and parts[name]["ms"]["median"] / dis_fast_ms
    for part in parts.values():
        part["fast_enough"] = part["frames_per_s"] >= rig.camera.rate_hz
    return {
        "rig": rig.name,
        "frame_px": [rig.camera.columns, rig.camera.rows],
        "display_px": [rig.display.columns, rig.display.rows],
        "camera_rate_hz": rig.camera.rate_hz,
        "frames": len(steps),
        "gl_renderer": renderer,
        "dis_fast_ms": dis_fast_ms,
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "parts": parts,
        "bottleneck": min(parts, key=lambda name: parts[name]["frames_per_s"]),
        "fast_enough": all(part["fast_enough"] for part in parts.values()),
    }


def _loop(rig: Rig, advance: Callable[[str], None]) -> tuple[list[Step], list[Read], str, Rest]:
    """Steps of the loop on the simulated bench, those that were read, what draws, and the rest."""
    optics = Optics(rig)
    steps: list[Step] = []
    read: list[Read] = []
    with (
        open_devices(rig) as devices,
        Loop(rig, devices.camera, devices.display, devices.clock, optics=optics) as loop,
    ):
        reader = SurfaceReader(rig, optics, loop.grid)
        for step in loop.run(frames=FRAMES):
            if step.measured is not None:
                started = time.perf_counter()
                surface = reader.follow(step.measured)
                deepest = peak(surface)
                read.append((step, surface, deepest, 1e3 * (time.perf_counter() - started)))
            steps.append(step)
            advance("loop" if len(steps) < FRAMES else "recording")
        counted = [one for one in read if one[0].number > WARM_UP_FRAMES]
        if not counted:
            raise MeasurementError(
                f"the simulated bench of rig {rig.name!r} was not measured: {steps[-1].reason}"
            )
        return steps[WARM_UP_FRAMES:], counted, loop.gl_renderer, loop.rest


def _dis_fast_ms(steps: list[Step]) -> float | None:
    """How long OpenCV's flow (DIS, preset fast) between two frames takes, ms; None unless of 8 bits.

    A measure of computers at work on pictures that does not depend on this program.
    """
    solver = vars(cv2)["DISOpticalFlow_create"](vars(cv2)["DISOPTICAL_FLOW_PRESET_FAST"])
    images = [step.image for step in steps if step.image is not None and step.image.dtype == np.uint8]
    taken_ms = []
    for before, image in pairwise(images[:_FLOWS]):
        started = time.perf_counter()
        solver.calc(before, image, None)
        taken_ms.append(1e3 * (time.perf_counter() - started))
    return float(np.median(taken_ms)) if taken_ms else None


def _timed_part(ms: list[float], rate_hz: float) -> dict[str, Any]:
    """Times in ms, and frames per second that their 90th percentile allows."""
    spread = percentiles(ms)
    slow_ms = spread["p90"]
    return {
        "ms": spread,
        "frames_per_s": 1e3 / slow_ms if slow_ms else float("nan"),
        "share_of_frame": slow_ms * rate_hz / 1e3 if slow_ms else float("nan"),
    }


def _recording(
    rig: Rig, rest: Rest, read: list[Read], folder: Path, advance: Callable[[str], None]
) -> dict[str, Any]:
    """Frames and megabytes per second that a recording of everything takes."""
    frame_ns = round(1e9 / rig.camera.rate_hz)
    with tempfile.TemporaryDirectory(prefix=".zeromethod-speed-", dir=folder) as scratch:
        path = Path(scratch) / "speed.h5"
        started = time.perf_counter()
        with Recorder(path, rig, rest, waiting_bytes=_WAITING_BYTES) as recorder:
            frames = slices = 0
            while slices < SLICES:
                step, surface, deepest, read_ms = read[frames % len(read)]
                frames += 1
                step = replace(step, number=frames, frame_number=frames, time_ns=frames * frame_ns, dropped=0)
                recorder.add_step(step)
                recorder.add_reading(replace(step, surface=surface, peak=deepest, read_ms=read_ms))
                while slices < SLICES and time.perf_counter() - started > (slices + 1) * RECORDING_S / SLICES:
                    slices += 1
                    advance("recording" if slices < SLICES else "")
        seconds = time.perf_counter() - started
        megabytes = path.stat().st_size / 1e6
    kept = frames - recorder.unkept
    return {
        "frames_per_s": kept / seconds,
        "megabytes_per_s": megabytes / seconds,
        "share_of_frame": rig.camera.rate_hz * seconds / kept if kept else float("inf"),
        "trouble": str(recorder.status),
    }
