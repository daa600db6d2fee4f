"""`zeromethod replay`: evaluate a recording again, or close its loop again, with other settings if wanted."""

from __future__ import annotations

import math
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from zeromethod.cli.device_options import control_options, given_options, given_rig
from zeromethod.cli.numbers import Real
from zeromethod.cli.output import OutputFile, figure_option, summary_option, write_summary
from zeromethod.cli.page_options import page_options
from zeromethod.cli.recording_options import open_recording, recording_argument, time_options
from zeromethod.cli.replay_page import watch_recording
from zeromethod.errors import InputError
from zeromethod.light_array.recording import is_light_recording
from zeromethod.optics import check_geometry
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import Rig
from zeromethod.session.replay.closed_loop import ClosedLoopReplay, recorded_track, simulated_bench
from zeromethod.session.replay.comparison import figures_of, rejection
from zeromethod.session.replay.mirror import RecordedMirror, contacts_left_out
from zeromethod.session.replay.replay import Mode, evaluated_again
from zeromethod.session.replay.settings import with_settings
from zeromethod.session.replay.track import Track
from zeromethod.session.replay.window import Window
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.replay_table import differences_table, sessions_table

FROM_WARPS, FROM_FRAMES, CLOSED_LOOP = "from-warps", "from-frames", "closed-loop"


@dataclass(frozen=True)
class _Asked:
    """What was asked for, by the names of the options."""

    file: Path
    mode: Mode
    settings: tuple[str, ...]
    rig_name: str | None
    loop_gain: float | None
    controller: str | None
    renderer: str | None
    from_s: float | None
    to_s: float | None
    speed: float | None
    record: Path | None
    figure: Path | None
    summary: Path | None

    @property
    def changes(self) -> tuple[str, ...]:
        """Settings of the rig, KEY=VALUE; the last of one key holds."""
        control = {"control.gain": self.loop_gain, "control.controller": self.controller}
        return (*self.settings, *(f"{key}={value}" for key, value in control.items() if value is not None))


@click.command(
    "replay", epilog="Example: zeromethod replay session.h5 --mode closed-loop --gain 0.5 --figure replay.png"
)
@recording_argument
@click.option(
    "--mode",
    type=click.Choice([FROM_WARPS, FROM_FRAMES, CLOSED_LOOP]),
    default=FROM_WARPS,
    show_default=True,
    help="Start from the measured warps or the frames, or close the loop again on a simulated bench.",
)
@click.option(
    "--set", "settings", metavar="KEY=VALUE", multiple=True, help="Another value for a key of the rig."
)
@click.option("--rig", "rig_name", help="Another rig file, or a packaged name, in place of the recorded one.")
@control_options
@click.option(
    "--renderer", type=click.Choice(["gpu", "numpy"]), help="closed-loop: what draws the simulated bench."
)
@time_options
@click.option(
    "--speed",
    type=Real(min=0, min_open=True),
    help="At most so many times as fast as it was: 1 = real time.  [default: as fast as it goes]",
)
@click.option(
    "--record",
    type=OutputFile(".h5", new=True),
    help="closed-loop: record the last session (.h5). Never replaces a file.",
)
@page_options
@figure_option
@summary_option
def replay_command(**options: Any) -> None:
    """Replay a recording: FILE is what `run --record` wrote. No display or camera is needed.

    Without settings it says whether this machine and version come to the recorded numbers. From warps and
    from frames they are the same bit for bit; in a closed loop a simulated bench repeats the recorded
    surface, and the statistics are the same. With --set, --gain, ... the same is done with
    other settings, for comparison.
    """
    if is_light_recording(options["file"]):
        from zeromethod.cli.light_array import replay_light_array  # noqa: PLC0415 - only these rigs need it

        replay_light_array(options["file"], given_options(click.get_current_context()), options["summary"])
        return
    view, control = options.pop("view"), options.pop("control")
    asked = _Asked(**options)
    if view is not None or control is not None:
        _show(asked, view, control)
        return
    if asked.mode != CLOSED_LOOP:
        for option in ("loop_gain", "controller", "renderer", "record"):
            if (value := getattr(asked, option)) is not None:
                name = option.removeprefix("loop_")
                raise InputError(f"--{name}: {value}: only with --mode {CLOSED_LOOP}")
    limit_threads()
    with open_recording(asked.file) as recording:
        window = Window.of(recording, asked.from_s, asked.to_s)
        rig = recording.rig if asked.rig_name is None else given_rig(asked.rig_name)
        replay = _close_loop if asked.mode == CLOSED_LOOP else _evaluate
        figures = {
            "recording": str(asked.file),
            "mode": asked.mode,
            "settings": list(asked.changes),
            "rig": rig.name,
            "from_s": 1e-9 * (window.from_ns - window.start_ns),
            "to_s": 1e-9 * (window.to_ns - window.start_ns),
            **replay(asked, recording, window, rig),
        }
        write_summary(asked.summary, figures)


