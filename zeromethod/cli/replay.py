"""`zeromethod replay`: a recorded session again, with other settings if wanted."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from zeromethod.cli.numbers import Real
from zeromethod.cli.output import check_file, write_summary
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


@click.command(
    "replay",
    epilog="Example: zeromethod replay session.h5 --again loop --gain 0.5 --figure replay.png",
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--again",
    type=click.Choice(["read", "sense", "loop"]),
    default="read",
    show_default=True,
    help="From where: the measured warps; the frames; the surface, on a simulated bench.",
)
@click.option("--set", "settings", metavar="KEY=VALUE", multiple=True, help="Another value of the rig's.")
@click.option("--rig", "rig_name", help="Another rig file, or a packaged name, in place of the recorded one.")
@click.option("--gain", type=Real(0, 1, min_open=True), help="loop: share of each correction.")
@click.option(
    "--controller",
    type=click.Choice(["composition", "integrator"]),
    help="loop: how they are applied.",
)
@click.option("--renderer", type=click.Choice(["gpu", "numpy"]), help="loop: what draws the simulated bench.")
@click.option("--from", "from_s", type=float, metavar="S", help="Seconds from the start of the recording.")
@click.option("--to", "to_s", type=float, metavar="S", help="Seconds from the start of the recording.")
@click.option(
    "--speed",
    type=Real(min=0, min_open=True),
    help="At most so many times as fast as it was: 1 = real time.  [default: as fast as it goes]",
)
@click.option(
    "--record", type=click.Path(path_type=Path, dir_okay=False), help="loop: record the last session (.h5)."
)
@click.option("--figure", type=click.Path(path_type=Path, dir_okay=False), help="Write a picture (.png).")
@click.option("--summary", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures (.json).")
def replay_command(
    file: Path,
    again: str,
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

    Without settings it tells whether this machine and version come to the recorded numbers. Reading and
    sensing again then give them bit for bit; the loop closed again has a simulated bench relive the surface,
    and gives the same statistics. With --set, --gain, ... the same is done with other settings, beside it.
    """
    check_file("--figure", figure, suffix=".png")
    check_file("--summary", summary, suffix=".json")
    _check_record(record)
    if again != "loop":
        alone = {"--gain": gain, "--controller": controller, "--renderer": renderer, "--record": record}
        for option, value in alone.items():
            if value is not None:
                raise InputError(f"{option}: {value}: only with --again loop, which closes the loop again")
    settings = (*settings, *_control(gain, controller))
    limit_threads()
    with stopped_by_signals(), Recording(file) as recording:
        window = Window.of(recording, from_s, to_s)
        if not recording.complete:
            click.echo(
                f"! {file}: goes on, or was not ended in order: it holds {recording.seconds:.3f} s", err=True
            )
        rig = recording.rig if rig_name is None else load_rig(rig_name)
        about: dict[str, Any] = {
            "recording": str(file),
            "again": again,
            "settings": list(settings),
            "rig": rig.name,
            "from_s": 1e-9 * (window.from_ns - window.start_ns),
            "to_s": 1e-9 * (window.to_ns - window.start_ns),
        }
        if again == "loop":
            _relive(recording, window, rig, settings, renderer, speed, record, about, figure)
        else:
            rig = with_settings(rig, settings)
            check_geometry(rig)
            _again(recording, window, rig, again, speed, about, figure)
        if summary is not None:
            write_summary(summary, about)


def _check_record(record: Path | None) -> None:
    check_file("--record", record, suffix=".h5")
    if record is not None and record.exists():
        raise InputError(f"--record: {record}: is there already: recordings are not overwritten")


def _control(gain: float | None, controller: str | None) -> list[str]:
    """Options as settings; where `--set` says otherwise, they win."""
    given = [] if gain is None else [f"control.gain={gain}"]
    return given if controller is None else [*given, f"control.controller={controller}"]


