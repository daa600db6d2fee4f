"""What a run hands its turns and readings to, to be recorded."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Collection
from pathlib import Path
from types import TracebackType

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.loop.step import Step
from zeromethod.recording.counting import frames_in
from zeromethod.recording.file import create, discard
from zeromethod.recording.header import about, rest_arrays, rig_text
from zeromethod.recording.line import Content, Line
from zeromethod.recording.message import ALWAYS, WITH_ROOM, WITHOUT_ROOM
from zeromethod.recording.rows import Added, Item, Rows
from zeromethod.recording.schema import KEEP, parts
from zeromethod.recording.sums import SUMS
from zeromethod.recording.waiting import Reading, Turn, without_arrays
from zeromethod.rig.model import Rig
from zeromethod.surface import Peak, Surface
from zeromethod.warp.rest import Rest

WAITING_BYTES = 512 << 20
"""Arrays that may wait for the disk: two seconds of everything at 1280x1024 and 60 frames per second."""

WAITING_TURNS = 20_000
"""Turns whose rows of the tables may wait: five minutes of them at 60 frames per second."""

LOOK_S = 0.05
"""How often it is looked what was written, while nothing new comes."""

CLOSING_S = 20.0
"""How long `close` waits for a disk that takes nothing more."""

PATIENCE_S = 5.0
"""How long a turn waits for the disk in simulated time, where nobody waits for the turn."""

TOO_SLOW = "the disk is too slow"
FULL = "the disk is full"


class Recorder:
    """Records a run into one file; `turn` and `reading` return at once, from whichever thread.

    (In simulated time, where nothing can come too late, they may wait for the disk instead.)

    Arrays are handed over as they are, and must not be changed afterwards. A thread passes them on to a
    process of its own, which writes: whatever the disk does, the run goes on. What then is not kept is told
    in `state`, and in the recording's table of drops.
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
        waiting_bytes: int = WAITING_BYTES,
    ) -> None:
        """Make the file, and start what writes into it.

        keep: of `KEEP`. every: arrays of every so many-th turn. calibration: text of its document.
        compress: arrays, without loss; reading them then needs hdf5plugin. waiting_bytes: arrays that may
        wait for the disk. Raises InputError, one line: the file is there already or cannot be made, other
        names in `keep`.
        """
        unknown = sorted(set(keep) - set(KEEP))
        if unknown:
            raise InputError(f"--keep: {unknown[0]!r}: of {', '.join(KEEP)}")
        if every < 1:
            raise InputError(f"--every: {every}: a whole number from 1 on")
        kept = [name for name in KEEP if name in keep]
        camera = rig.camera
        self._parts = parts((camera.rows, camera.columns), camera.bits, rest.grid.shape, kept, every)
        described = about(
            rig,
            keep=kept,
            every=every,
            command_line=command_line,
            live=live,
            gl_renderer=gl_renderer,
            calibration=calibration,
            compressed=compress,
        )
        create(Path(path), self._parts, described, rest_arrays(rest), rig_text(rig)[1], compress)
        self._index = {name: index for index, name in enumerate(self._parts)}
        self._rows = Rows(self._parts)
        self._every = every
        self._live = live
        arrays = [part for name, part in self._parts.items() if part.kept and not name.endswith(f"/{SUMS}")]
        self._reading_bytes = sum(part.bytes for part in arrays if part.kept == "surface")
        self._turn_bytes = sum(part.bytes for part in arrays if part.kept != "surface")
        try:
            self._line = Line(Path(path), list(self._parts), 2 * self._turn_bytes + self._reading_bytes)
        except BaseException:
            discard(Path(path))
            raise
        self._path = Path(path)
        self._most_waiting = waiting_bytes
        self._zero: Float | None = None
        self._pictures = 0
        self._start_ns: int | None = None
        self._changed = threading.Condition()
        self._queue: deque[Turn | Reading] = deque()
        self._bytes = 0
        self._frames = 0
        self._unkept = 0
        self._lost = 0
        self._full_ns: int | None = None
        self._full = ""
        self._failed = ""
        self._failing = ""
        self._in_file: int | None = None
        self._noted = ""
        self._last = 0, 0
        self._closing = False
        self._closed = False
        self._passed_s = time.monotonic()
        self._thread = threading.Thread(target=self._serve, name="record", daemon=True)
        self._thread.start()

    @property
    def state(self) -> str:
        """What the operator should know; "" while all is well."""
        with self._changed:
            count = self.unkept
            frames = f", {count} frame{'' if count == 1 else 's'} not kept" if count else ""
            if self._failed:
                return f"recording stopped: {self._failed}{frames}"
            if self._full_ns is not None:
                after_s = 1e-9 * (self._full_ns - (self._start_ns or 0))
                return f"disk full: recording stopped at {after_s:.1f} s ({self._full}){frames}"
            if count:
                return f"disk {'was full' if self._full else 'too slow'}: {frames[2:]}"
            return ""

    @property
    def unkept(self) -> int:
        """Frames whose arrays are not in the file though they were to be."""
        with self._changed:
            return self._unkept if self._in_file is None else self._frames - self._in_file

    @property
    def waiting_bytes(self) -> int:
        """Size of the arrays that wait for the disk."""
        with self._changed:
            return self._bytes

    @property
    def writer_id(self) -> int:
        """Number of the process that writes, as the system has it."""
        return self._line.process_id

    def turn(self, step: Step, phase: str = "") -> None:
        """Record a turn of the loop. phase: the part of a simulated scenario that it lies in."""
        frame = step.frame_number is not None
        with self._changed:
            if self._closing:
                return
            self._frames += frame
            if self._start_ns is None:
                self._start_ns = step.time_ns
            if self._failed or len(self._queue) >= WAITING_TURNS:
                self._unkept += frame
                self._lost += 1
                return
            size = self._turn_bytes if self._wants(step.number) else 0
            self._await_room(size)
            late = self._bytes + size > self._most_waiting
            if late:
                self._unkept += frame
                step, size = without_arrays(step), 0
            self._bytes += size
            self._queue.append(Turn(step, phase, size, late, self._lost))
            self._lost = 0
            self._changed.notify_all()

    def reading(self, step: Step, surface: Surface, peak: Peak, read_ms: float) -> None:
        """Record what was read from a turn."""
        with self._changed:
            if self._closing or self._failed or len(self._queue) >= WAITING_TURNS:
                return
            size = self._reading_bytes if self._wants(step.number) else 0
            self._await_room(size)
            if self._bytes + size > self._most_waiting:
                size = 0
            self._bytes += size
            self._queue.append(Reading(step, surface if size else None, peak, read_ms, size))
            self._changed.notify_all()

    def _await_room(self, size: int) -> None:
        """In simulated time, where nothing is late, wait for the disk as long as it takes anything."""
        if not self._live:
            self._changed.wait_for(
                lambda: self._bytes + size <= self._most_waiting or self._failed != "", PATIENCE_S
            )

    def _wants(self, turn: int) -> bool:
        return (turn - 1) % self._every == 0

    def close(self) -> None:
        """Write what is waiting, and end the recording; may be called again.

        Returns early, with what is left lost, when the disk takes nothing for `CLOSING_S`.
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
                self._failed = f"the disk took nothing for {CLOSING_S:g} s; what waits for it may be lost"
                waiting = [one.step for one in self._queue if isinstance(one, Turn) and not one.late]
                self._unkept += sum(step.frame_number is not None for step in waiting)
                self._queue.clear()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # In the thread

    def _serve(self) -> None:
        try:
            while (one := self._next()) is not None:
                self._pass_on(one)
            self._pass_on_last_words()
            self._line.end()
            while not self._line.wait(0.2):
                self._listen()
        except OSError:
            self._line.wait(1.0)  # it is gone; what it told is still there
        except Exception as error:
            self._failing = " ".join(str(error).split()) or type(error).__name__
        self._listen()
        self._line.abandon()
        if not self._closed and not self._failing:
            self._failing = "the process that writes has ended"
        # what was on its way, or not yet flushed, is told by the file alone
        in_file = self._count() if self._failing and self._line.wait(1.0) else None
        with self._changed:
            self._in_file = in_file
            self._failed = self._failed or self._failing
            self._queue.clear()
            self._changed.notify_all()

    def _count(self) -> int | None:
        """Frames that are in the file, with what of their arrays was to be kept; None: it cannot be read."""
        try:
            return frames_in(self._path, self._wants)
        except InputError:
            return None

    def _pass_on_last_words(self) -> None:
        """Note how it ended in the file, if not all is well; once all that was handed over is written."""
        while self._line.busy and not self._line.wait(LOOK_S):
            self._listen()
        self._listen()
        words = self.state
        if words and words != self._noted:
            self._send([(ALWAYS, *self._rows.note(*self._last, f"recording: {words}"))], self._last[1], 0)

    def _next(self) -> Turn | Reading | None:
        """What has waited longest; None at the end."""
        while True:
            self._listen()
            with self._changed:
                # what is under way may be done before anything new comes
                timeout_s = LOOK_S if self._line.busy else None
                self._changed.wait_for(lambda: self._queue or self._closing, timeout_s)
                if self._queue:
                    return self._queue.popleft()
                if self._closing:
                    return None

    def _listen(self) -> None:
        """Take in what the process told."""
        told = self._line.news()
        freed = self._line.freed()
        with self._changed:
            if freed:
                self._bytes -= freed
                self._changed.notify_all()
                self._passed_s = time.monotonic()
            for news in told:
                if "full" in news:
                    self._unkept += int(news["frames"])
                    self._full_ns = news["time_ns"] if self._full_ns is None else self._full_ns
                    self._full = str(news["full"])
                elif "room" in news:
                    self._full_ns = None
                elif "failed" in news:
                    self._failing = str(news["failed"])
                elif "closed" in news:
                    self._closed = True

    def _pass_on(self, one: Turn | Reading) -> None:
        added = self._of_turn(one) if isinstance(one, Turn) else self._of_reading(one)
        self._send(added, one.step.time_ns, one.bytes)

    def _send(self, added: list[Added], time_ns: int, cost: int) -> None:
        contents = []
        for kind, name, array in added:
            part = self._parts[name]
            if array.shape != part.shape:
                raise ValueError(f"{name}: an array of {array.shape}, not {part.shape}")
            contents.append(Content(self._index[name], kind, part.dtype, part.shape, array))
        self._line.send(time_ns, contents, cost)

    def _own_note(self) -> list[Item]:
        """Row of what the operator is told of the recording itself, when that changes."""
        words = self.state
        # counts that follow may change with every frame
        if words.partition(":")[0] == self._noted.partition(":")[0]:
            return []
        self._noted = words
        return [self._rows.note(*self._last, f"recording: {words or 'all is kept again'}")]

    def _of_turn(self, turn: Turn) -> list[Added]:
        rows, step = self._rows, turn.step
        number, time_ns = step.number, step.time_ns
        self._last = number, time_ns
        always = [rows.turn(step, turn.phase), *rows.notes(step), *self._own_note()]
        arrays = rows.arrays(step) if turn.bytes else []
        if step.dropped:
            why = f"lost before frame {step.frame_number}"
            always.append(rows.drop(number, time_ns, step.dropped, "camera", why))
        if (
            turn.bytes
            and step.image is not None
            and "frames/image" in self._parts
            and not rows.fits(step.image)
        ):
            always.append(rows.drop(number, time_ns, 1, "camera", step.reason))
        if turn.lost:
            always.append(rows.drop(number, time_ns, turn.lost, "recorder", f"{TOO_SLOW}: not even noted"))
        if turn.late and step.frame_number is not None:
            always.append(rows.drop(number, time_ns, 1, "recorder", TOO_SLOW))
        for index, one in enumerate(step.presented):
            always.append(rows.presented(one, number - (index < step.presented_before)))
            if turn.bytes:
                arrays += rows.picture(one, self._pictures)
            self._pictures += 1
        if step.zero is not None and step.zero is not self._zero:
            always += rows.zero(step, step.zero)
        self._zero = step.zero
        instead = []
        if arrays and step.frame_number is not None:
            instead.append(rows.drop(number, time_ns, 1, "recorder", FULL))
        return [
            *((WITH_ROOM, *item) for item in arrays),
            *((WITHOUT_ROOM, *item) for item in instead),
            *((ALWAYS, *item) for item in always),
        ]

    def _of_reading(self, reading: Reading) -> list[Added]:
        number = reading.step.number
        added: list[Added] = []
        if reading.surface is not None:
            added += [(WITH_ROOM, *item) for item in self._rows.surface(number, reading.surface)]
        return [*added, (ALWAYS, *self._rows.peak(number, reading.peak, reading.read_ms))]
