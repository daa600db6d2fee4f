"""`zeromethod run`: close the loop and read the surface."""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from zeromethod.calibration.folder import DOCUMENT, calibration_of, lacks_document
from zeromethod.cli.calibrated_bench import check_calibration
from zeromethod.cli.device_options import (
    REAL_CAMERAS,
    BenchOptions,
    bench_options,
    check_simulated,
    control_options,
    given_options,
    given_rig,
    rig_option,
    say_simulated,
    scenario_options,
    with_devices,
    with_given,
    without_display,
)
from zeromethod.cli.first_rest import with_first_rest
from zeromethod.cli.following import follow
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import figure_option, summary_option, write_summary, writing
from zeromethod.cli.page_options import opened_page, page_options
from zeromethod.cli.recording_options import RecordingOptions, recording_options
from zeromethod.cli.starting import Starting
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.devices.abilities import exposure_setter_of
from zeromethod.devices.addresses import with_projector, with_watch_camera
from zeromethod.devices.opening import open_devices
from zeromethod.errors import InputError, MeasurementError
from zeromethod.light_array.rig import load_light_array
from zeromethod.loop.state import State
from zeromethod.operating.readings import HISTORY
from zeromethod.operating.run_table import RUN
from zeromethod.optics import check_geometry
from zeromethod.publishing.publisher import Publisher, check_address
from zeromethod.session.fine import with_moving_target
from zeromethod.session.result import RunResult
from zeromethod.session.session import Session
from zeromethod.session.summary import summarise
from zeromethod.session.trust import DOUBT
from zeromethod.simulation.clone import simulated_clone
from zeromethod.thread_limits import limit_threads
from zeromethod.view.table import summary_table

_STRIPS = {True: "edges", False: "none", None: None}
"""Value of `[control] strips` for the option."""


