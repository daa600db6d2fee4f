"""What recording costs the loop, and what a kill leaves of a recording.

The live loop (camera and drawing in threads, reading of surfaces in a process of its own, coded strips) runs
over frames of 1280x1024 in 8 bits from memory, noise and all, at 60 per second of the host's clock: not
recording, recording for two minutes (--quick: 15 s), not recording again. Every frame is an array of its own,
as a camera's driver hands it over; pictures are taken at once. Everything that `run --record` keeps is
recorded, if --keep does not say otherwise: some 4 MB per frame, up to 30 GB in FOLDER, removed at the end.

Other programs on the machine change the loop's rate as well: so it then records and does not record by turns,
block by block, and each block is compared with the mean of its neighbours.

rate: frames that the loop took per second, of those that the camera gave. turn: from a frame in hand to the
command made of it. cpu: processor time per frame, of the loop's thread and of its whole process. lost: frames
that the loop took and that are not in the file.

Then the same in a process of its own, which is killed with SIGKILL in the middle, as is the process that
writes for it: every frame that the loop took half a second before must be there.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import click
import h5py
import numpy as np

from benchmarks.memory_devices import FastLiveClock, MemoryCamera, MemoryDisplay, Noted, Prepared
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import changed
from zeromethod.cli.recording_options import parts_of
from zeromethod.devices.protocols import Frame
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.recording.recorder import Recorder
from zeromethod.recording.recording import Recording
from zeromethod.recording.schema import KEEP
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.reading import StepReader, first_warp, timed
from zeromethod.session.surfaces import Surfaces
from zeromethod.view.progress import progress

SECONDS, QUICK_S = 120.0, 15.0
BEFORE = 0.25
"""Share of the recording's time that the loop runs before and after without."""

BLOCK_S = 2.0
"""Length of the parts that alternate."""

LEFT_OUT_S = 0.5
"""Beginning of each part that is not counted."""

COST = 0.05
OLD_S = 0.5


class OwnFrames(MemoryCamera):
    """Hands out arrays that are nobody else's."""

    def read(self, timeout_s: float) -> Frame:
        """Newest frame."""
        frame = super().read(timeout_s)
        return replace(frame, image=frame.image.copy())


@dataclass(frozen=True)
class Part:
    """What came of one part. seconds, frames: without its beginning. turn_ms: median, 99 % of `loop_ms`."""

    name: str
    seconds: float
    frames: int
    dropped: int
    turn_ms: tuple[float, float]
    cpu_ms: float
    process_ms: float

    @property
    def rate_hz(self) -> float:
        """Frames that the loop took per second."""
        return self.frames / self.seconds

    @property
    def given_hz(self) -> float:
        """Frames that the camera gave per second."""
        return (self.frames + self.dropped) / self.seconds


