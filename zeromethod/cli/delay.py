"""`zeromethod devices --delay`: measure the delay, report it, store it."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from zeromethod.calibration.panel_timing import StepTiming
from zeromethod.cli.device_options import BenchOptions, given_rig, opened_devices, say_simulated, with_devices
from zeromethod.commissioning.delay import DEFAULT_SECONDS, DelayResult, measure_delay
from zeromethod.commissioning.panel_timing import measure_panel_timing
from zeromethod.control.stability_margin import Margin, margin_words, stability_margin
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraLost, DisplayLost
from zeromethod.errors import InputError, MeasurementError
from zeromethod.optics import check_geometry
from zeromethod.rig.model import Rig
from zeromethod.rig.save import save_values
from zeromethod.view.progress import progress

_FRAMES = "camera frames"
_CHANGES = "seconds of black and white"


def report_delay(rig_name: str, options: BenchOptions, seconds: float | None, write: bool) -> dict[str, Any]:
    """Measure, print, store where asked; the figures. Raises InputError and MeasurementError."""
    path = Path(rig_name)
    if write and not path.is_file():
        raise InputError(f"--write: {rig_name!r}: with --rig and a rig file of your own")
    loaded = given_rig(rig_name)
    rig = with_devices(loaded, options).model_copy(update={"scenario": "none"})
    check_geometry(rig)
    say_simulated(rig)
    try:
        with opened_devices(rig, err=False) as devices:
            seconds = seconds or DEFAULT_SECONDS
            with progress(round(seconds * rig.camera.rate_hz), _FRAMES) as advance:
                result = measure_delay(rig, devices, seconds, lambda: advance(_FRAMES))
            steps, missing = _panel(rig, devices, seconds)
    except CameraLost as error:
        raise MeasurementError(f"delay: the camera is lost: {error}") from error
    except DisplayLost as error:
        raise MeasurementError(f"delay: the display is lost: {error}") from error
    margin = stability_margin(rig.control, result.delay_frames)
    for line in (*delay_words(result, margin, rig), *(panel_words(steps) if steps else [missing])):
        click.echo(line)
    known = steps.rig_values() if steps else {}
    if write:
        values = result.rig_values(loaded.display.latency_s) | known
        save_values(path, values)
        kept = (key for key, value in values.items() if value is not None)
        click.echo(f"stored as {', '.join(kept)} in {path}")
    elif path.is_file():
        click.echo("add --write to store it in the rig file")
    return _figures(result, steps) | {
        "rig_latency_s": loaded.display.latency_s,
        "largest_gain": margin.largest_gain,
        "stability_margin": margin.margin,
        "stored": write,
    }


def _figures(result: DelayResult, steps: StepTiming | None) -> dict[str, Any]:
    values = asdict(result) | {"delay_frames": result.delay_frames}
    if steps:
        own = asdict(steps).items()
        values |= {name: value for name, value in own if not name.startswith(("latency", "frames"))}
        values["scan"] = "up" if steps.upwards else "down"
    return values


def _panel(rig: Rig, devices: Devices, seconds: float) -> tuple[StepTiming | None, str]:
    """Scan-out and rise, or why there are none."""
    with progress(round(seconds), _CHANGES) as advance:
        began_ns = devices.clock.now_ns()
        passed = 0

        def on_change() -> None:
            nonlocal passed
            now = int(1e-9 * (devices.clock.now_ns() - began_ns))
            while passed < now:
                advance(_CHANGES)
                passed += 1

        try:
            return measure_panel_timing(rig, devices, seconds, on_change), ""
        except MeasurementError as error:
            return None, f"{error}; the rig file's scan-out and rise stay"


def panel_words(steps: StepTiming) -> list[str]:
    """Scan-out and rise in words, one line each."""
    way = "last row first" if steps.upwards else "first row first"
    return [
        f"scan-out {1e3 * steps.scanout_s:.2f} ms, sigma {1e3 * steps.scanout_sigma_s:.2f} ms, {way}",
        f"rise {1e3 * steps.rise_s:.2f} ms, sigma {1e3 * steps.rise_sigma_s:.2f} ms; "
        f"fall {1e3 * steps.fall_s:.2f} ms, sigma {1e3 * steps.fall_sigma_s:.2f} ms (10 to 90 %)",
    ]


def delay_words(result: DelayResult, margin: Margin, rig: Rig) -> list[str]:
    """The result in words, one line each."""
    frames = result.latency_s * result.camera_rate_hz
    jitter = [f"  from frame to frame it scatters by {1e3 * result.jitter_s:.2f} ms"]
    sign = ", before" if result.latency_s < 0 else " after"
    value = f"{1e3 * result.latency_s:.2f} ms, sigma {1e3 * result.sigma_s:.2f} ms"
    if result.range_s is not None:
        low_s, high_s = result.range_s
        value = f"between {1e3 * low_s:.1f} and {1e3 * high_s:.1f} ms: {result.why}"
    return [
        f"delay {value} ({frames:.2f} camera frames; the rig says {1e3 * rig.display.latency_s:.2f} ms)",
        f"  that is: the panel's first row begins to change so long{sign} the presentation time, by the "
        "camera's time stamps",
        *(jitter if math.isfinite(result.jitter_s) else ()),
        f"display {result.refresh_hz:.3f} Hz, camera {result.camera_rate_hz:.3f} frames per second; "
        f"{result.used} of {result.frames} frames gave a delay of their own, {result.read} were read",
        f"from a frame to those that see the picture made after it: {1e3 * result.horizon_s:.1f} ms, "
        f"{result.delay_frames:.2f} camera frames, computing not counted",
        margin_words(margin, rig.control),
    ]
