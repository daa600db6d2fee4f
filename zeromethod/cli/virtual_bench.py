"""`zeromethod virtual-bench`: a simulated bench in a process of its own, without prism and camera."""

from __future__ import annotations

import math
import signal
import threading
from contextlib import closing, nullcontext
from pathlib import Path

import click

from zeromethod.cli.device_options import given_rig, rig_option, scenario_options, with_given
from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import REPLACES, OutputFile
from zeromethod.cli.stopping import quiet_imports
from zeromethod.errors import InputError
from zeromethod.optics import check_geometry
from zeromethod.thread_limits import limit_threads


@click.command("virtual-bench", epilog="Example: zeromethod virtual-bench --monitor 1 --truth truth.jsonl")
@rig_option("virtual")
@scenario_options
@click.option(
    "--monitor",
    type=Whole(min=0),
    default=1,
    show_default=True,
    help="Which monitor plays the LCD, counted as `run --display` counts.",
)
@click.option(
    "--port",
    type=Whole(0, 65535),
    default=5005,
    show_default=True,
    help="Where the camera's stream is served (0: any free port).",
)
@click.option("--rate", "rate_hz", type=float, help="Frames per second. [default: the rig's]")
@click.option(
    "--truth", "truth_path", type=OutputFile(".jsonl"), help=f"Write the truth (.jsonl). {REPLACES}"
)
@click.option("--repeat", "repeats", type=Whole(min=1), help="Play the scenario this often. [default: 1]")
@click.option("--forever", is_flag=True, help="Play the scenario again and again.")
@click.option(
    "--start-after",
    "start_after_s",
    type=Real(min=0),
    default=0.0,
    show_default=True,
    help="Seconds from the first client to the scenario's start.",
)
def virtual_bench_command(
    rig_name: str,
    scenario: str | None,
    monitor: int,
    port: int,
    rate_hz: float | None,
    truth_path: Path | None,
    seed: int | None,
    repeats: int | None,
    forever: bool,
    start_after_s: float,
) -> None:
    """Simulate prism and camera: bend what a monitor shows, serve it as a camera stream, write the truth.

    The scenario starts when the first client connects. The bench ends on Ctrl-C, and once the scenario is
    over and the client has gone.
    """
    if repeats is not None and forever:
        raise InputError("--repeat and --forever: give one of them, not both")
    rig = given_rig(rig_name)
    most_hz = 1 / rig.camera.exposure_s
    if rate_hz is not None and not 0 < rate_hz <= most_hz:
        raise InputError(f"--rate: {rate_hz:g}: above 0 and at most 1 / camera.exposure_s = {most_hz:g} Hz")
    rig = with_given(rig, scenario, simulation={"seed": seed}, camera={"rate_hz": rate_hz})
    check_geometry(rig)
    limit_threads()

    with quiet_imports():
        from zeromethod.simulation.scenario import scenario_of  # noqa: PLC0415 - loads slowly
        from zeromethod.simulation.virtual_bench.bench import Bender, Performance, VirtualBench  # noqa: PLC0415
        from zeromethod.simulation.virtual_bench.grab import MonitorGrabber, find_monitor  # noqa: PLC0415
        from zeromethod.simulation.virtual_bench.stream import FrameServer, stream_header  # noqa: PLC0415
        from zeromethod.simulation.virtual_bench.truth import TruthFile  # noqa: PLC0415

    found = find_monitor(monitor, (rig.display.columns, rig.display.rows))
    camera = rig.camera
    header = stream_header(camera.columns, camera.rows, camera.rate_hz, camera.bits)
    with (
        closing(Bender(rig)) as bender,
        closing(FrameServer(port, header)) as server,
        TruthFile(truth_path, rig, rig.scenario) if truth_path else nullcontext() as truth,
    ):
        bench = VirtualBench(
            rig,
            Performance(scenario_of(rig), math.inf if forever else repeats or 1, start_after_s),
            bender,
            server,
            lambda: MonitorGrabber(found),
            truth,
        )
        stop = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
        click.echo(f"monitor {found}")
        click.echo("In another terminal start (or `calibrate` or `check`, with the same options):")
        address = f"tcp://127.0.0.1:{server.port}"
        click.echo(f"  zeromethod run --rig {rig_name} --display {monitor} --camera {address}")
        bench.run(stop, click.echo)
        click.echo(f"{bench.frames} frames, {bench.late} of them later than the rig's camera_latency_s")
