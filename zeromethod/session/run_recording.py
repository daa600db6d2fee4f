"""The recording of a session: begun with it or while it runs, ended with it or before."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING

from zeromethod.errors import InputError
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.recording.status import LOST, Condition, RecorderStatus
from zeromethod.rig.model import Rig
from zeromethod.session.outputs import Record, recorder_of
from zeromethod.worker import in_thread

if TYPE_CHECKING:
    from zeromethod.recording.recorder import Recorder
    from zeromethod.session.result import RunResult


class RunRecording:
    """Hands steps and readings of a session to its recorder, if it has one.

    Recorders are made and closed in threads of their own while the loop runs: neither waits for a disk.
    """

    def __init__(self, record: Record, rig: Rig, loop: Loop, fine: bool = False) -> None:
        """Begin with the recorder that was asked for; fine: of fine surfaces, too. Raises InputError."""
        self._rig, self._loop, self._fine = rig, loop, fine
        self._recorder = recorder_of(record, rig, loop, fine)
        self._opening: Future[Recorder | None] | None = None
        self._closing: list[Future[None]] = []
        self._last_step: threading.Event | None = None
        self._condition = Condition.ALL_KEPT
        self._first_step = 0
        self.ended: list[RecorderStatus] = []
        """How recordings ended, of those that have."""

    @property
    def running(self) -> bool:
        """Whether steps are being recorded."""
        return self._running is not None

    @property
    def path(self) -> Path | None:
        """File that is being recorded; None for none."""
        return None if self._running is None else self._running.path

    @property
    def _running(self) -> Recorder | None:
        """The recorder, unless it is to stop."""
        return self._recorder if self._last_step is None else None

    @property
    def words(self) -> str:
        """What is not kept of the recording, or went wrong with the last one; "" while all is kept."""
        return self.trouble[0] if self._recorder is None else str(self._recorder.status)

    def start(self, record: Record) -> Future[Recorder | None]:
        """Record from a later step on; done when it does, from the step after. Raises InputError.

        The future raises InputError where the file cannot be made. `poll` takes the recorder over.
        """
        if self.running or self._opening is not None:
            raise InputError(f"record: {self.path or 'another file'}: is being recorded already")
        self._opening = in_thread(
            "open recording", lambda: recorder_of(record, self._rig, self._loop, self._fine)
        )
        return self._opening

    def poll(self) -> None:
        """Take over a recorder that has been made; to be called in the loop's thread, in every step."""
        if self._opening is None or not self._opening.done() or self._last_step is not None:
            return
        opening, self._opening = self._opening, None
        if opening.exception() is None:
            self._recorder, self._first_step = opening.result(), 0
            self._condition = Condition.ALL_KEPT

    def stop(self) -> Future[None]:
        """Record one step more, with the calls made until now; done once everything is in the file.

        Raises InputError where nothing is recorded.
        """
        recorder = self._running
        if recorder is None:
            raise InputError("stop_recording: nothing is being recorded")
        self._last_step = last_step = threading.Event()

        def close() -> None:
            last_step.wait()
            self._close(recorder)

        self._closing.append(in_thread("close recording", close))
        return self._closing[-1]

    def add_step(self, step: Step) -> None:
        """Record a step."""
        if self._recorder is not None:
            self._first_step = self._first_step or step.number
            self._recorder.add_step(step)
        self._let_go()

    def add_reading(self, step: Step) -> None:
        """Record what was read from a step, if the step was recorded."""
        if self._recorder is not None and 0 < self._first_step <= step.number:
            self._recorder.add_reading(step)

    def add_fine(self, step: Step) -> None:
        """Record a step's fine surface, if the step was recorded."""
        if self._recorder is not None and 0 < self._first_step <= step.number:
            self._recorder.add_fine(step)

    def notes(self) -> tuple[str, ...]:
        """What the operator should know of the recording, when that changes."""
        if self._recorder is None or self._recorder.status.condition is self._condition:
            return ()
        self._condition = self._recorder.status.condition
        return (self._recorder.status.note,)

    def close(self) -> None:
        """Write what waits still, of all recordings."""
        self._let_go()
        if self._opening is not None:
            if self._opening.exception() is None:
                self.poll()
            self._opening = None
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            self._close(recorder)
        for closing in self._closing:
            closing.result()
        self._closing.clear()

    def end(self, result: RunResult) -> None:
        """Close; what was lost stands in the result."""
        self.close()
        result.recording_trouble, result.recording_lost = self.trouble
        result.recording_astray = any(status.condition is Condition.ASTRAY for status in self.ended)

    @property
    def trouble(self) -> tuple[str, bool]:
        """What went wrong, "" for nothing, and whether that was the end of a recording before its time."""
        said = [str(status) for status in self.ended if str(status)]
        return "; ".join(said), any(status.condition in LOST for status in self.ended)

    def _let_go(self) -> None:
        """Leave a recorder that is to stop to the thread that closes it."""
        if self._last_step is not None:
            self._last_step.set()
            self._recorder, self._last_step = None, None

    def _close(self, recorder: Recorder) -> None:
        recorder.close()
        self.ended.append(recorder.status)
