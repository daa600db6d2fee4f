"""One way to run the loop over devices of memory, and what its turns took."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from benchmarks.memory_devices import (
    Drawn,
    FastClock,
    FastLiveClock,
    MemoryCamera,
    MemoryDisplay,
    Noted,
    Prepared,
    fingerprint,
)
from benchmarks.process_use import spent_ms
from benchmarks.rigs import changed
from zeromethod.clock import Clock
from zeromethod.contact import ContactFinder, ForceReader
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED, READ
from zeromethod.loop.step import Step
from zeromethod.publishing import Publisher
from zeromethod.recording.recorder import Recorder
from zeromethod.session.reading import StepReader, first_warp
from zeromethod.session.surfaces import Surfaces
from zeromethod.thread_limits import limit_threads
from zeromethod.warp.warp import Role, Warp

LEFT_OUT = 6
"""First turns of a loop: the first picture, and what is looked up once."""

SUBSCRIBER = """
import sys, zmq
socket = zmq.Context().socket(zmq.SUB)
socket.setsockopt(zmq.CONFLATE, 1)
socket.subscribe(b"zeromethod.v2\\n")
socket.connect(sys.argv[1])
socket.recv()
print("connected", flush=True)
while True:
    socket.recv()
"""


@dataclass(frozen=True)
class Variant:
    """One way to run the loop.

    steady: as `Loop.run` does, without Python's own garbage collection. pools: libraries take every core.
    reads: surfaces are read, in a process of their own. records: everything is recorded.
    subscriber: None (nothing is published), none, reading, stopped.
    """

    name: str
    live: bool = True
    strips: bool = True
    steady: bool = True
    pools: bool = False
    drawn: bool = False
    reads: bool = False
    records: bool = False
    subscriber: str | None = None
    waits: bool = False


@dataclass(frozen=True)
class Timed:
    """One turn, ms. `number` of the turn; answer_ms NaN where nothing new was shown.

    measured: its surface was asked for. read_ms: how long reading that took; NaN where it was not read.
    dropped: frames of the camera just before it that the loop never had.
    """

    number: int
    answer_ms: float
    loop_ms: float
    turn_ms: float
    cpu_ms: float
    nulled: bool
    events: list[str]
    measured: bool = False
    read_ms: float = float("nan")
    dropped: int = 0


@contextmanager
def _published(loop: Loop, clock: Clock, kind: str | None) -> Iterator[Publisher | None]:
    """A publisher, and as `kind` says a subscriber in a process of its own that has got its first message."""
    if kind is None:
        yield None
        return
    with ExitStack() as stack:
        publisher = stack.enter_context(Publisher("tcp://127.0.0.1:*", clock))
        if kind != "none":
            command = [sys.executable, "-c", SUBSCRIBER, publisher.address]
            process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
            stack.callback(process.kill)
            assert process.stdout is not None
            os.set_blocking(process.stdout.fileno(), False)
            while not process.stdout.read():
                publisher.publish(_blank(loop, clock.now_ns()))
                time.sleep(0.02)
            if kind == "stopped":
                process.send_signal(signal.SIGSTOP)
        yield publisher


def _blank(loop: Loop, time_ns: int) -> Step:
    nothing = Warp.drawn(loop.rest.q, Role.COMMANDED, time_ns)
    state = loop.status.state
    return Step(number=0, time_ns=time_ns, time_s=0.0, state=state, commanded=nothing, filtered=nothing)


class Running:
    """One variant's loop and what its turns took; a context that ends it."""

    def __init__(self, variant: Variant, prepared: Prepared, frames: int) -> None:
        self._live, self._frames = variant.live, frames
        self._pools = variant.pools
        rig = changed(prepared.rig, control={"strips": "edges" if variant.strips else "none"})
        clock = (FastLiveClock if variant.live else FastClock)(variant.waits)
        self._clock = clock
        self._display = MemoryDisplay(prepared, variant.drawn, clock)
        self._camera = MemoryCamera(prepared, self._display, clock)
        self._turns: list[tuple[Timed, float, float]] = []
        self._reading: StepReader | None = None
        self._read_ms: dict[int, float] = {}
        self._recorder: Recorder | None = None
        self._processes: dict[str, int] = {}
        self._spent: list[tuple[int, float, dict[str, float]]] = []
        self._stack = ExitStack()
        renderer = Drawn if variant.drawn else Noted
        with patch("zeromethod.loop.drawing.PatternRenderer", renderer):
            loop = Loop(rig, self._camera, self._display, clock, optics=prepared.optics)
        # the first picture is drawn in the first turn
        self._stack.enter_context(patch("zeromethod.loop.drawing.PatternRenderer", renderer))
        self.loop = self._stack.enter_context(loop)
        if variant.reads:
            surfaces = Surfaces(rig, prepared.optics, loop.grid)
            self._stack.enter_context(surfaces.in_own_process(first_warp(loop.rest)))
            publisher = self._stack.enter_context(_published(loop, clock, variant.subscriber))
            if (process_id := surfaces.process_id) is not None:
                self._processes["process: surfaces"] = process_id
            contacts = ContactFinder(rig, prepared.optics, loop.grid)
            self._reading = StepReader(
                _reading(surfaces, contacts, ForceReader(rig)),
                publisher,
                live=True,
                begin=_beginning(surfaces, prepared),
            )
            self._stack.callback(self._reading.close)
        if variant.records:
            folder = self._stack.enter_context(TemporaryDirectory(prefix="zeromethod-live-cost-"))
            self._recorder = self._stack.enter_context(Recorder(Path(folder) / "all.h5", rig, loop.rest))
            self._processes["process: recording"] = self._recorder.writer_id
        self._steps = loop.run(frames=frames) if variant.steady else _steps(loop, frames)

    def __enter__(self) -> Running:
        limit_threads(os.cpu_count() or 1 if self._pools else 1)
        return self

    def __exit__(self, *exception: object) -> None:
        limit_threads()
        self._stack.close()

    def turn(self) -> None:
        """One turn of the loop, and its figures."""
        camera, display = self._camera, self._display
        if len(self._turns) in {LEFT_OUT, self._frames - 1}:
            devices_ms = 1e3 * (camera.cpu_s + display.cpu_s)
            self._spent.append((len(self._turns), devices_ms, spent_ms(self._processes)))
        self._clock.go_on()
        cpu_s, others_s, busy_s = time.thread_time(), camera.cpu_s + display.cpu_s, display.busy_s
        step = next(self._steps)
        if self._reading is not None:
            self._reading.post(step)
            self._collect()
        if self._recorder is not None:
            self._recorder.add_step(step)
        done_s, done_cpu_s = time.perf_counter(), time.thread_time()
        self._clock.stand_still()
        if step.frame_number is None:
            raise RuntimeError(f"a turn without a frame: {step.reason}")
        given_s = camera.given_s[step.frame_number]
        # what the devices do in the loop's thread is not the loop's
        if not self._live:
            busy_s -= display.busy_s
            cpu_s += camera.cpu_s + display.cpu_s - others_s
        else:
            busy_s = 0.0
        turn = Timed(
            step.number,
            float("nan"),
            step.loop_ms,
            1e3 * (done_s - given_s + busy_s),
            1e3 * (done_cpu_s - cpu_s),
            step.state in NULLED,
            sorted(event.value for event in step.events),
            self._reading is not None and step.measured is not None,
            dropped=step.dropped,
        )
        self._turns.append((turn, given_s, fingerprint(step.commanded.q)))

    def _collect(self) -> None:
        """Note what has been read since, and record it where all is."""
        assert self._reading is not None
        for read in self._reading.collect():
            self._read_ms[read.number] = read.read_ms
            if self._recorder is not None:
                self._recorder.add_reading(read)

    @property
    def spent_ms(self) -> dict[str, float]:
        """Processor time of a turn, ms, by thread and process; "emulated devices" is in others, too."""
        (first, devices_ms, begun), (last, devices_end_ms, ended) = self._spent
        spent = {name: ended[name] - begun.get(name, 0.0) for name in ended}
        spent["emulated devices"] = devices_end_ms - devices_ms
        return {name: ms / (last - first) for name, ms in spent.items()}

    def turns(self) -> list[Timed]:
        """All turns but the first ones, each with the answer to its frame, and its reading."""
        if self._reading is not None:
            self._reading.close()
            self._collect()
        found, last = [], float("nan")
        for turn, given_s, command in self._turns:
            # a command that did not change was answered before
            began_s = self._display.began_s.get(command, np.nan) if command != last else np.nan
            read_ms = self._read_ms.get(turn.number, np.nan)
            found.append(replace(turn, answer_ms=1e3 * (began_s - given_s), read_ms=read_ms))
            last = command
        return found[LEFT_OUT:]


