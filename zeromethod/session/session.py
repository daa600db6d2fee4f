"""A session: the loop over opened devices, every frame read to depth, figures kept, recorded and published.

The same session serves the simulated bench and a real one. Where the camera can report the true mirror
(`camera.truth(time_ns)`, simulated benches) the readings are compared with it.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.contact import Contact, ForceReader, Lamp, border_blur_px, finder_of
from zeromethod.devices.abilities import dropped_refreshes_of, script_of, truth_of
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.call import Call
from zeromethod.loop.events import Event
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED, State, sees_target
from zeromethod.loop.step import Step
from zeromethod.optics import Optics, check_geometry
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.rubbing import RubbingReader
from zeromethod.session.delay_note import DelayNote
from zeromethod.session.dirt import DirtCorrection
from zeromethod.session.fine import FineReadings, with_moving_target
from zeromethod.session.interaction import interaction
from zeromethod.session.outputs import Record, StepPublisher, publishing
from zeromethod.session.outside_note import OutsideNote
from zeromethod.session.reading import Read, StepReader, first_warp, rms_nm, with_reading
from zeromethod.session.result import RunResult
from zeromethod.session.run_recording import RunRecording
from zeromethod.session.summary import Figures, summarise
from zeromethod.session.surfaces import Surfaces
from zeromethod.session.trust import is_readable, with_stated_geometry
from zeromethod.session.watching import watching
from zeromethod.session.zero_doubt import ZeroDoubt
from zeromethod.surface import Surface, SurfaceReader
from zeromethod.surface.comparison import AT_REST, TruthSource, compare, usable_nodes
from zeromethod.warp.grid import NodeGrid

DEFAULT_SECONDS = 5.0
"""How long a run in simulated time lasts when neither the caller nor a scenario says so."""

COMPARED_PHASES = frozenset({"hold", "slide"})
"""Parts of a simulated scenario in which every reading is compared with the truth."""


class Session:
    """A running measurement: iterate `run` for its steps, as often as you like, then close it.

    Parameters
    ----------
    rig : Rig, str or Path
        A rig, a rig file, or the name of a packaged rig.
    devices : Devices, optional
        Opened devices, which stay the caller's; without, the session opens those of the rig and closes them.
    publisher : str or Publisher, optional
        Address at which to publish, tcp://127.0.0.1:5556, or what takes the steps: every one in simulated
        time, those that were read in real time.
    record : str, Path or callable, optional
        File in which to record everything (.h5), or what makes the recorder of a loop.
    fine : bool
        Read slope and depth on every camera pixel, too, from the last frames, about twice a second. The
        target then moves (`target.step`).

    Raises
    ------
    InputError
        For a rig that cannot be used, devices that cannot be opened, an address or a recording that cannot
        be made.

    Examples
    --------
    >>> import zeromethod as zm
    >>> with zm.Session("simulated") as session:
    ...     for step in session.run(frames=4):
    ...         print(step.time_s, step.state, step.peak)  # doctest: +SKIP
    """

    def __init__(
        self,
        rig: Rig | str | Path = "simulated",
        *,
        devices: Devices | None = None,
        publisher: StepPublisher | str | None = None,
        record: Record = None,
        fine: bool = False,
    ) -> None:
        self.rig = rig if isinstance(rig, Rig) else load_rig(rig)
        if fine:
            self.rig = with_moving_target(self.rig)
        check_geometry(self.rig)
        with ExitStack() as stack:
            opened = self._devices = devices or stack.enter_context(open_devices(self.rig))
            self.rig, doubt = with_stated_geometry(self.rig, self._devices.camera)
            self._optics = Optics(self.rig)
            parts, reopen = (opened.camera, opened.display, opened.clock), opened.reopen_camera
            self.loop = Loop(self.rig, *parts, reopen_camera=reopen, optics=self._optics)
            self.loop.doubt = doubt
            stack.callback(self.loop.close)
            self._grid: NodeGrid = self.loop.grid
            self._watching = stack.enter_context(watching(self.rig, opened.clock, self.loop))
            self._truth: TruthSource | None = truth_of(self._devices.camera)
            share = float(np.mean(usable_nodes(self._optics, self._grid, AT_REST)[self._grid.inner]))
            self.result = RunResult(self.rig, self.loop.gl_renderer, share, self.loop.rest, self._truth)
            self.recording = RunRecording(record, self.rig, self.loop, fine)
            stack.callback(self.recording.end, self.result)
            self._surfaces = Surfaces(self.rig, self._optics, self._grid)
            self._zero_doubt = ZeroDoubt(self.rig, self.loop.rest)
            reads = self.rig, self._optics, self._grid, self._truth, self._zero_doubt
            self._fine = FineReadings(*reads) if fine else None
            self._contacts = finder_of(self.rig, self._optics, self._grid)
            self._forces = ForceReader(self.rig)
            self._rubbing = RubbingReader(border_blur_px(self.rig)) if self.rig.control.rubbing else None
            self._touched: tuple[Contact, ...] = ()
            self._dirt = DirtCorrection(self.loop.q_rest, under_cloth=self.rig.under_cloth)
            self._lamp = Lamp(self._grid) if self.rig.control.lamp and not self.rig.control.passive else None
            self.interaction = stack.enter_context(interaction(self.rig, opened, self._contacts))
            self._publisher = stack.enter_context(publishing(publisher, self._devices.clock))
            self._scenario = script_of(self._devices.camera)
            self._phases = frozenset(one.name for one in (self._scenario.phases if self._scenario else ()))
            self._calls: list[Call] = []
            self._rubber_note = self.rig.rubber.not_known
            self._delay_note = DelayNote(self.rig, self.loop, self.result)
            self._outside_note = OutsideNote(self.rig.rubber)
            self._steps: Generator[Step] | None = None
            self._reads_apart = self._closed = False
            self._closing = stack.pop_all()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exception: Any) -> None:
        self._end_run()
        self._closed = True
        self._closing.__exit__(*exception)

    def __repr__(self) -> str:
        state = "closed" if self._closed else self.loop.status.state
        return f"Session({self.rig.name!r}, {state}, {self.result.frames} frames)"

    def close(self) -> None:
        """End run, threads and recording, and close the devices that the session opened; safe to repeat."""
        self.__exit__(None, None, None)

    @property
    def figures(self) -> Figures:
        """All figures of the session so far, as `zeromethod run --summary` writes them."""
        return summarise(self.result)

    def length(self, frames: int | None = None, seconds: float | None = None) -> tuple[float | None, str]:
        """How long `run` goes on (None: until it is stopped), and the unit: "frames" or "seconds".

        Parameters
        ----------
        frames, seconds : optional
            As `run` takes them.

        Returns
        -------
        float or None, str
            The length, and its unit.
        """
        if frames is not None:
            return float(frames), "frames"
        if seconds is None and self._scenario is not None:
            seconds = self._scenario.duration_s
        if seconds is None and not self.loop.live:
            seconds = DEFAULT_SECONDS
        return seconds, "seconds"

    def run(self, frames: int | None = None, seconds: float | None = None) -> Generator[Step]:
        """Run the loop for `frames` or `seconds`; for the time of `length` when neither is given.

        It may be called again, and goes on from the warp it had; a run that has not ended is ended first.

        Parameters
        ----------
        frames, seconds : int, float, optional
            Number of camera frames; time of the run's clock.

        Yields
        ------
        Step
            Every step of the loop. `step.surface` and `step.peak` are the newest reading that has become
            ready since the step before, None for none: in simulated time that of the step's own frame, in
            real time that of a frame shortly before, whose mid-exposure is `step.surface.time_ns`. So is
            `step.fine`, the newest fine surface.

        Raises
        ------
        InputError
            When the session is closed.
        MeasurementError
            When a device was lost for good before.

        Notes
        -----
        Ctrl-C ends the run with `result.interrupted` set and everything so far kept. Numbers and times of
        steps go on from one run to the next.
        """
        if self._closed:
            raise InputError("session: it is closed: open a new one")
        self._end_run()
        if self.loop.over:
            raise MeasurementError(f"session: it cannot go on: {self.loop.status.reason}: open a new one")
        if self.loop.status.state is State.STOPPED:  # an interrupt before the first run ends that run
            self.result.interrupted = False
        self._steps = self._run(frames, seconds)
        return self._steps

    def _end_run(self) -> None:
        """End a run that its caller has left half-way."""
        if self._steps is not None:
            self._steps.close()

    def _run(self, frames: int | None, seconds: float | None) -> Generator[Step]:
        if frames is None:
            seconds, _ = self.length(frames, seconds)
        if self.loop.live and not self._reads_apart:
            self._closing.enter_context(self._surfaces.in_own_process(first_warp(self.loop.rest)))
            if self._fine is not None:
                self._closing.enter_context(self._fine.in_own_process())
            self._reads_apart = True
        with ExitStack() as stack:
            now_ns = self._devices.clock.now_ns if self.loop.live else None
            steps_go = self._read, self._publisher, self.loop.live, now_ns, self._begin
            reading = StepReader(*steps_go, self.interaction.follow)
            stack.callback(self._collect, reading)
            stack.callback(reading.close)
            stack.callback(self._post_end, reading)
            steps = self.loop.run(frames=frames, seconds=seconds)
            stack.callback(steps.close)  # here and now, not when the interpreter comes to forget it
            try:
                for each in map(self._watching, steps):
                    phase = self._scenario.phase_at(each.time_ns) if self._scenario is not None else None
                    step = replace(each, phase=phase or "", readable=is_readable(each))
                    reading.post(step if step.readable else replace(step, measured=None))
                    self.recording.poll()
                    step = self.interaction.drive(replace(step, calls=self._taken_calls()))
                    self.recording.add_step(step)
                    step = replace(step, notes=step.notes + self._notes())
                    self.result.add(step.figures)
                    yield self._with_fine(step, with_reading(step, self._collect(reading)))
            except KeyboardInterrupt:
                self.result.interrupted = True

    def _with_fine(self, step: Step, read: Step) -> Step:
        """The step as read, with the newest fine surface that has become ready."""
        if self._fine is None:
            return read
        self._fine.add(step)
        for of, figures in self._fine.collect():
            self.result.keep_fine(of, figures, self._phases)
            self.recording.add_fine(of)
            read = replace(read, fine=of.fine)
        return read

    def interrupt(self) -> None:
        """End the run as Ctrl-C does, with all that was measured; from a signal handler, or any thread."""
        self.result.interrupted = True
        self.loop.stop()

    def note_call(self, call: Call) -> None:
        """Keep a call of a method with the step that ends next; to be called in the loop's thread.

        Parameters
        ----------
        call : Call
            What was called, and what became of it.
        """
        self._calls.append(call)

    def _taken_calls(self) -> tuple[Call, ...]:
        calls, self._calls = tuple(self._calls), []
        return calls

    def _post_end(self, reading: StepReader) -> None:
        """Publish, record and keep the step that ended the run."""
        self.result.dropped_refreshes = dropped_refreshes_of(self._devices.display)
        if self.loop.ended is not None:
            reading.post(self.loop.ended)
            reading.close()  # what fingers did until the end is known then
            ended = self.interaction.drive(replace(self.loop.ended, calls=self._taken_calls()))
            self.recording.add_step(ended)
            self.result.end(ended.pointers)

    def _begin(self, step: Step) -> None:
        """Correct one step's warp for dirt, state what its zero leaves open, and begin to read it."""
        assert step.measured is not None
        measured = self._zero_doubt.stated(step.measured, step.zero)
        self._surfaces.begin(step.number, self._dirt.corrected(measured, step.state, step.zero))

    def _read(self, step: Step) -> Step:
        """Read one step; in real time in a thread of its own."""
        surface, deepest, read_ms = self._surfaces.finish(step.number)
        contacts = self._touching(step, surface)
        contacts, total = self._forces.read(surface, contacts, self._contacts.unnamed)
        surface, deepest, contacts = self._contacts.carry(surface, deepest, contacts, self._forces.fit)
        read = Read(surface=surface, peak=deepest, read_ms=read_ms)
        if step.image is not None and step.residual is not None and Event.BURST not in step.events:
            contacts = self._contacts.with_images(step.image, step.residual, surface, contacts)
            if self._rubbing is not None:
                status = self._rubbing.follow(contacts, step.time_ns, step.exposure_ns)
                read["contact_status"] = status
        if self._lamp is not None:
            self.loop.light(self._lamp.follow(contacts))
        read |= {"contacts": contacts, "touching": tuple(one.figures for one in contacts)}
        read |= {"total_force_n": total.force_n, "sigma_total_force_n": total.sigma_n}
        if self._truth is not None and step.phase == "untouched":
            # the filter's noise, once it has settled: making its reader takes as long as 20 frames
            if self.result.before is not None:
                filtered = self._filtered_reader.follow(step.filtered)
                read["untouched_rms_nm"] = (rms_nm(surface), rms_nm(filtered))
        elif self._truth is not None and (self._scenario is None or step.phase in COMPARED_PHASES):
            read["truth"] = compare(surface, self._truth(step.time_ns), self._optics, self._grid, deepest)
        return replace(step, **read)

    def _touching(self, step: Step, surface: Surface) -> tuple[Contact, ...]:
        """What touches in a step."""
        if step.image is None or step.residual is None or not self.rig.outlines_contacts:
            return ()
        if Event.BURST not in step.events:  # where coded pictures are shown the carrier is not seen
            nulled = sees_target(step.state, step.residual_rms_px)
            seen = step.image, step.residual, surface
            self._touched = self._contacts.follow(*seen, nulled=nulled, exposure_ns=step.exposure_ns)
        return self._touched

    @cached_property
    def _filtered_reader(self) -> SurfaceReader:
        """Reader of the controller's estimates; its own, as weights depend on the warps read before."""
        return SurfaceReader(self.rig, self._optics, self._grid)

    def _collect(self, reading: StepReader) -> Step | None:
        """Enter what has been read into the records of its frames; the newest of it."""
        newest = None
        for newest in reading.collect():
            self.result.enter(newest.figures)
            self._outside_note.look(newest.surface)
            curl = newest.surface.curl if newest.surface is not None else None
            if curl is not None and curl.moved and newest.state in NULLED:
                self.loop.bench.report(curl, newest.time_ns)
            self.recording.add_reading(newest)
            self.result.keep(newest, self._phases)
        return newest

    def _notes(self) -> tuple[str, ...]:
        """Notes of everything but the loop itself."""
        rubber, self._rubber_note = ((self._rubber_note,) if self._rubber_note else ()), ""
        fine = () if self._fine is None else self._fine.notes()
        found = rubber + self._outside_note.take() + self._delay_note.take()
        return found + self.recording.notes() + self._surfaces.notes() + fine
