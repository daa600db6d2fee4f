"""`zeromethod devices --delay`: measure the delay, tell it in words, store it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from zeromethod.cli.bench_options import BenchOptions, tell_simulated, with_devices
from zeromethod.control.margin import Margin, margin_words, stability_margin
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import CameraLost, DisplayLost
from zeromethod.errors import InputError, MeasurementError
from zeromethod.optics import check_geometry
from zeromethod.procedures.delay import DEFAULT_SECONDS, DelayResult, measure_delay, store_latency
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.view.progress import progress

_FRAMES = "camera frames"


def tell_delay(rig_name: str, options: BenchOptions, seconds: float | None, write: bool) -> dict[str, Any]:
    """Measure, print, store where asked; the figures. Raises InputError and MeasurementError."""
    path = Path(rig_name)
    if write and not path.is_file():
        raise InputError(f"--write: {rig_name!r}: with --rig and a rig file of your own")
    loaded = load_rig(rig_name)
    rig = with_devices(loaded, options).model_copy(update={"press": "none"})
    check_geometry(rig)
    tell_simulated(rig)
    try:
        with open_devices(rig) as devices:
            for warning in getattr(devices.display, "warnings", ()):
                click.echo(f"! {warning}")
            seconds = seconds or DEFAULT_SECONDS
            with progress(round(seconds * rig.camera.rate_hz), _FRAMES) as advance:
                result = measure_delay(rig, devices, seconds, lambda: advance(_FRAMES))
    except CameraLost as error:
        raise MeasurementError(f"delay: the camera is lost: {error}") from error
    except DisplayLost as error:
        raise MeasurementError(f"delay: the display is lost: {error}") from error
    margin = stability_margin(rig.control, result.delay_frames)
    for line in delay_words(result, margin, rig):
        click.echo(line)
    if write:
        store_latency(path, result.latency_s)
        click.echo(f"stored as display.latency_s in {path}")
    elif path.is_file():
        click.echo("add --write to store it in the rig file")
    names = ("latency_s", "sigma_s", "jitter_s", "refresh_hz", "camera_rate_hz", "horizon_s", "delay_frames")
    counts = ("frames", "read", "used")
    figures = {name: getattr(result, name) for name in (*names, *counts)}
    return figures | {
        "rig_latency_s": loaded.display.latency_s,
        "largest_gain": margin.largest_gain,
        "stability_margin": margin.margin,
        "stored": write,
    }


def delay_words(result: DelayResult, margin: Margin, rig: Rig) -> list[str]:
    """The result in words, one line each."""
    frames = result.latency_s * result.camera_rate_hz
    jitter = (
        [f"  from frame to frame it scatters by {1e3 * result.jitter_s:.2f} ms"]
        if math.isfinite(result.jitter_s)
        else []
    )
    sign = ", before" if result.latency_s < 0 else " after"
    return [
        f"delay {1e3 * result.latency_s:.2f} ms, sigma {1e3 * result.sigma_s:.2f} ms "
        f"({frames:.2f} camera frames; the rig says {1e3 * rig.display.latency_s:.2f} ms)",
        f"  that is: the panel's first row begins to change so long{sign} the presentation time, by the "
        "camera's time stamps",
        *jitter,
        f"display {result.refresh_hz:.3f} Hz, camera {result.camera_rate_hz:.3f} frames per second; "
        f"{result.used} of {result.frames} frames told a delay of their own, {result.read} were read",
        f"from a frame to those that see the picture made after it: {1e3 * result.horizon_s:.1f} ms, "
        f"{result.delay_frames:.2f} camera frames, computing not counted",
        margin_words(margin, rig.control),
    ]