class Bench:
    """The live loop over devices of memory, and who reads its surfaces."""

    def __init__(self, prepared: Prepared) -> None:
        rig = prepared.rig
        self.rig = rig
        clock = FastLiveClock(True)
        display = MemoryDisplay(prepared, False, clock)
        self.clock = clock
        self._stack = ExitStack()
        self._stack.enter_context(patch("zeromethod.loop.drawing.PatternRenderer", Noted))
        camera = OwnFrames(prepared, display, clock)
        self.loop = self._stack.enter_context(Loop(rig, camera, display, clock, optics=prepared.optics))
        surfaces = Surfaces(rig, prepared.optics, self.loop.grid)
        self._stack.enter_context(surfaces.in_own_process(first_warp(self.loop.rest)))
        self.recorder: Recorder | None = None

        def read(step: Step) -> Step:
            measured = step.measured
            assert measured is not None
            surface, deepest, read_ms = timed(lambda: surfaces.read(measured))
            step = replace(step, surface=surface, peak=deepest, read_ms=read_ms)
            if self.recorder is not None:
                self.recorder.add_reading(step)
            return step

        self._reading = StepReader(read, None, live=True)
        self._stack.callback(self._reading.close)
        self._steps = self.loop.run()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *exception: object) -> None:
        self._steps.close()
        self._stack.close()

    def steps(self, seconds: float) -> Iterator[Step]:
        """Steps for a while; recorded where there is a recorder."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            step = next(self._steps)
            self._reading.post(step)
            self._reading.collect()
            if self.recorder is not None:
                self.recorder.add_step(step)
            yield step

    def part(self, name: str, seconds: float) -> Part:
        """Run for a while, and take figures."""
        for _ in self.steps(LEFT_OUT_S):
            pass
        began_s, cpu_s, process_s = time.monotonic(), time.thread_time(), time.process_time()
        steps = [(step.dropped, step.loop_ms) for step in self.steps(seconds)]
        seconds, cpu_s = time.monotonic() - began_s, time.thread_time() - cpu_s
        process_ms = 1e3 * (time.process_time() - process_s) / len(steps)
        cpu_ms = 1e3 * cpu_s / len(steps)
        dropped, loop_ms = np.array(steps).T
        middle, late = (float(value) for value in np.percentile(loop_ms, (50, 99)))
        return Part(name, seconds, len(steps), int(dropped.sum()), (middle, late), cpu_ms, process_ms)


@contextmanager
def recording(bench: Bench, path: Path, keep: Sequence[str]) -> Iterator[Recorder]:
    """Record into `path` meanwhile."""
    loop = bench.loop
    with Recorder(path, bench.rig, loop.rest, keep=keep, live=True, command_line="benchmark") as recorder:
        bench.recorder = recorder
        try:
            yield recorder
        finally:
            bench.recorder = None


def by_turns(bench: Bench, path: Path, keep: Sequence[str], seconds: float) -> list[Part]:
    """Blocks without, with, without, ... recording."""
    blocks = []
    with recording(bench, path, keep) as recorder:
        for number in range(2 * max(3, round(seconds / BLOCK_S / 2)) + 1):
            bench.recorder = recorder if number % 2 else None
            blocks.append(bench.part("recording" if number % 2 else "not recording", BLOCK_S - LEFT_OUT_S))
    path.unlink()
    return blocks


def lost_rates(blocks: list[Part]) -> np.ndarray:
    """Share of the rate that each block with recording has less than the mean of its neighbours."""
    rates = np.array([block.rate_hz for block in blocks])
    lost: np.ndarray = 1.0 - rates[1::2] / (0.5 * (rates[:-1:2] + rates[2::2]))
    return lost


def missing_frames(path: Path) -> tuple[int, int]:
    """(frames that the loop took and that are not in the file, frames in it)."""
    with Recording(path) as found:
        turns = found.steps
        taken = turns["number"][turns["frame_number"] >= 0]
        group = "frames" if "frames" in found.kept else "warps/commanded"
        kept = found.steps_with(group)
    return int(np.setdiff1d(taken, kept).size), int(kept.size)


def run_and_print(rig: Rig, path: Path, keep: Sequence[str]) -> None:
    """Record until killed; print every turn that was handed over."""
    with Bench(Prepared(rig)) as bench:
        # compiled and settled before
        for _ in bench.steps(2.0):
            pass
        with recording(bench, path, keep) as recorder:
            print(json.dumps({"writer": recorder.writer_id}), flush=True)
            for step in bench.steps(1e9):
                print(json.dumps({"turn": step.number, "at_ns": time.monotonic_ns()}), flush=True)


@dataclass(frozen=True)
class Killed:
    """What a kill left. newest_s: age of the newest frame that is there, at the kill."""

    handed: int
    there: int
    old_missing: int
    newest_s: float
    plain: bool


def kill_in_the_middle(path: Path, keep: Sequence[str], seconds: float) -> Killed:
    """Kill a recording run and what writes for it; see what is there."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.recording_cost",
        "--record",
        str(path),
        "--keep",
        ",".join(keep),
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    handed: dict[int, int] = {}
    writer = None
    until_s = float("inf")
    for line in process.stdout:
        news = json.loads(line)
        if "writer" in news:
            writer, until_s = news["writer"], time.monotonic() + seconds
            continue
        handed[news["turn"]] = news["at_ns"]
        if time.monotonic() > until_s:
            break
    assert writer is not None
    killed_ns = time.monotonic_ns()
    os.kill(process.pid, signal.SIGKILL)
    os.kill(writer, signal.SIGKILL)
    process.wait()
    with Recording(path) as found:
        there = {int(turn) for turn in found.steps_with("frames" if "frames" in keep else "warps/commanded")}
        images = sum(found.image(turn) is not None for turn in sorted(there)[-30:])
    old = {turn for turn, at_ns in handed.items() if killed_ns - at_ns > 1e9 * OLD_S}
    newest_s = 1e-9 * (killed_ns - handed[max(there & handed.keys())])
    with h5py.File(path, "r", swmr=True) as file:
        plain = "frames" not in keep or (images == 30 and bool(file["frames/image"][-1].any()))
    return Killed(len(handed), len(there), len(old - there), newest_s, plain)


