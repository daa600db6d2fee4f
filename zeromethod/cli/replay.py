"""`zeromethod replay`: evaluate a recording again, or close its loop again, with other settings if wanted."""

from __future__ import annotations

import math
import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from zeromethod.cli.numbers import Real
from zeromethod.cli.output import OutputFile, figure_option, summary_option, write_summary
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.errors import InputError
from zeromethod.optics import check_geometry
from zeromethod.recording.recording import Recording
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.replay.closed_loop import ClosedLoopReplay, recorded_track, simulated_bench
from zeromethod.session.replay.comparison import figures_of, rejection
from zeromethod.session.replay.from_frames import replay_from_frames
from zeromethod.session.replay.from_warps import replay_from_warps
from zeromethod.session.replay.mirror import RecordedMirror
from zeromethod.session.replay.settings import with_settings
from zeromethod.session.replay.track import Track
from zeromethod.session.replay.window import Window
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.replay_table import differences_table, sessions_table

FROM_WARPS, FROM_FRAMES, CLOSED_LOOP = "from-warps", "from-frames", "closed-loop"


@dataclass(frozen=True)
class _Replay:
    """What was asked for; `figures` are those of `--summary`, which every mode adds to."""

    recording: Recording
    window: Window
    rig: Rig
    settings: tuple[str, ...]
    speed: float | None
    figure: Path | None
    figures: dict[str, Any] = field(default_factory=dict)


@click.command(
    "replay", epilog="Example: zeromethod replay session.h5 --mode closed-loop --gain 0.5 --figure replay.png"
)
@click.argument("file", type=click.Path(path_type=Path))
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
@click.option("--gain", type=Real(0, 1, min_open=True), help="closed-loop: share of each correction applied.")
@click.option(
    "--controller",
    type=click.Choice(["composition", "integrator"]),
    help="closed-loop: how corrections are applied.",
)
@click.option(
    "--renderer", type=click.Choice(["gpu", "numpy"]), help="closed-loop: what draws the simulated bench."
)
@click.option("--from", "from_s", type=float, metavar="S", help="Seconds from the start of the recording.")
@click.option("--to", "to_s", type=float, metavar="S", help="Seconds from the start of the recording.")
@click.option(
    "--speed",
    type=Real(min=0, min_open=True),
    help="At most so many times as fast as it was: 1 = real time.  [default: as fast as it goes]",
)
@click.option(
    "--record", type=OutputFile(".h5", new=True), help="closed-loop: record the last session (.h5)."
)
@figure_option
@summary_option
def replay_command(
    file: Path,
    mode: str,
    settings: tuple[str, ...],
    rig_name: str | None,
    gain: float | None,
    controller: str | None,
    renderer: str | None,
    from_s: float | None,
    to_s: float | None,
    speed: float | None,
    record: Path | None,
    figure: Path | None,
    summary: Path | None,
) -> None:
    """Replay a recording: FILE is what `run --record` wrote. No display or camera is needed.

    Without settings it says whether this machine and version come to the recorded numbers. From warps and
    from frames they are the same bit for bit; in a closed loop a simulated bench repeats the recorded
    surface, and the statistics are the same. With --set, --gain, ... the same is done with
    other settings, for comparison.
    """
    if mode != CLOSED_LOOP:
        alone = {"--gain": gain, "--controller": controller, "--renderer": renderer, "--record": record}
        for option, value in alone.items():
            if value is not None:
                raise InputError(f"{option}: {value}: only with --mode {CLOSED_LOOP}")
    control = {"control.gain": gain, "control.controller": controller}
    # these win over `--set`
    settings = (*settings, *(f"{key}={value}" for key, value in control.items() if value is not None))
    limit_threads()
    with stopped_by_signals(), Recording(file) as recording:
        window = Window.of(recording, from_s, to_s)
        if not recording.complete:
            click.echo(
                f"! {file}: is still being written, or was cut off: {recording.seconds:.3f} s are in it",
                err=True,
            )
        rig = recording.rig if rig_name is None else load_rig(rig_name)
        figures: dict[str, Any] = {
            "recording": str(file),
            "mode": mode,
            "settings": list(settings),
            "rig": rig.name,
            "from_s": 1e-9 * (window.from_ns - window.start_ns),
            "to_s": 1e-9 * (window.to_ns - window.start_ns),
        }
        asked = _Replay(recording, window, rig, settings, speed, figure, figures)
        if mode == CLOSED_LOOP:
            _close_loop(asked, renderer, record)
        else:
            _evaluate(asked, mode)
        if summary is not None:
            write_summary(summary, figures)