def _address(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:  # noqa: ARG001
    """Refuse an address before anything is opened."""
    if value is not None:
        check_address(value)
    return value


@click.command(
    "run", epilog="Example: zeromethod run --scenario step --seconds 1 --figure run.png --summary run.json"
)
@rig_option()
@bench_options
@click.option(
    "--strips/--no-strips",
    default=None,
    help="Draw codes at two edges, which time each picture.  [default: with a real device]",
)
@click.option(
    "--latency",
    "latency_s",
    type=Real(-1, 10),
    metavar="S",
    help="Delay of display and camera, as `devices --delay` measures it.",
)
@click.option(
    "--watch-camera",
    "watch_address",
    metavar="ADDRESS",
    help="The rig's second camera, of two lenses, which sees what comes: as for --camera.",
)
@click.option(
    "--project",
    type=Whole(min=0),
    metavar="N",
    help="Monitor that is the rig's projector: see `devices`.",
)
@click.option(
    "--publish", metavar="ADDRESS", callback=_address, help="Publish every reading: tcp://127.0.0.1:5556."
)
@recording_options
@page_options
@click.option(
    "--auto-exposure", is_flag=True, help="Let the exposure follow the light, where the camera can."
)
@click.option("--force", is_flag=True, help="Run with a calibration that belongs to another bench.")
@click.option("--simulate", is_flag=True, help="Simulate the rig's bench instead of opening its devices.")
@scenario_options
@click.option("--frames", type=Whole(min=1), help="Stop after this many frames.")
@click.option("--seconds", type=Real(min=0, min_open=True), help="Stop after this time.")
@control_options
@click.option(
    "--passive",
    is_flag=True,
    help="Leave the picture at rest on the LCD, or, with a camera alone, a printed one: no loop.",
)
@click.option(
    "--follow-bench",
    is_flag=True,
    help="Correct motion of camera, LCD or prism where nothing presses, or two places are known to rest.",
)
@click.option(
    "--burst",
    type=click.Choice(["never", "when-needed", "always"]),
    help="Read folds and dents too fine for the LCD by coded pictures.  [default: when-needed]",
)
@click.option(
    "--fine",
    is_flag=True,
    help="Read depth on every camera pixel, too, about twice a second; the target then moves.",
)
@click.option(
    "--rubbing",
    is_flag=True,
    help="Read how cloth, brushes, pile or grains rub along the mirror: the contact status.",
)
@figure_option
@summary_option
def run_command(
    rig_name: str,
    strips: bool | None,
    latency_s: float | None,
    watch_address: str | None,
    project: int | None,
    publish: str | None,
    view: str | None,
    control: str | None,
    auto_exposure: bool,
    force: bool,
    simulate: bool,
    scenario: str | None,
    frames: int | None,
    seconds: float | None,
    seed: int | None,
    loop_gain: float | None,
    controller: str | None,
    passive: bool,
    follow_bench: bool,
    burst: str | None,
    fine: bool,
    rubbing: bool,
    figure: Path | None,
    summary: Path | None,
    **others: Any,
) -> None:
    """Close the loop: warp the LCD's pattern until the camera sees the target, read slope and depth.

    With --passive nothing is nulled: a pattern is seen as it is, slope and depth read as an open loop can.
    Without arguments, a simulated bench is pressed 0.2 mm deep, the press slides 10 mm and lifts. With
    --display and --camera it runs on real devices until q, Ctrl-C, or --seconds; then p pauses corrections
    and z takes the mirror as it is for the mirror at rest.
    """
    _check_length(frames, seconds)
    if (arrays := load_light_array(rig_name)) is not None:
        from zeromethod.cli.light_array import run_light_array  # noqa: PLC0415 - only these rigs need it

        context = click.get_current_context()
        run_light_array(arrays, given_options(context), context.params)
        return
    names = ("recording", "keep", "every", "compress")
    recording = RecordingOptions(**{name: others.pop(name) for name in names})
    recording.check(given_options(click.get_current_context()))
    options = BenchOptions(**others)
    rig = given_rig(rig_name, measured=not simulate)
    by = "--passive" if passive else f"rig {rig.name!r}, which is passive,"
    if passive := passive or rig.control.passive:
        _check_passive(by, given_options(click.get_current_context()))
        if options.address is not None and options.monitor is None:
            rig = without_display(rig)
    rig = with_projector(with_watch_camera(rig, watch_address), project, real=options.monitor is not None)
    if simulate:
        if given := (*options.given, *(["--watch-camera"] if watch_address else [])):
            raise InputError(f"--simulate and {given[0]}: give one of them, not both")
        rig = simulated_clone(rig)
    rig = with_devices(rig, options, passive=passive)
    check_simulated(rig.camera.driver in REAL_CAMERAS, scenario, seed)
    rig = with_given(
        rig,
        scenario,
        display={"latency_s": latency_s},
        simulation={"seed": seed},
        control={
            "gain": loop_gain,
            "controller": "passive" if passive else controller,
            "strips": _STRIPS[strips],
            "follow_bench": follow_bench or None,
            "burst": burst,
            "rubbing": rubbing or None,
        },
    )
    if fine:
        rig = with_moving_target(rig)
    check_geometry(rig)
    if not simulate and Path(rig_name).is_file():
        say_simulated(rig)
    limit_threads()
    with (
        opened_page(view, control, RUN, HISTORY) as page,
        Starting(Console(stderr=True), page, "opening LCD and camera") as say,
        open_devices(rig) as opened,
        nullcontext() if publish is None else Publisher(publish, opened.clock) as publisher,
    ):
        if auto_exposure and exposure_setter_of(opened.camera) is None:
            raise InputError(
                f"--auto-exposure: {type(opened.camera).__name__} cannot change its exposure during a run: "
                "give --exposure"
            )
        if publisher is not None:
            click.echo(f"publishing at {publisher.address}", err=True)
        stored = calibration_of(rig_name)
        if stored is not None and not simulate:
            check_calibration(stored, rig_name, rig, opened, force=force)
            if warning := stored.age_warning():
                click.echo(f"! {warning}", err=True)
        elif lacks_document(rig_name, rig.camera.rest_map):
            click.echo(
                f"! {rig_name}: no {DOCUMENT} next to it: whether it fits this bench is not checked", err=True
            )
        say("")
        with (
            with_first_rest(rig, rig_name, opened) as stated,
            nullcontext(say("preparing the loop: rays, shaders")),
            Session(
                stated,
                devices=opened,
                publisher=publisher,
                record=recording.maker(stated, stored, fine),
                fine=fine,
            ) as session,
            stopped_by_signals(session.interrupt),
        ):
            say("")
            began_s = time.perf_counter()
            follow(
                session,
                opened,
                (frames, seconds),
                page,
                auto_exposure=auto_exposure,
                calibration="" if stored is None or simulate else stored.words,
                folder=Path.cwd() if recording.recording is None else recording.recording.absolute().parent,
                recorder=lambda path: replace(recording, recording=path).maker(stated, stored, fine),
            )
        recording.report(session.result.recording_trouble, session.result.recording_astray)
        taken_s = None if session.loop.live else time.perf_counter() - began_s
        _report(session.result, figure, summary, taken_s)


def _check_length(frames: int | None, seconds: float | None) -> None:
    """Refuse two lengths of one run."""
    if frames is not None and seconds is not None:
        raise InputError("--frames and --seconds: give one of them, not both")


def _check_passive(by: str, typed: list[str]) -> None:
    """Refuse options of the loop, which a passive run has not. by: what makes it one."""
    for option in ("--controller", "--gain", "--strips", "--latency", "--burst", "--fine"):
        if option in typed:
            raise InputError(f"{by} and {option}: give one of them: a passive run has no loop")


def _where_time_went(result: RunResult, taken_s: float) -> str:
    """What a simulated run's computing was for. taken_s: all of it."""
    ms = [(one.loop_ms, one.draw_ms, one.read_ms) for one in result.records]
    loop_s, draw_s, read_s = 1e-3 * np.nansum(np.array(ms, dtype=np.float64).reshape(-1, 3), axis=0)
    own = f"loop {loop_s:.1f} s, drawing {draw_s:.1f} s, reading {read_s:.1f} s"
    return f"computed in {taken_s:.0f} s: {own}, the rest by the simulated bench; a real one takes no time"


def _report(result: RunResult, figure: Path | None, summary: Path | None, taken_s: float | None) -> None:
    """Print the table, write what was asked for, and turn the outcome into an exit code.

    taken_s: how long a simulated run took.
    """
    figures = summarise(result)
    Console().print(summary_table(figures))
    if taken_s is not None:
        click.echo(_where_time_went(result, taken_s))
    try:
        write_summary(summary, figures)
    finally:
        if figure is not None and result.records:
            from zeromethod.view.figure import plot_run  # noqa: PLC0415 - matplotlib loads slowly

            with writing("--figure", figure):
                plot_run(result, figure)
    if result.recording_lost:
        raise OSError(f"--record: {result.recording_trouble}")
    if result.interrupted:
        raise KeyboardInterrupt
    if result.state is State.MOVED:
        raise MeasurementError(
            f"{figures['reason']}: readings since then are not valid; fasten it, then press z (zero) with "
            "nothing touching the mirror, run with --follow-bench, or calibrate again"
        )
    if result.state in {State.FAULT, State.LOST}:
        raise MeasurementError(f"{result.state}: {figures['reason']}")
    if not figures["calibrated"]:
        raise MeasurementError(f"not calibrated: {DOUBT.reason}")
    if (when := figures["not_nulled"]) is not None:
        by_reading = result.rig.control.passive or result.rig.projector is not None
        what = "no frame was read" if by_reading else "the null was not held"
        raise MeasurementError(f"{what} {when}: {figures['not_nulled_reason']}")
