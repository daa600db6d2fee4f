"""The methods of a run, carried out on its session in the loop's thread."""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import Future
from datetime import datetime
from pathlib import Path
from typing import Any

from zeromethod.devices.abilities import exposure_setter_of
from zeromethod.devices.opening import Devices
from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.events import Event
from zeromethod.loop.step import Step
from zeromethod.loop.zero import NO_ZERO
from zeromethod.operating.controls import Answer, Controls, Perform
from zeromethod.operating.run_table import RUN
from zeromethod.operating.snapshot import save_snapshot
from zeromethod.session.outputs import Record
from zeromethod.session.session import Session
from zeromethod.worker import completed, in_thread

_FILE = re.compile(r"[\w][\w .+-]{0,80}\.h5")
_STAMP = "%Y-%m-%dT%H-%M-%S"


class RunControls:
    """Does what `zeromethod.operating.run_table` names.

    folder: where recordings and snapshots go. recorder: makes what `Session` takes as `record` of a path.
    `see` is to be called with every step.
    """

    def __init__(
        self,
        session: Session,
        devices: Devices,
        folder: Path,
        recorder: Callable[[Path], Record] = lambda path: path,
    ) -> None:
        self._session, self._devices, self._folder, self._recorder = session, devices, folder, recorder
        self._newest: Step | None = None
        self._read: Step | None = None
        self._zeros: list[Future[Answer]] = []
        perform: dict[str, Perform] = {
            "pause": self._pause,
            "resume": self._resume,
            "zero": self._zero,
            "gain": self._gain,
            "exposure": self._exposure,
            "target": self._target,
            "record": self._record,
            "stop_recording": self._stop_recording,
            "snapshot": self._snapshot,
            "mark": self._mark,
            "stop": session.loop.stop,
        }
        self.controls = Controls(RUN, perform, session.note_call)

    def see(self, step: Step) -> None:
        """Take in the newest step of the session, for snapshots and for what became of a zero."""
        if Event.ZERO_TAKEN in step.events or Event.ZERO_REFUSED in step.events:
            zeros, self._zeros = self._zeros, []
            for zero in zeros:
                if Event.ZERO_TAKEN in step.events:
                    zero.set_result({})
                else:
                    words = (note for note in step.notes if note.startswith(NO_ZERO))
                    zero.set_exception(MeasurementError(next(words, NO_ZERO)))
        if step.image is not None:
            self._newest = step
        if step.surface is not None:
            self._read = step

    def _pause(self) -> None:
        self._session.loop.pause(True)

    def _resume(self) -> None:
        self._session.loop.pause(False)

    def _zero(self) -> Future[Answer]:
        self._session.loop.rezero()
        self._zeros.append(Future())
        return self._zeros[-1]

    def _gain(self, value: float) -> None:
        self._session.loop.adjust.set_gain(value)

    def _target(self, contrast: float) -> None:
        self._session.loop.adjust.set_contrast(contrast)

    def _exposure(self, value: float) -> Future[Answer]:
        camera = self._devices.camera
        setter = exposure_setter_of(camera)
        if setter is None:
            name = type(camera).__name__
            raise InputError(f"exposure: {name} cannot change it during a run: end it and give --exposure")

        def answer() -> Answer:
            return {"exposure_ms": 1e3 * setter(1e-3 * value)}

        # in simulated time no thread may decide which frame is the first
        return in_thread("set exposure", answer) if self._session.loop.live else completed(answer)

    def _record(self, file: str | None, note: str) -> Future[Answer]:  # noqa: ARG002 - the call itself is kept
        name = file or f"{datetime.now():{_STAMP}}.h5"
        if not _FILE.fullmatch(name):
            raise InputError(f"record: file: {name!r}: a file name that ends in .h5, without a folder")
        path = self._folder / name
        opening = self._session.recording.start(self._recorder(path))
        return _then(opening, {"file": name})

    def _stop_recording(self) -> Future[Answer]:
        path = self._session.recording.path
        return _then(self._session.recording.stop(), {"file": "" if path is None else path.name})

    def _snapshot(self, note: str) -> Future[Answer]:
        newest, read = self._newest, self._read
        if newest is None:
            raise InputError("snapshot: no picture has come yet")
        stem = self._folder / f"snapshot-{datetime.now():{_STAMP}}"
        return in_thread("snapshot", lambda: {"files": save_snapshot(stem, newest, read, note)})

    def _mark(self, note: str) -> None:
        """Nothing but the call itself, which is kept."""


def _then(future: Future[Any], answer: Answer) -> Future[Answer]:
    """Future with this answer, once the other is done; its error where it has one."""
    after: Future[Answer] = Future()

    def done(before: Future[Any]) -> None:
        error = before.exception()
        if error is None:
            after.set_result(answer)
        else:
            after.set_exception(error)

    future.add_done_callback(done)
    return after