def measure(rig: Rig, folder: Path, keep: Sequence[str], seconds: float) -> Report:
    """Run everything; see the module."""
    path = folder / "session.h5"
    with progress(5, "recording cost") as bar, Bench(Prepared(rig)) as bench:
        bar()
        before = bench.part("not recording, before", BEFORE * seconds)
        bar()
        with recording(bench, path, keep) as recorder:
            during = bench.part("recording", seconds)
            state, waiting_mb = str(recorder.status), 1e-6 * recorder.waiting_bytes
        writer = resource.getrusage(resource.RUSAGE_CHILDREN)
        size_mb = 1e-6 * path.stat().st_size
        bar()
        missing, kept = missing_frames(path)
        path.unlink()
        after = bench.part("not recording, after", BEFORE * seconds)
        bar()
        blocks = by_turns(bench, folder / "blocks.h5", keep, seconds)
        lost = lost_rates(blocks)
    killed = kill_in_the_middle(folder / "killed.h5", keep, min(seconds / 2, 30.0))
    writer_ms = 1e3 * (writer.ru_utime + writer.ru_stime) / (missing + kept)
    reference = 0.5 * (before.rate_hz + after.rate_hz)
    cost = 1.0 - during.rate_hz / reference
    turn = during.turn_ms[0] / (0.5 * (before.turn_ms[0] + after.turn_ms[0])) - 1.0
    figures = [
        Figure("rate lost by recording", f"{100 * cost:+.2f} %", f"< {100 * COST:g} %", cost < COST),
        Figure(
            f"rate lost by recording, by turns (median of {len(lost)})",
            f"{100 * np.median(lost):+.2f} % +- {100 * np.std(lost) / len(lost) ** 0.5:.2f}",
            f"< {100 * COST:g} %",
            bool(np.median(lost) < COST),
        ),
        Figure("turn longer while recording (median)", f"{100 * turn:+.1f} %"),
        Figure(
            "frames lost of those that the loop took", f"{missing} of {missing + kept}", "0", missing == 0
        ),
        Figure("state reported to the operator at the end", state or "all is well", "all is well", not state),
        Figure(
            "kill -9: frames older than 0.5 s that are not there",
            f"{killed.old_missing} of {killed.handed}",
            "0",
            killed.old_missing == 0,
        ),
        Figure("kill -9: age of the newest frame that is there", f"{killed.newest_s:.2f} s"),
        Figure("kill -9: opens with plain h5py", str(killed.plain), "True", killed.plain),
        Figure("processor time of the process that writes", f"{writer_ms:.2f} ms per frame"),
        Figure("written", f"{size_mb:.0f} MB, {size_mb / (seconds + LEFT_OUT_S):.0f} MB/s"),
        Figure("waiting for the disk at the end", f"{waiting_mb:.0f} MB"),
    ]
    rows: list[tuple[str, ...]] = [
        ("", "s", "frames/s", "given/s", "dropped", "turn ms: median", "99 %", "cpu ms: loop", "process")
    ]
    for part in (before, during, after):
        values = (part.seconds, part.rate_hz, part.given_hz)
        rows.append(
            (
                part.name,
                *(f"{value:.1f}" for value in values),
                f"{part.dropped}",
                *(f"{value:.2f}" for value in (*part.turn_ms, part.cpu_ms, part.process_ms)),
            )
        )
    data: dict[str, Any] = {
        "parts": [asdict(part) for part in (before, during, after)],
        "blocks": [asdict(block) for block in blocks],
        "writer_ms": writer_ms,
        "killed": asdict(killed),
        "keep": keep,
        "cost": cost,
        "missing": missing,
        "kept": kept,
        "size_mb": size_mb,
        "cores": os.cpu_count(),
    }
    camera = rig.camera
    title = (
        f"Recording {', '.join(keep)}: {camera.columns}x{camera.rows}, {camera.bits} bits, "
        f"{camera.rate_hz:g} frames/s, {seconds:g} s, {os.cpu_count()} cores"
    )
    return Report(title, figures, rows, data)


@benchmark(
    "recording_cost",
    __doc__,
    click.option(
        "--keep", default=",".join(KEEP), show_default=True, callback=parts_of, help="What is recorded."
    ),
    click.option(
        "--folder",
        type=click.Path(path_type=Path, exists=True, file_okay=False, writable=True),
        help="Where to record to.  [default: the system's folder for temporary files]",
    ),
    click.option("--record", type=click.Path(path_type=Path), hidden=True),
)
def command(quick: bool, keep: tuple[str, ...], folder: Path | None, record: Path | None) -> Report | None:
    rig = changed(load_rig("simulated"), control={"strips": "edges"})
    if record is not None:
        run_and_print(rig, record, keep)
        return None
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        return measure(rig, Path(scratch), keep, QUICK_S if quick else SECONDS)


if __name__ == "__main__":
    start(command)
