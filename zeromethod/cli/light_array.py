"""`zeromethod run` and `replay` with LED and detector arrays."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from zeromethod.cli.device_options import check_simulated, checked_scenario
from zeromethod.cli.output import write_summary, writing
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.errors import InputError, MeasurementError
from zeromethod.light_array.recording import replay
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.light_array.session import LightSession
from zeromethod.loop.state import State
from zeromethod.thread_limits import limit_threads
from zeromethod.view.light_array import light_table, plot_light_run
from zeromethod.view.live import LiveStatus
from zeromethod.view.table import pair_table

TAKEN = (
    "--rig", "--camera", "--simulate", "--scenario", "--seed", "--gain", "--frames", "--seconds", "--record",
    "--publish", "--figure", "--summary",
)  # fmt: skip
"""Options of `run` that arrays have; the others are of camera and LCD."""

_SHOW_EVERY_S = 0.05
"""A person reads no faster."""


def run_light_array(rig: LightArrayRig, typed: Sequence[str], given: Mapping[str, Any]) -> None:
    """Run arrays to the end. typed: options on the command line; given: values, by `run_command`'s names."""
    for option in typed:
        if option not in TAKEN:
            raise InputError(f"{option}: not with rig {rig.name!r}: arrays have {', '.join(TAKEN[1:])}")
    if given["simulate"] and given["address"] is not None:
        raise InputError("--simulate and --camera: give one of them, not both")

    rig = rig.changed(
        scenario=None if given["scenario"] is None else checked_scenario(given["scenario"]),
        simulation={"seed": given["seed"]},
        control={"gain": given["loop_gain"]},
        arrays={"address": "simulated" if given["simulate"] else given["address"]},
    )
    check_simulated(rig.arrays.address != "simulated", given["scenario"], given["seed"])
    limit_threads()
    frames, seconds = given["frames"], given["seconds"]
    with LightSession(rig, given["publish"], given["recording"]) as session:
        if session.address:
            click.echo(f"publishing at {session.address}", err=True)
        total = session.seconds(frames, seconds) if frames is None else float(frames)
        with (
            stopped_by_signals(session.interrupt),
            LiveStatus(Console(stderr=True), total, "seconds" if frames is None else "frames") as live,
        ):
            shown_s = 0.0
            for step in session.run(frames, seconds):
                if step.notes or time.monotonic() > shown_s + _SHOW_EVERY_S:
                    shown_s = time.monotonic()
                    sigma = {"peak_sigma_mm": session.history[-1][2]} if session.history else {}
                    live.update(step, step.number, sigma)
        figures = session.figures
    Console().print(light_table(figures))
    write_summary(given["summary"], figures)
    if (figure := given["figure"]) is not None:
        with writing("--figure", figure):
            plot_light_run(session, figure)
    if session.interrupted:
        raise KeyboardInterrupt
    if figures["state"] in {State.FAULT, State.LOST}:
        raise MeasurementError(f"{figures['state']}: {figures['reason']}")
    if not session.history:
        why = f": {figures['reason']}" if figures["reason"] else ""
        raise MeasurementError(f"no depth was read, {figures['state'] or 'nothing came'} at the end{why}")


def replay_light_array(path: Path, typed: Sequence[str], summary: Path | None) -> None:
    """Run the loop again on what arrays read, and say whether it does the same."""
    for option in typed:
        if option.startswith("-") and option != "--summary":
            raise InputError(f"{option}: not with a recording of arrays, which is run again as it was")
    limit_threads()
    with stopped_by_signals():
        figures = replay(path)
    readings = f"{figures['readings_differing']} of {figures['readings_of_depth']}"
    rows = [
        ("frames", str(figures["frames"])),
        ("levels that differ", f"{figures['levels_differing']} of {figures['levels']}"),
        ("readings of depth that differ", readings),
        ("the run is", "the same, bit for bit" if figures["equal"] else "not the same"),
    ]
    Console().print(pair_table(rows))
    write_summary(summary, {"recording": str(path), **figures})