def _show(asked: _Asked, view: str | None, control: str | None) -> None:
    """Show the recording on the operator's page, instead of evaluating it again."""
    for option in given_options(click.get_current_context()):
        if option.startswith("-") and option not in {"--view", "--control", "--speed"}:
            raise InputError(f"{option}: not with --view or --control, which show what was recorded")
    with open_recording(asked.file) as recording:
        watch_recording(recording, view, control, asked.speed)


def _evaluate(asked: _Asked, recording: Recording, window: Window, rig: Rig) -> dict[str, Any]:
    """Evaluate the warps or the frames again, and print how far the numbers differ; the figures."""
    rig = with_settings(rig, asked.changes)
    check_geometry(rig)
    _say_not_known(rig)
    steps = recording.steps[recording.steps["time_ns"] <= window.to_ns]
    from_warps = asked.mode == FROM_WARPS
    count = np.isin(recording.peaks["step"], steps["number"]) if from_warps else steps["sensed"]
    with progress(int(count.sum()), "reading" if from_warps else "sensing") as advance:

        def on_step(at_s: float) -> None:
            advance(f"{at_s:.2f} s")

        equal, figures = evaluated_again(
            recording, rig, window, asked.mode, speed=asked.speed, on_step=on_step
        )
    Console().print(differences_table(figures))
    if asked.figure is not None:
        from zeromethod.view.replay_figure import draw_differences  # noqa: PLC0415 - matplotlib loads slowly

        title = f"zeromethod  {recording.path.name} again {asked.mode.replace('-', ' ')}"
        draw_differences(figures, title, asked.figure)
    return {"changed": rig != recording.rig, "equal": equal, **figures}


def _close_loop(asked: _Asked, recording: Recording, window: Window, rig: Rig) -> dict[str, Any]:
    """Repeat the session on a simulated bench, and with other settings if there are any; the figures."""
    drawn_by = () if asked.renderer is None else (f"simulation.renderer={asked.renderer}",)
    rigs = {"simulated": with_settings(simulated_bench(recording.rig), drawn_by)}
    changed = with_settings(simulated_bench(rig), (*drawn_by, *asked.changes))
    if changed != rigs["simulated"]:
        rigs["changed"] = changed
    _say_not_known(changed)
    tracks = [recorded_track(recording, window)]
    for name, bench in rigs.items():
        check_geometry(bench)
        mirror = RecordedMirror(recording, window)
        session = ClosedLoopReplay(
            name,
            bench,
            mirror,
            record=asked.record if name == list(rigs)[-1] else None,
            command_line=shlex.join(["zeromethod", *sys.argv[1:]]),
            speed=asked.speed,
        )
        with progress(math.ceil(mirror.duration_s * bench.camera.rate_hz), name) as advance:
            try:
                tracks.append(session.run(lambda at_s, name=name: advance(f"{name}, {at_s:.2f} s")))  # type: ignore[misc]
            except KeyboardInterrupt:
                record = asked.record
                kept = f"{record} has" if record is not None and record.exists() else "nothing is kept of"
                raise KeyboardInterrupt(f"interrupted: {kept} the last session up to here") from None
        if session.recorder_state:
            click.echo(f"! {session.recorder_state}", err=True)
    sessions = {track.name: figures_of(track) for track in tracks}
    curves = {track.name: _curves(track) for track in tracks}
    Console().print(sessions_table(sessions))
    if asked.figure is not None:
        from zeromethod.view.replay_figure import draw_sessions  # noqa: PLC0415 - matplotlib loads slowly

        draw_sessions(curves, f"zeromethod  {recording.path.name}, loop closed again", asked.figure)
    left_out = contacts_left_out(recording, window)
    if left_out:
        some = "a contact" if left_out == 1 else f"{left_out} contacts"
        click.echo(f"! {some} of the recording left out: nothing touches the simulated bench", err=True)
    about = {"gl_renderer": session.gl_renderer, "changed": "changed" in rigs, "contacts_left_out": left_out}
    return {**about, "sessions": sessions, "curves": curves}


def _say_not_known(rig: Rig) -> None:
    """Say where what holds the rubber is not known."""
    if said := rig.rubber.not_known:
        click.echo(f"! {said}", err=True)


def _curves(track: Track) -> dict[str, Any]:
    frequency_hz, left = rejection(track)
    names = ("depth_peak_mm", "residual_rms_px", "depth_error_um")
    over_time = {name: track.values(name) for name in names}
    return {"time_s": track.time_s, "frequency_hz": frequency_hz, "left": left, **over_time}
