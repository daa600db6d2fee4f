"""Closing the loop for a while: devices opened, every frame read to depth, figures kept.

The same procedure serves the simulated bench and a real one. Where the camera can tell the truth
(`camera.truth(time_ns)`, simulated benches only) the reading is held against it afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from zeromethod.control.stability_margin import margin_words, stability_margin
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.publishing.publisher import Publisher
from zeromethod.recording.status import Condition
from zeromethod.rig.model import Rig
from zeromethod.session.reading import Reading, ReadInThread, ReadInTurn, timed, warm_up_warp
from zeromethod.session.result import FrameRecord, RunResult, Snapshot
from zeromethod.session.surfaces import Surfaces
from zeromethod.session.truth import AT_REST, TruthSource, compare, usable_nodes
from zeromethod.surface import Surface, SurfaceReader
from zeromethod.warp.grid import NodeGrid

if TYPE_CHECKING:  # what writes files loads slowly, and few runs are recorded
    from zeromethod.recording.recorder import Recorder

DEFAULT_SECONDS = 5.0
"""How long a run in simulated time lasts when neither the caller nor a scenario says so."""

COMPARED_PHASES = frozenset({"hold", "slide"})
"""Parts of a simulated scenario in which every reading is held against the truth."""


class Run:
    """One run over opened devices; iterate it for the steps, then take `result`."""

    def __init__(
        self,
        rig: Rig,
        devices: Devices,
        publisher: Publisher | None = None,
        record: Callable[[Loop], Recorder] | None = None,
    ) -> None:
        """publisher: gets every turn in simulated time, every turn that was read in real time.

        record: makes what records the loop's run, and may raise InputError.
        """
        self._rig = rig
        self._devices = devices
        self._optics = Optics(rig)
        self.loop = Loop(
            rig,
            devices.camera,
            devices.display,
            devices.clock,
            reopen_camera=devices.reopen_camera,
            optics=self._optics,
        )
        self._grid: NodeGrid = self.loop.grid
        self._surfaces = Surfaces(rig, self._optics, self._grid)
        self._publisher = publisher
        self._recorder = None if record is None else self._opened(record)
        self._recording = Condition.ALL_KEPT
        self._truth: TruthSource | None = getattr(devices.camera, "truth", None)
        self._scenario = getattr(devices.camera, "scenario", None)
        phases = self._scenario.phases if self._scenario is not None else ()
        self._has_hold = any(phase.name == "hold" for phase in phases)
        self._start_ns: int | None = None
        self._newest_peak_mm = float("nan")
        self._worst_px = 0.0
        self._deepest_mm = 0.0
        usable = usable_nodes(self._optics, self._grid, AT_REST)[self._grid.inner]
        self.result = RunResult(rig, self.loop.gl_renderer, float(np.mean(usable)))

    @cached_property
    def _filtered_reader(self) -> SurfaceReader:
        """Apart from the one that reads, whose weights remember the warps before."""
        return SurfaceReader(self._rig, self._optics, self._grid)

    def length(self, frames: int | None = None, seconds: float | None = None) -> tuple[float | None, str]:
        """How long `steps` goes on (None: until it is stopped), and the unit: "frames" or "seconds"."""
        if frames is not None:
            return float(frames), "frames"
        if seconds is None and self._scenario is not None:
            seconds = self._scenario.duration_s
        if seconds is None and not self.loop.live:
            seconds = DEFAULT_SECONDS
        return seconds, "seconds"

    def steps(self, frames: int | None = None, seconds: float | None = None) -> Iterator[FrameRecord]:
        """Run for `frames` or `seconds`; for the time of `length` when neither is given."""
        if frames is None:
            seconds, _ = self.length(frames, seconds)
        with ExitStack() as stack:
            stack.callback(self.loop.close)
            stack.callback(self._finish)
            stack.callback(self._end_recording)
            if self.loop.live:
                stack.enter_context(self._surfaces.beside(warm_up_warp(self.loop.rest)))
            reading = (ReadInThread if self.loop.live else ReadInTurn)(self._read, self._publisher)
            stack.callback(self._take, reading)
            stack.callback(reading.close)
            stack.callback(self._post_end, reading)
            steps = self.loop.run(frames=frames, seconds=seconds)
            # ended here and now, not when the interpreter comes to forget it
            stack.callback(steps.close)
            try:
                for step in steps:
                    reading.post(step)
                    if self._recorder is not None:
                        self._recorder.add_step(step, self._phase(step.time_ns))
                    yield self._record(step, reading)
            except KeyboardInterrupt:
                self.result.interrupted = True

    def interrupt(self) -> None:
        """End the run as Ctrl-C does, with all that was measured; from a signal handler, or any thread."""
        self.result.interrupted = True
        self.loop.stop()

    def _post_end(self, reading: ReadInTurn | ReadInThread) -> None:
        """Whoever follows the run learns how it ended."""
        if self.loop.ended is not None:
            reading.post(self.loop.ended)

    def _opened(self, record: Callable[[Loop], Recorder]) -> Recorder:
        try:
            return record(self.loop)
        except BaseException:
            self.loop.close()
            raise

    def _end_recording(self) -> None:
        """Write what waits still; what was lost is told in the result."""
        if self._recorder is None:
            return
        if self.loop.ended is not None:
            self._recorder.add_step(self.loop.ended)
        self._recorder.close()
        self.result.recording = str(self._recorder.status)

    def _recording_note(self) -> tuple[str, ...]:
        """What the operator should know of the recording, when that changes."""
        if self._recorder is None or self._recorder.status.condition is self._recording:
            return ()
        self._recording = self._recorder.status.condition
        return (self._recorder.status.note,)

    def _finish(self) -> None:
        display = self._devices.display
        self.result.dropped_refreshes = getattr(display, "dropped_refreshes", None)

    def _read(self, step: Step) -> Reading:
        """Read one step; in real time in a thread of its own."""
        measured = step.measured
        assert measured is not None
        surface, deepest, read_ms = timed(lambda: self._surfaces.read(measured))
        truth, untouched = None, None
        if self._truth is not None:
            phase = self._phase(step.time_ns)
            if phase == "untouched":
                untouched = (_rms_nm(surface), _rms_nm(self._filtered_reader.read(step.filtered)))
            elif phase in COMPARED_PHASES:
                truth = compare(surface, self._truth(step.time_ns), self._optics, self._grid)
        return Reading(step, surface, deepest, read_ms, truth, untouched)

    def _record(self, step: Step, reading: ReadInTurn | ReadInThread) -> FrameRecord:
        if self._start_ns is None:
            self._start_ns = step.time_ns
        nan = float("nan")
        record = FrameRecord(
            number=step.number,
            time_s=(step.time_ns - self._start_ns) * 1e-9,
            phase=self._phase(step.time_ns),
            state=step.state,
            reason=step.reason,
            events=step.events,
            notes=step.notes + self._delay_note() + self._recording_note() + self._surfaces.notes(),
            dropped=step.dropped,
            residual_rms_px=step.residual_rms_px,
            valid_share=step.valid_share,
            depth_peak_mm=nan,
            depth_peak_sigma_mm=nan,
            newest_peak_mm=nan,
            loop_ms=step.loop_ms,
            draw_ms=step.draw_ms,
            read_ms=nan,
            truth=None,
            untouched_rms_nm=None,
        )
        result = self.result
        result.add(record)
        result.notes += record.notes
        self._take(reading)
        result.records[-1] = replace(result.records[-1], newest_peak_mm=self._newest_peak_mm)
        return result.records[-1]

    def _delay_note(self) -> tuple[str, ...]:
        """What the coded strips tell of the delay, and what that leaves of stability; told once."""
        delay, horizon_s = self.loop.delay, self.loop.horizon_s
        if delay is None or not delay.estimator.settled:
            return ()
        control, estimator = self._rig.control, delay.estimator
        self.result.delay_ms = 1e-6 * estimator.value_ns
        if self.result.margin is not None or not np.isfinite(horizon_s):
            return ()
        self.result.margin = stability_margin(control, horizon_s * self._rig.camera.rate_hz)
        return (
            f"delay {1e-6 * estimator.value_ns:.1f} ms, "
            f"+- {1e-6 * estimator.scatter_ns:.1f} ms from frame to frame; "
            f"{self.result.margin.delay_frames:.1f} frames round the loop; "
            f"{margin_words(self.result.margin, control)}",
        )

    def _take(self, reading: ReadInTurn | ReadInThread) -> None:
        """Enter what has been read into the records of its frames."""
        for one in reading.collect():
            # every step has a record, and they are numbered in turn
            index = one.step.number - self.result.records[0].number
            if index < 0:
                continue
            record = replace(
                self.result.records[index],
                depth_peak_mm=one.peak.depth_mm,
                depth_peak_sigma_mm=one.peak.sigma_mm,
                read_ms=one.read_ms,
                truth=one.truth,
                untouched_rms_nm=one.untouched_rms_nm,
            )
            self.result.records[index] = record
            self._newest_peak_mm = one.peak.depth_mm
            if self._recorder is not None:
                self._recorder.add_reading(one.step, one.surface, one.peak, one.read_ms)
            self._keep(one.step, record.phase, one.surface, one.peak.depth_mm)

    def _phase(self, time_ns: int) -> str:
        return "" if self._scenario is None else self._scenario.phase_at(time_ns) or ""

    def _keep(self, step: Step, phase: str, surface: Surface, depth_peak_mm: float) -> None:
        """Keep the frames that the figure shows: before the touch, at its worst, nulled."""
        result = self.result
        settled = step.state in NULLED
        if settled and (phase == "untouched" if self._scenario is not None else result.before is None):
            result.before = self._snapshot(step, surface)
        # After the hold comes the lift, whose residual may be larger still; the figure tells of the press.
        over = self._has_hold and result.nulled is not None
        if result.before is not None and not over and step.residual_rms_px > self._worst_px:
            self._worst_px = step.residual_rms_px
            result.pressed = self._snapshot(step, surface)
        held = phase == "hold" if self._has_hold else abs(depth_peak_mm) >= self._deepest_mm
        if settled and held:
            self._deepest_mm = abs(depth_peak_mm)
            result.nulled = self._snapshot(step, surface)

    def _snapshot(self, step: Step, surface: Surface) -> Snapshot:
        assert step.measured is not None
        assert step.residual is not None
        assert step.shown_q is not None
        assert step.image is not None
        assert self._start_ns is not None
        true_depth = None
        if self._truth is not None:
            true_depth = self._truth(step.time_ns).depth(
                np.nan_to_num(surface.x_mm), np.nan_to_num(surface.y_mm)
            )
        return Snapshot(
            time_s=(step.time_ns - self._start_ns) * 1e-9,
            image=step.image.copy(),
            residual_px=step.residual.d.copy(),
            applied_px=step.shown_q - self.loop.q_rest,
            measured_px=step.measured.q - self.loop.q_rest,
            surface=surface,
            true_depth_mm=true_depth,
        )


def _rms_nm(surface: Surface) -> float:
    depth_mm = surface.depth_mm[surface.valid]
    return 1e6 * float(np.sqrt(np.mean(depth_mm**2))) if depth_mm.size else float("nan")


def run(
    rig: Rig,
    *,
    frames: int | None = None,
    seconds: float | None = None,
    on_frame: Callable[[FrameRecord], None] | None = None,
) -> RunResult:
    """Open the rig's devices, close the loop for a while, read every frame, close the devices.

    Ctrl-C ends the run early with `interrupted` set and everything so far kept. Raises InputError for
    devices that cannot be opened.
    """
    with open_devices(rig) as devices:
        session = Run(rig, devices)
        for record in session.steps(frames, seconds):
            if on_frame is not None:
                on_frame(record)
        return session.result
