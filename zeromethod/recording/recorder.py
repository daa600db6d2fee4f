"""Recording a run: its steps and readings are handed over here and written by a process of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Collection
from contextlib import AbstractContextManager
from pathlib import Path

from zeromethod.errors import InputError
from zeromethod.fine.lattice import pixel_box
from zeromethod.loop.step import Step
from zeromethod.recording.checksums import CHECKSUMS
from zeromethod.recording.file import about, create, discard, rest_arrays, rig_text
from zeromethod.recording.frames_in import frames_in
from zeromethod.recording.line import Line
from zeromethod.recording.message import Topic, Write
from zeromethod.recording.rows import Rows, Waiting, WaitingFine, WaitingReading, WaitingStep, without_arrays
from zeromethod.recording.schema import KEEP, parts
from zeromethod.recording.status import Condition, RecorderStatus
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

WAITING_BYTES = 512 << 20
"""Arrays that may wait for the disk: two seconds of everything at 1280x1024 and 60 frames per second."""

WAITING_STEPS = 20_000
"""Steps whose rows of the tables may wait: five minutes of them at 60 frames per second."""

LOOK_S = 0.05
"""How often the writer's reports are read while nothing new comes."""

CLOSING_S = 20.0
"""How long `close` waits for a disk that takes nothing more."""

PATIENCE_S = 5.0
"""How long a step waits for the disk in simulated time, where nothing waits for the step."""


