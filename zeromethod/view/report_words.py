"""Rows of the tables of a recording's page, in words, and the warnings above them."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from zeromethod.calibration.folder import OLD_DAYS, Stored
from zeromethod.loop.state import State
from zeromethod.recording.damage import KINDS, damaged_words
from zeromethod.recording.recording import Recording
from zeromethod.recording.schema import KEEP
from zeromethod.rig.model import Rig
from zeromethod.surface import Where
from zeromethod.toml_file import parse_toml
from zeromethod.view import calibration_table
from zeromethod.view.report_history import Happening, seconds
from zeromethod.view.report_summary import Figures
from zeromethod.view.table import LOOP_MS, approach_words, force_words, pointer_words, status_rows

_GROWING_S = 3.0
"""A file that changed more recently than this is still being written."""

Rows = list[tuple[str, ...]]


def subtitle(recording: Recording, figures: Figures) -> str:
    """When, how long, on what, and when the page was made."""
    bench = "real devices" if recording.live else f"simulated, seed {recording.seed}"
    started = datetime.fromisoformat(recording.started_utc).astimezone(UTC)
    return (
        f"started {started:%Y-%m-%d %H:%M:%S} UTC, {figures['seconds']:.1f} s, {bench}; "
        f"page made {datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    )


def warnings(silent_s: float, figures: Figures) -> Iterator[str]:
    """Warnings, the first lines of the page; silent_s: since something was written to the recording."""
    if not figures["steps"]:
        yield "No step of the loop is in this recording."
    if not figures["complete"] and silent_s < _GROWING_S:
        yield "The recording was still being written when this page was made: it shows the beginning."
    elif not figures["complete"]:
        yield "The recording was cut off: its writer did not close it. What was written until then is here."
    if figures["state"] in {State.FAULT, State.LOST}:
        yield f"The run ended in {figures['state']}: {figures['reason']}"
    if not figures["calibrated"]:
        yield "The bench was not calibrated: depth is relative, within its sigma at best."
    if lost := figures["dropped"].get("recorder"):
        yield f"{lost} frames were taken by the loop, but their arrays are not in the recording."
    if damaged := damaged_words(figures["damaged"]):
        yield f"{damaged}: these are not what was written."


def summary_rows(figures: Figures, rig: Rig) -> Iterator[tuple[str, str]]:
    """The figures of the summary that were measured."""
    if figures["state"]:
        yield "state at the end", f"{figures['state']}: {figures['reason']}"
        yield (
            "passive or resting" if rig.control.passive else "locked or resting",
            f"{figures['locked_share']:.1%} of the time",
        )
    for label, key in (("peak of largest |depth|", "largest"), ("last peak", "last")):
        if (peak := figures[key]) is not None:
            yield label, peak_words(peak)
    if figures["fine"] is not None:
        one = figures["fine"]["largest"]
        place = f"x = {one['x_mm']:z.2f}, y = {one['y_mm']:z.2f} mm"
        depth = f"{1e3 * one['depth_mm']:z.4f} ± {1e3 * one['depth_sigma_mm']:.4f} µm"
        yield "peak on every pixel", f"{depth} at {place}, of {figures['fine']['surfaces']} readings"
    for one in figures["contacts"]:
        area = f"{one['area_mm2']:.3f} ± {one['sigma_area_mm2']:.3f} mm²"
        place = f"at ({one['x_mm']:.3f}, {one['y_mm']:.3f}) mm"
        known = one["force_n"] is not None and math.isfinite(one["force_n"])
        force = f", {force_words(one['force_n'], one['sigma_force_n'])}" if known else ""
        yield f"contact {one['id']}", f"{area} {place}{force}, {one['from_s']:.2f} to {one['to_s']:.2f} s"
    yield from approach_words(figures)
    yield from pointer_words(figures)
    yield from status_rows(figures["contact_status"])
    residual = figures["residual_px_rms"]
    if residual["median"] is not None:
        while_ = rig.control.reads
        yield (
            f"residual while {while_}",
            f"{residual['median']:.4f} camera px rms (99 %: {residual['p99']:.4f})",
        )
        yield f"nodes valid while {while_}", f"{figures['valid_share']:.1%} of those visible at rest"
    rate = "" if figures["rate_hz"] is None else f", {figures['rate_hz']:.2f} per second"
    yield "frames", f"{figures['frames']}{rate} (rig file: {rig.camera.rate_hz:g})"
    dropped = [f"{what} {count}" for what, count in figures["dropped"].items()]
    yield "frames dropped", ", ".join(dropped) or "none"
    yield "items damaged", damaged_words(figures["damaged"]).removeprefix("damaged: ") or "none"
    without = [f"{what} {count}" for what, count in figures["without_reading"].items() if count]
    if without:
        yield "frames taken but not read", ", ".join(without)
    for label, key in (
        (LOOP_MS[rig.control.passive], "loop_ms"),
        ("drawing the pattern", "draw_ms"),
        ("mid-exposure to new picture", "delay_ms"),
        ("reading the surface", "read_ms"),
    ):
        if figures[key]["median"] is not None:
            yield label, f"{figures[key]['median']:.2f} ms (99 %: {figures[key]['p99']:.2f})"
    yield "duration", f"{figures['seconds']:.2f} s, {figures['steps']} steps of the loop"


def peak_words(peak: Figures) -> str:
    """Depth with sigma, place, time and state of a peak."""
    depth, sigma, unit = peak["depth_mm"], peak["sigma_mm"], "mm"
    if abs(depth) < 1.0:
        depth, sigma, unit = 1e3 * depth, 1e3 * sigma, "µm"
    digits = 3
    if np.isfinite(sigma) and sigma > 0:
        digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 6))
    x, y = (_known_to(peak[f"{name}_mm"], peak[f"{name}_sigma_mm"]) for name in "xy")
    place = f"x = {x}, y = {y} mm"
    length = f"{depth:z.{digits}f} {unit} (sigma not known)"
    if np.isfinite(sigma):
        length = f"{depth:z.{digits}f} ± {sigma:.{digits}f} {unit}"
    noise = " (nothing presses: noise)" if peak["state"] == State.RESTING else ""
    where = "" if peak["where"] == Where.MEASURED else f", {peak['where']}"
    return f"{length} at {place}{where}, {peak['time_s']:.2f} s, {peak['state']}{noise}"


def _known_to(place_mm: float, sigma_mm: float) -> str:
    """A place, with its sigma where that is known and of note."""
    return f"{place_mm:z.2f} ± {sigma_mm:.2f}" if sigma_mm >= 0.005 else f"{place_mm:z.2f}"


def happening_rows(figures: Figures, happened: Sequence[Happening]) -> Iterator[tuple[str, ...]]:
    """Time, how long, what, how often, why; first what is damaged in the file, at no time of the run."""
    for group, count in figures["damaged"].items():
        yield "", "", f"damaged: {KINDS[group][1]}", f"{count}", "not what was written: left out"
    for one in happened:
        lasted = one.end_s - one.start_s
        yield f"{one.start_s:.3f}", f"{lasted:.3f}" if lasted else "", one.what, f"{one.count}", one.why


def note_rows(recording: Recording) -> Rows:
    """Time and text of the notes to the operator."""
    notes = recording.notes
    times = zip(seconds(recording, notes), notes["text"], strict=True)
    return [(f"{at_s:.3f}", recording.text(text)) for at_s, text in times]


def rig_rows(rig: Rig) -> Iterator[tuple[str, str]]:
    """The bench in a few lines."""
    prism, display, camera = rig.prism, rig.display, rig.camera
    yield "name", rig.name
    length = (
        f"leg {prism.pattern_length_mm:g}"
        if prism.pattern_length_mm is not None
        else f"mirror {prism.mirror_length_mm:g}"
    )
    yield (
        "prism",
        f"{prism.pattern_angle_deg:g}° and {prism.camera_angle_deg:g}°, index {prism.index:g}, "
        f"{length} mm, {prism.width_mm:g} mm wide, {prism.rest.shape} at rest",
    )
    for label, layers in (
        ("layers to the LCD", rig.pattern_layers),
        ("layers to the camera", rig.camera_layers),
    ):
        if layers:
            yield label, ", ".join(f"{layer.thickness_mm:g} mm of index {layer.index:g}" for layer in layers)
    yield (
        "print, lit by a lamp at the camera" if rig.light.by_mirror else "LCD",
        f"{display.driver}: {display.columns} x {display.rows}, pitch {display.pitch_mm:g} mm, "
        f"{display.refresh_hz:g} Hz, gamma {display.gamma:g}, latency {1e3 * display.latency_s:g} ms",
    )
    yield (
        "camera",
        f"{camera.driver}: {camera.columns} x {camera.rows}, {camera.bits} bits, "
        f"{camera.rate_hz:g} per second, exposure {1e3 * camera.exposure_s:g} ms, {camera.projection}",
    )
    if (watch := rig.watch) is not None:
        shape = f"{watch.columns} x {watch.rows}, {watch.rate_hz:g} per second"
        yield "watch camera", f"{watch.driver}: {shape}, two lenses {watch.baseline_mm:g} mm apart"
    if (projector := rig.projector) is not None:
        yield (
            "projector",
            f"{projector.driver}: {projector.columns} x {projector.rows}, {projector.refresh_hz:g} Hz, "
            f"white {projector.brightness:g} times the LCD's",
        )
    if rig.cloth is not None:
        yield (
            "cloth",
            f"a point every {rig.cloth.weave_mm:g} mm, {rig.cloth.touching:.0%} of the area at rest",
        )
    yield "target", f"{rig.target.kind}, period {rig.target.period_px} camera px"


def calibration_parts(recording: Recording) -> dict[str, Any]:
    """Parameters with sigma, verdict and age; or why there are none."""
    if not recording.calibration:
        return {"calibration": None, "uncalibrated": "None: the rig was run as its file has it."}
    try:
        return {"calibration": _calibrated(recording)}
    except (KeyError, TypeError, ValueError):
        # of another version, or written by hand; all else in the recording still counts
        return {"calibration": None, "uncalibrated": "The calibration in this recording cannot be read."}


def _calibrated(recording: Recording) -> dict[str, Any]:
    stored = Stored(Path(), parse_toml(recording.calibration, recording.path))
    days = stored.age_days(datetime.fromisoformat(recording.started_utc).astimezone(UTC))
    old = f", more than {OLD_DAYS:.0f}" if days > OLD_DAYS else ""
    parameters = calibration_table.parameter_table(stored)
    return {
        "verdict": f"{calibration_table.verdict_line(stored).plain}. {days:.1f} days old at the run{old}.",
        "depth": calibration_table.depth_line(stored),
        "heads": [str(column.header) for column in parameters.columns],
        "parameters": _cells(parameters),
        "figures": _cells(calibration_table.figure_table(stored)),
    }


def _cells(table: Table) -> Rows:
    """Cells of a table, row by row."""
    return list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True))


def commands(recording: Recording, path: Path) -> Iterator[tuple[str, str]]:
    """What to type for what; `path`: of the recording, as its reader calls it."""
    file = shlex.quote(str(path))
    yield "Recorded by:", recording.command_line
    yield "Read again from the recording, with the same settings or others:", f"zeromethod replay {file}"
    yield "This page:", f"zeromethod report {file}"


def settings_rows(recording: Recording) -> Iterator[tuple[str, str]]:
    """How the loop was set, what the reading took as known, what was kept."""
    rig = recording.rig
    control = rig.control
    yield "controller", f"{control.controller}, gain {control.gain:g}"
    if control.controller == "integrator":
        yield "leak", f"{control.leak:g} per frame"
    yield "camera timeout", f"{control.timeout_s:g} s"
    yield "coded strips", "edges" if rig.coded else "none"
    if not recording.live:
        yield "press", rig.scenario
        yield "seed", str(recording.seed)
    known = [
        f"x {one.x_mm[0]:g} to {one.x_mm[1]:g}, y {one.y_mm[0]:g} to {one.y_mm[1]:g} mm"
        for one in rig.surface.known_rest
    ]
    yield ("known to be at rest", "; ".join(known) or "nothing, so the quietest part of the view's border")
    rows, columns = recording.grid.shape
    yield "nodes", f"{rows} x {columns}, {recording.grid.spacing_px:g} camera px apart"
    missing = [name for name in KEEP if name not in recording.kept and name != "fine"]
    yield "kept", ", ".join(name for name in KEEP if name in recording.kept) or "tables only"
    if missing:
        yield "not kept", ", ".join(missing)
    if recording.every > 1:
        yield "kept of", f"every {recording.every}. step"


def version_rows(recording: Recording) -> Iterator[tuple[str, str]]:
    """What the recording was made with."""
    yield "zeromethod", recording.zeromethod_version
    yield from ((name, str(version)) for name, version in recording.versions.items())
    yield "GL renderer", recording.gl_renderer or "unknown"