def _beginning(surfaces: Surfaces, prepared: Prepared) -> Callable[[Step], None]:
    def begin(step: Step) -> None:
        assert step.measured is not None
        assert step.shown is not None
        assert step.frame_number is not None
        warp = prepared.with_residual(step.measured, step.shown, step.frame_number)
        surfaces.begin(step.number, warp)

    return begin


def _reading(surfaces: Surfaces, contacts: ContactFinder, forces: ForceReader) -> Callable[[Step], Step]:
    """Reads surface, contacts and forces, as a session does."""

    def read(step: Step) -> Step:
        image, residual = step.image, step.residual
        assert image is not None
        assert residual is not None
        surface, deepest, read_ms = surfaces.finish(step.number)
        touched = contacts.follow(image, residual, surface, nulled=step.state in READ)
        touched, _ = forces.read(surface, touched)
        surface, deepest, touched = contacts.carry(surface, deepest, touched, forces.fit)
        touched = contacts.with_images(image, residual, surface, touched)
        return replace(step, surface=surface, peak=deepest, read_ms=read_ms, contacts=touched)

    return read


def _steps(loop: Loop, frames: int) -> Iterator[Step]:
    for _ in range(frames):
        yield loop.step()


def run_together(
    variants: Sequence[Variant], prepared: Prepared, frames: int, spent: list[dict[str, float]] | None = None
) -> list[list[Timed]]:
    """Run variants over so many frames, a frame of the first, one of the second, and so on.

    spent: the `Running.spent_ms` of a single variant is added to it.
    """
    with ExitStack() as stack:
        running = [stack.enter_context(Running(variant, prepared, frames)) for variant in variants]
        for _ in range(frames):
            for each in running:
                each.turn()
        if spent is not None:
            spent.append(running[0].spent_ms)
        return [each.turns() for each in running]