def _again(
    recording: Recording,
    window: Window,
    rig: Rig,
    again: str,
    speed: float | None,
    about: dict[str, Any],
    figure: Path | None,
) -> None:
    """Read or sense again, print the differences and put them into `about`."""
    turns = recording.steps
    upto = turns["number"][turns["time_ns"] <= window.to_ns]
    if again == "read":
        with progress(int(np.isin(recording.peaks["step"], upto).sum()), "reading") as advance:
            depths = replay_from_warps(recording, rig, window, speed=speed, on_step=_telling(advance))
        figures = depths.figures
        equal = not depths.different
    else:
        with progress(int(turns["sensed"][: len(upto)].sum()), "sensing") as advance:
            warps, depths = replay_from_frames(recording, rig, window, speed=speed, on_step=_telling(advance))
        figures = depths.figures | warps.figures
        equal = not (depths.different or warps.different)
    about |= {"changed": rig != recording.rig, "equal": equal, **figures}
    Console().print(differences_table(figures))
    if figure is not None:
        from zeromethod.view.replay_figure import draw_differences  # noqa: PLC0415 - matplotlib loads slowly

        draw_differences(figures, f"zeromethod  {recording.path.name} {_participle(again)} again", figure)


def _participle(again: str) -> str:
    return {"read": "read", "sense": "sensed"}[again]


def _telling(advance: Callable[[str], None]) -> Callable[[float], None]:
    return lambda at_s: advance(f"{at_s:.2f} s")


def _relive(
    recording: Recording,
    window: Window,
    rig: Rig,
    settings: tuple[str, ...],
    renderer: str | None,
    speed: float | None,
    record: Path | None,
    about: dict[str, Any],
    figure: Path | None,
) -> None:
    """Live through it as it was, and with other settings if there are any; print all beside each other."""
    drawn_by = () if renderer is None else (f"simulation.renderer={renderer}",)
    benches = {"simulated": with_settings(simulated_bench(recording.rig), drawn_by)}
    changed = with_settings(simulated_bench(rig), (*drawn_by, *settings))
    if changed != benches["simulated"]:
        benches["changed"] = changed
    tracks = [recorded_track(recording, window)]
    for number, (name, bench) in enumerate(benches.items(), start=1):
        check_geometry(bench)
        last = number == len(benches)
        mirror = RecordedMirror(recording, window)
        told = shlex.join(["zeromethod", *sys.argv[1:]])
        session = ClosedLoopReplay(
            name, bench, mirror, record=record if last else None, command_line=told, speed=speed
        )
        with progress(math.ceil(mirror.duration_s * bench.camera.rate_hz), name) as advance:
            try:
                tracks.append(session.run(lambda at_s, name=name: advance(f"{name}, {at_s:.2f} s")))  # type: ignore[misc]
            except KeyboardInterrupt:
                _tell_interrupted(record)
                raise
        about["gl_renderer"] = session.gl_renderer
        if session.recorder_state:
            click.echo(f"! {session.recorder_state}", err=True)
    sessions = {track.name: figures_of(track) for track in tracks}
    curves = {track.name: _curves(track) for track in tracks}
    about |= {"changed": "changed" in benches, "sessions": sessions, "curves": curves}
    Console().print(sessions_table(sessions))
    if figure is not None:
        from zeromethod.view.replay_figure import draw_sessions  # noqa: PLC0415 - matplotlib loads slowly

        draw_sessions(curves, f"zeromethod  {recording.path.name} simulated", figure)


def _tell_interrupted(record: Path | None) -> None:
    """Say what is there of the sessions: their comparison is of whole ones."""
    kept = (
        f"{record} has the last one up to here"
        if record is not None and record.exists()
        else "nothing is kept"
    )
    click.echo(f"interrupted before all sessions were lived through: {kept}", err=True)


def _curves(track: Track) -> dict[str, Any]:
    frequency_hz, left = rejection(track)
    names = ("depth_peak_mm", "residual_rms_px", "depth_error_um")
    over_time = {name: track.values(name) for name in names}
    return {"time_s": track.time_s, "frequency_hz": frequency_hz, "left": left, **over_time}