class Recorder(AbstractContextManager["Recorder"]):
    """Records a run into one file; `add_step` and `add_reading` return at once, from any thread.

    (In simulated time, where nothing can come too late, they may wait for the disk instead.)

    Arrays are handed over as they are and must not be changed afterwards. A thread passes them on to a
    process of its own, which writes: the run goes on whatever the disk does. `status`, and the recording's
    table of drops, say what is not kept.
    """

    def __init__(
        self,
        path: str | Path,
        rig: Rig,
        rest: Rest,
        *,
        keep: Collection[str] = KEEP,
        every: int = 1,
        command_line: str = "",
        live: bool = False,
        gl_renderer: str = "",
        calibration: str = "",
        compress: bool = False,
        fine: bool = False,
        waiting_bytes: int = WAITING_BYTES,
    ) -> None:
        """Create the file and start the process that writes into it.

        keep: of `KEEP`. every: keep the arrays of every so many-th step. calibration: text of its document.
        compress: arrays, without loss; reading them then needs hdf5plugin. fine: there will be fine surfaces,
        which are kept all, at whatever `every`. waiting_bytes: arrays that may wait for the disk.
        Raises InputError, one line: the file is there already or cannot be created, other names in `keep`.
        """
        unknown = sorted(set(keep) - set(KEEP))
        if unknown:
            raise InputError(f"--keep: {unknown[0]!r}: of {', '.join(KEEP)}")
        if every < 1:
            raise InputError(f"--every: {every}: a whole number from 1 on")
        kept = [name for name in KEEP if name in keep and (fine or name != "fine")]
        camera = rig.camera
        rows, cols = pixel_box(rest.grid)
        fine_shape = (rows.stop - rows.start, cols.stop - cols.start) if fine else None
        image_shape = camera.rows, camera.columns
        self._parts = parts(image_shape, camera.bits, rest.grid.shape, kept, every, fine_shape)
        described = about(rig) | {
            "keep": kept,
            "every": every,
            "command_line": command_line,
            "live": live,
            "gl_renderer": gl_renderer,
            "calibration": calibration,
            "compressed": compress,
        }
        create(Path(path), self._parts, described, rest_arrays(rest), rig_text(rig)[1], compress)
        self._rows = Rows(self._parts)
        self._every = every
        self._live = live
        arrays = [
            part for name, part in self._parts.items() if part.kept and not name.endswith(f"/{CHECKSUMS}")
        ]
        self._reading_bytes = sum(part.bytes for part in arrays if part.kept == "surface")
        self._fine_bytes = sum(part.bytes for part in arrays if part.kept == "fine")
        self._step_bytes = sum(part.bytes for part in arrays) - self._reading_bytes - self._fine_bytes
        try:
            largest = max(2 * self._step_bytes + self._reading_bytes, self._fine_bytes)
            self._line = Line(Path(path), self._parts, largest)
        except BaseException:
            discard(Path(path))
            raise
        self._path = Path(path)
        self._most_waiting = waiting_bytes
        self._start_ns: int | None = None
        self._changed = threading.Condition()
        self._queue: deque[Waiting] = deque()
        self._bytes = 0
        self._frames = 0
        self._unkept = 0
        self._lost = 0
        self._full_ns: int | None = None
        self._full = ""
        self._failed = ""
        self._failing = ""
        self._astray = ""
        self._in_file: int | None = None
        self._noted = RecorderStatus()
        self._closing = False
        self._closed = False
        self._passed_s = time.monotonic()
        self._thread = threading.Thread(target=self._serve, name="record", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RecorderStatus:
        """Whether all is kept."""
        with self._changed:
            full_s = 1e-9 * ((self._full_ns or 0) - (self._start_ns or 0))
            if self._astray:
                reason = "; ".join(dict.fromkeys(one for one in (self._astray, self._failed) if one))
                return RecorderStatus(Condition.ASTRAY, self.unkept, reason)
            if self._failed:
                return RecorderStatus(Condition.STOPPED, self.unkept, self._failed)
            if self._full_ns is not None:
                return RecorderStatus(Condition.DISK_FULL, self.unkept, self._full, full_s)
            if self.unkept:
                was_full = Condition.DISK_WAS_FULL if self._full else Condition.DISK_TOO_SLOW
                return RecorderStatus(was_full, self.unkept)
            return RecorderStatus()

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def unkept(self) -> int:
        """Frames whose arrays are not in the file although `keep` asks for them."""
        with self._changed:
            return self._unkept if self._in_file is None else self._frames - self._in_file

    @property
    def waiting_bytes(self) -> int:
        """Size of the arrays that wait for the disk."""
        with self._changed:
            return self._bytes

    @property
    def writer_id(self) -> int:
        """Process number of the one that writes."""
        return self._line.process_id

    def add_step(self, step: Step) -> None:
        """Record a step of the loop, but for its surface."""
        frame = step.frame_number is not None
        with self._changed:
            if self._closing:
                return
            self._frames += frame
            if self._start_ns is None:
                self._start_ns = step.time_ns
            if self._failed or len(self._queue) >= WAITING_STEPS:
                self._unkept += frame
                self._lost += 1
                return
            size, late = self._room(self._step_bytes if self._wants(step.number) else 0)
            if late:
                self._unkept += frame
                step = without_arrays(step)
            self._put(WaitingStep(step, size, late, self._lost))
            self._lost = 0

    def add_reading(self, step: Step) -> None:
        """Record the surface and the peak of a step."""
        self._add(WaitingReading, step, self._reading_bytes if self._wants(step.number) else 0)

    def add_fine(self, step: Step) -> None:
        """Record a step's fine surface, `step.fine`, of a recorder made for such."""
        self._add(WaitingFine, step, self._fine_bytes)

    def _add(self, kind: type[WaitingReading | WaitingFine], step: Step, size: int) -> None:
        with self._changed:
            if self._closing or self._failed or len(self._queue) >= WAITING_STEPS:
                return
            size, _ = self._room(size)
            self._put(kind(step, size))

    def _room(self, size: int) -> tuple[int, bool]:
        """Bytes of arrays that may wait: `size`, or 0; and whether that is for want of room.

        In simulated time, where nothing is late, this waits for the disk as long as it takes anything.
        """
        if not size:
            return 0, False

        def fits() -> bool:
            return self._bytes + size <= self._most_waiting

        if not self._live:
            self._changed.wait_for(lambda: fits() or self._failed != "", PATIENCE_S)
        return (size, False) if fits() else (0, True)

    def _put(self, waiting: Waiting) -> None:
        self._bytes += waiting.bytes
        self._queue.append(waiting)
        self._changed.notify_all()

    def _wants(self, step: int) -> bool:
        return (step - 1) % self._every == 0

    def close(self) -> None:
        """Write everything that waits, and end the recording; may be called again.

        Gives up, and loses the rest, when the disk takes nothing for `CLOSING_S`.
        """
        with self._changed:
            if self._closing:
                return
            self._closing = True
            self._passed_s = time.monotonic()
            self._changed.notify_all()
        while self._thread.is_alive() and time.monotonic() - self._passed_s < CLOSING_S:
            self._thread.join(0.1)
        if self._thread.is_alive():
            with self._changed:
                self._failed = f"the disk took nothing for {CLOSING_S:g} s; the last frames may be lost"
                waiting = [one.step for one in self._queue if isinstance(one, WaitingStep) and not one.late]
                self._unkept += sum(step.frame_number is not None for step in waiting)
                self._queue.clear()

    def __exit__(self, *_: object) -> None:
        self.close()

    # In the thread

    def _serve(self) -> None:
        try:
            while (one := self._next()) is not None:
                if isinstance(one, WaitingReading):
                    added = self._rows.of_reading(one)
                elif isinstance(one, WaitingFine):
                    added = self._rows.of_fine(one)
                else:
                    added = self._rows.of_step(one, self._status_note())
                self._line.send(one.step.time_ns, added, one.bytes)
            self._send_last_words()
            self._line.end()
            while not self._line.wait(0.2):
                self._listen()
        except OSError:
            self._line.wait(1.0)  # the process has ended; its last reports are still in the pipe
        except Exception as error:
            self._failing = " ".join(str(error).split()) or type(error).__name__
        self._listen()
        self._line.abandon()
        if not self._closed and not self._failing:
            self._failing = "the process that writes has ended"
        # only the file can say which of the last frames were flushed, while it has its name
        ask = self._failing and not self._astray and self._line.wait(1.0)
        in_file = frames_in(self._path, self._wants) if ask else None
        with self._changed:
            self._in_file = in_file
            self._failed = self._failed or self._failing
            self._queue.clear()
            self._changed.notify_all()

    def _send_last_words(self) -> None:
        """Note in the file how the recording ended, if not all was kept; once all else is written."""
        while self._line.busy and not self._line.wait(LOOK_S):
            self._listen()
        self._listen()
        if self.status not in {RecorderStatus(), self._noted}:
            self._line.send(0, [(Write.ALWAYS, *self._rows.note(self.status.note))], 0)

    def _next(self) -> Waiting | None:
        """The next in the queue; None at the end."""
        while True:
            self._listen()
            with self._changed:
                # messages under way may be written before anything new comes
                timeout_s = LOOK_S if self._line.busy else None
                self._changed.wait_for(lambda: self._queue or self._closing, timeout_s)
                if self._queue:
                    return self._queue.popleft()
                if self._closing:
                    return None

    def _listen(self) -> None:
        """Take in the writer's reports."""
        unread = self._line.news()
        freed = self._line.freed()
        with self._changed:
            if freed:
                self._bytes -= freed
                self._changed.notify_all()
                self._passed_s = time.monotonic()
            for news in unread:
                if news.topic is Topic.FULL:
                    self._unkept += news.frames
                    self._full_ns = news.time_ns if self._full_ns is None else self._full_ns
                    self._full = news.text
                elif news.topic is Topic.ROOM:
                    self._full_ns = None
                elif news.topic is Topic.ASTRAY:
                    self._astray = news.text
                elif news.topic is Topic.FAILED:
                    self._failing = news.text
                elif news.topic is Topic.CLOSED:
                    self._closed = True

    def _status_note(self) -> str | None:
        """What to note of the recording itself; None while its condition stays the same."""
        status = self.status
        if status.condition is self._noted.condition:
            return None
        self._noted = status
        return status.note
