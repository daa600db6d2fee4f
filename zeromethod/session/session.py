"""A session: the loop over opened devices, every frame read to depth, figures kept, recorded and published.

The same session serves the simulated bench and a real one. Where the camera can report the true mirror
(`camera.truth(time_ns)`, simulated benches) the readings are compared with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zeromethod.control.stability_margin import margin_words, stability_margin
from zeromethod.devices.abilities import dropped_refreshes_of, script_of, truth_of
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED
from zeromethod.loop.step import Step
from zeromethod.optics import Optics, check_geometry
from zeromethod.publishing.publisher import Publisher
from zeromethod.recording.status import Condition
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.reading import StepReader, timed, warm_up_warp
from zeromethod.session.result import RunResult
from zeromethod.session.summary import Figures, summarise
from zeromethod.session.surfaces import Surfaces
from zeromethod.surface import Surface, SurfaceReader
from zeromethod.surface.comparison import AT_REST, TruthSource, compare, usable_nodes
from zeromethod.warp.grid import NodeGrid

if TYPE_CHECKING:  # what writes files loads slowly, and few runs are recorded
    from zeromethod.recording.recorder import Recorder

DEFAULT_SECONDS = 5.0
"""How long a run in simulated time lasts when neither the caller nor a scenario says so."""

COMPARED_PHASES = frozenset({"hold", "slide"})
"""Parts of a simulated scenario in which every reading is compared with the truth."""


class Session:
    """A running measurement: iterate `run` for its steps, as often as you like, then close it.

    Parameters
    ----------
    rig
        A `Rig`, a rig file, or the name of a packaged rig.
    devices
        Opened devices, which stay the caller's; without, the session opens those of the rig and closes them.
    publisher
        Gets every step in simulated time, every step that was read in real time.
    record
        Makes what records the loop's run.

    Raises
    ------
    InputError
        For a rig that cannot be used, devices that cannot be opened, or a recording that cannot be written.

    Examples
    --------
    >>> import zeromethod as zm
    >>> with zm.Session("simulated") as session:
    ...     for step in session.run(frames=4):
    ...         if step.surface is not None:
    ...             print(f"{step.time_s:.2f} s: {step.peak.depth_mm:.4f} mm")  # doctest: +SKIP
    """

    def __init__(
        self,
        rig: Rig | str | Path = "simulated",
        *,
        devices: Devices | None = None,
        publisher: Publisher | None = None,
        record: Callable[[Loop], Recorder] | None = None,
    ) -> None:
        self.rig = rig if isinstance(rig, Rig) else load_rig(rig)
        check_geometry(self.rig)
        with ExitStack() as stack:
            self._devices = devices or stack.enter_context(open_devices(self.rig))
            self._optics = Optics(self.rig)
            self.loop = Loop(
                self.rig,
                self._devices.camera,
                self._devices.display,
                self._devices.clock,
                reopen_camera=self._devices.reopen_camera,
                optics=self._optics,
            )
            stack.callback(self.loop.close)
            self._recorder = None if record is None else record(self.loop)
            stack.callback(self._end_recording)
            self._grid: NodeGrid = self.loop.grid
            self._surfaces = Surfaces(self.rig, self._optics, self._grid)
            self._publisher = publisher
            self._truth: TruthSource | None = truth_of(self._devices.camera)
            self._scenario = script_of(self._devices.camera)
            self._worst_px = 0.0
            self._deepest_mm = 0.0
            self._recording = Condition.ALL_KEPT
            usable = usable_nodes(self._optics, self._grid, AT_REST)[self._grid.inner]
            share = float(np.mean(usable))
            self.result = RunResult(self.rig, self.loop.gl_renderer, share, self.loop.rest, self._truth)
            self._closing = stack.pop_all()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Session({self.rig.name!r}, {self.loop.status.state}, {self.result.frames} frames)"

    def close(self) -> None:
        """End the loop's threads and the recording, and close the devices that the session opened."""
        self._closing.close()

    @property
    def figures(self) -> Figures:
        """All figures of the session so far, as `zeromethod run --summary` writes them."""
        return summarise(self.result)

    def length(self, frames: int | None = None, seconds: float | None = None) -> tuple[float | None, str]:
        """How long `run` goes on (None: until it is stopped), and the unit: "frames" or "seconds"."""
        if frames is not None:
            return float(frames), "frames"
        if seconds is None and self._scenario is not None:
            seconds = self._scenario.duration_s
        if seconds is None and not self.loop.live:
            seconds = DEFAULT_SECONDS
        return seconds, "seconds"

    def run(self, frames: int | None = None, seconds: float | None = None) -> Iterator[Step]:
        """Run the loop for `frames` or `seconds`; for the time of `length` when neither is given.

        Yields
        ------
        Step
            Every step of the loop. `step.surface` and `step.peak` are the newest reading that has become
            ready since the step before, None for none: in simulated time that of the step's own frame, in
            real time that of a frame shortly before, whose mid-exposure is `step.surface.time_ns`.

        Notes
        -----
        Ctrl-C ends the run with `result.interrupted` set and everything so far kept. When the loop is not
        over (`loop.over`: a device was lost for good) it may be run again, and goes on from the warp it had.
        """
        if frames is None:
            seconds, _ = self.length(frames, seconds)
        with ExitStack() as stack:
            stack.callback(self._note_end)
            if self.loop.live:
                stack.enter_context(self._surfaces.in_own_process(warm_up_warp(self.loop.rest)))
            reading = StepReader(self._read, self._publisher, self.loop.live)
            stack.callback(self._collect, reading)
            stack.callback(reading.close)
            stack.callback(self._post_end, reading)
            steps = self.loop.run(frames=frames, seconds=seconds)
            # ended here and now, not when the interpreter comes to forget it
            stack.callback(steps.close)
            try:
                for each in steps:
                    step = replace(each, phase=self._phase(each.time_ns))
                    reading.post(step)
                    if self._recorder is not None:
                        self._recorder.add_step(step)
                    step = replace(step, notes=step.notes + self._notes())
                    self.result.add(step.figures)
                    yield _with_reading(step, self._collect(reading))
            except KeyboardInterrupt:
                self.result.interrupted = True

    def interrupt(self) -> None:
        """End the run as Ctrl-C does, with all that was measured; from a signal handler, or any thread."""
        self.result.interrupted = True
        self.loop.stop()

    def _note_end(self) -> None:
        self.result.dropped_refreshes = dropped_refreshes_of(self._devices.display)

    def _post_end(self, reading: StepReader) -> None:
        """Whoever follows the run learns how it ended."""
        if self.loop.ended is not None:
            reading.post(self.loop.ended)
            if self._recorder is not None:
                self._recorder.add_step(self.loop.ended)

    def _end_recording(self) -> None:
        """Write what waits still; what was lost stands in the result."""
        if self._recorder is not None:
            self._recorder.close()
            self.result.recording = str(self._recorder.status)

    def _read(self, step: Step) -> Step:
        """Read one step; in real time in a thread of its own."""
        measured = step.measured
        assert measured is not None
        surface, deepest, read_ms = timed(lambda: self._surfaces.read(measured))
        found: dict[str, Any] = {}
        if self._truth is not None:
            if step.phase == "untouched":
                filtered = self._filtered_reader.read(step.filtered)
                found["untouched_rms_nm"] = (_rms_nm(surface), _rms_nm(filtered))
            elif self._scenario is None or step.phase in COMPARED_PHASES:
                found["truth"] = compare(surface, self._truth(step.time_ns), self._optics, self._grid)
        return replace(step, surface=surface, peak=deepest, read_ms=read_ms, **found)

    @cached_property
    def _filtered_reader(self) -> SurfaceReader:
        """Apart from the one that reads, whose weights remember the warps before."""
        return SurfaceReader(self.rig, self._optics, self._grid)

    def _collect(self, reading: StepReader) -> Step | None:
        """Enter what has been read into the records of its frames; the newest of it."""
        newest = None
        for newest in reading.collect():
            self.result.enter(newest.figures)
            if self._recorder is not None:
                self._recorder.add_reading(newest)
            self._keep(newest)
        return newest

    def _phase(self, time_ns: int) -> str:
        return "" if self._scenario is None else self._scenario.phase_at(time_ns) or ""

    @cached_property
    def _has_hold(self) -> bool:
        return self._scenario is not None and any(phase.name == "hold" for phase in self._scenario.phases)

    def _keep(self, step: Step) -> None:
        """Keep the frames that the figure shows: before the touch, at its worst, nulled."""
        result = self.result
        assert step.image is not None
        kept = replace(step, image=step.image.copy())
        settled = step.state in NULLED
        if settled and (step.phase == "untouched" if self._scenario is not None else result.before is None):
            result.before = kept
        # After the hold comes the lift, whose residual may be larger still; the figure shows the press.
        over = self._has_hold and result.nulled is not None
        if result.before is not None and not over and step.residual_rms_px > self._worst_px:
            self._worst_px = step.residual_rms_px
            result.pressed = kept
        pressed = step.phase == "hold" if self._has_hold else abs(step.depth_peak_mm) >= self._deepest_mm
        if settled and pressed:
            self._deepest_mm = abs(step.depth_peak_mm)
            result.nulled = kept

    def _notes(self) -> tuple[str, ...]:
        """Notes of everything but the loop itself."""
        return self._delay_note() + self._recording_note() + self._surfaces.notes()

    def _recording_note(self) -> tuple[str, ...]:
        """What the operator should know of the recording, when that changes."""
        if self._recorder is None or self._recorder.status.condition is self._recording:
            return ()
        self._recording = self._recorder.status.condition
        return (self._recorder.status.note,)

    def _delay_note(self) -> tuple[str, ...]:
        """What the coded strips say of the delay, and what that leaves of stability; shown once."""
        delay, horizon_s = self.loop.delay, self.loop.horizon_s
        if delay is None or not delay.estimator.settled:
            return ()
        control, estimator = self.rig.control, delay.estimator
        self.result.delay_ms = 1e-6 * estimator.value_ns
        if self.result.margin is not None or not np.isfinite(horizon_s):
            return ()
        self.result.margin = stability_margin(control, horizon_s * self.rig.camera.rate_hz)
        return (
            f"delay {1e-6 * estimator.value_ns:.1f} ms, "
            f"± {1e-6 * estimator.scatter_ns:.1f} ms from frame to frame; "
            f"{self.result.margin.delay_frames:.1f} frames round the loop; "
            f"{margin_words(self.result.margin, control)}",
        )


def _with_reading(step: Step, read: Step | None) -> Step:
    """The step with the newest reading."""
    if read is None:
        return step
    if read.number == step.number:
        return replace(read, notes=step.notes)
    return replace(step, surface=read.surface, peak=read.peak, read_ms=read.read_ms)


def _rms_nm(surface: Surface) -> float:
    depth_mm = surface.depth_mm[surface.valid]
    return 1e6 * float(np.sqrt(np.mean(depth_mm**2))) if depth_mm.size else float("nan")


def run(
    rig: Rig | str | Path,
    *,
    frames: int | None = None,
    seconds: float | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> RunResult:
    """Open the rig's devices, close the loop for a while, read every frame, close the devices.

    Ctrl-C ends the run early with `interrupted` set and everything so far kept. Raises InputError for
    devices that cannot be opened.
    """
    with Session(rig) as session:
        for step in session.run(frames, seconds):
            if on_step is not None:
                on_step(step)
        return session.result