def _evaluate(asked: _Replay, mode: str) -> None:
    """Evaluate the warps or the frames again, and print how far the numbers differ."""
    recording, window = asked.recording, asked.window
    rig = with_settings(asked.rig, asked.settings)
    check_geometry(rig)
    turns = recording.steps
    upto = turns["number"][turns["time_ns"] <= window.to_ns]
    if mode == FROM_WARPS:
        with progress(int(np.isin(recording.peaks["step"], upto).sum()), "reading") as advance:
            depths = replay_from_warps(
                recording, rig, window, speed=asked.speed, on_step=lambda at_s: advance(f"{at_s:.2f} s")
            )
        figures = depths.figures
        equal = not depths.different
    else:
        with progress(int(turns["sensed"][: len(upto)].sum()), "sensing") as advance:
            warps, depths = replay_from_frames(
                recording, rig, window, speed=asked.speed, on_step=lambda at_s: advance(f"{at_s:.2f} s")
            )
        figures = depths.figures | warps.figures
        equal = not (depths.different or warps.different)
    asked.figures.update(changed=rig != recording.rig, equal=equal, **figures)
    Console().print(differences_table(figures))
    if asked.figure is not None:
        from zeromethod.view.replay_figure import draw_differences  # noqa: PLC0415 - matplotlib loads slowly

        title = f"zeromethod  {recording.path.name} again {mode.replace('-', ' ')}"
        draw_differences(figures, title, asked.figure)


def _close_loop(asked: _Replay, renderer: str | None, record: Path | None) -> None:
    """Repeat the session on a simulated bench, and with other settings if there are any."""
    recording, window = asked.recording, asked.window
    drawn_by = () if renderer is None else (f"simulation.renderer={renderer}",)
    benches = {"simulated": with_settings(simulated_bench(recording.rig), drawn_by)}
    changed = with_settings(simulated_bench(asked.rig), (*drawn_by, *asked.settings))
    if changed != benches["simulated"]:
        benches["changed"] = changed
    tracks = [recorded_track(recording, window)]
    for name, bench in benches.items():
        check_geometry(bench)
        mirror = RecordedMirror(recording, window)
        session = ClosedLoopReplay(
            name,
            bench,
            mirror,
            record=record if name == list(benches)[-1] else None,
            command_line=shlex.join(["zeromethod", *sys.argv[1:]]),
            speed=asked.speed,
        )
        with progress(math.ceil(mirror.duration_s * bench.camera.rate_hz), name) as advance:
            try:
                tracks.append(session.run(lambda at_s, name=name: advance(f"{name}, {at_s:.2f} s")))  # type: ignore[misc]
            except KeyboardInterrupt:
                kept = f"{record} has" if record is not None and record.exists() else "nothing is kept of"
                click.echo(f"interrupted: {kept} the last session up to here", err=True)
                raise
        asked.figures["gl_renderer"] = session.gl_renderer
        if session.recorder_state:
            click.echo(f"! {session.recorder_state}", err=True)
    sessions = {track.name: figures_of(track) for track in tracks}
    curves = {track.name: _curves(track) for track in tracks}
    asked.figures.update(changed="changed" in benches, sessions=sessions, curves=curves)
    Console().print(sessions_table(sessions))
    if asked.figure is not None:
        from zeromethod.view.replay_figure import draw_sessions  # noqa: PLC0415 - matplotlib loads slowly

        draw_sessions(curves, f"zeromethod  {recording.path.name}, loop closed again", asked.figure)


def _curves(track: Track) -> dict[str, Any]:
    frequency_hz, left = rejection(track)
    names = ("depth_peak_mm", "residual_rms_px", "depth_error_um")
    over_time = {name: track.values(name) for name in names}
    return {"time_s": track.time_s, "frequency_hz": frequency_hz, "left": left, **over_time}
