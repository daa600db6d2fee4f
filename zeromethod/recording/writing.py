"""The process that writes: no disk, however slow, can stop the run's own process.

When the run's process ends, for whatever reason, it writes all that it was given and ends too.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import select
import sys
import time
from pathlib import Path

from zeromethod.child_process import ignore_signals, lower_priority
from zeromethod.recording.growing import DiskFull, GrowingFile, Overwritten
from zeromethod.recording.message import Message, News, Topic, Write, receive

FLUSH_S = 0.2
"""Age from which items can be read by others."""


class Writing:
    """Writes messages into a file and reports what became of them."""

    def __init__(self, file: GrowingFile, memory: memoryview, news: int) -> None:
        """memory: where the items' bytes lie. news: pipe to the run's process."""
        self._file = file
        self._memory = memory
        self._news = news
        self._flushed_s = time.monotonic()
        self._dirty = False
        self._lacking = 0
        self._elsewhere = ""

    def report(self, topic: Topic, text: str = "", time_ns: int = 0, frames: int = 0) -> None:
        """Send news to the run's process, which may have ended."""
        with contextlib.suppress(OSError):
            os.write(self._news, News(topic, text, time_ns, frames).encode())

    def take(self, message: Message) -> None:
        """Add a message; raises DiskFull where not even tables fit, else as `GrowingFile.append`."""
        arrays = sum(item.size for item in message.items if item.write is Write.WITH_ROOM)
        left_out = Write.WITHOUT_ROOM
        if arrays:
            try:
                self._file.claim(arrays, arrays=True)
            except DiskFull as error:
                left_out = Write.WITH_ROOM
                frames = sum(item.write is Write.WITHOUT_ROOM for item in message.items)
                self.report(Topic.FULL, str(error), message.time_ns, frames)
                self._lacking = arrays
            else:
                self._fitted(arrays)
        items = [item for item in message.items if item.write is not left_out]
        self._file.claim(sum(item.size for item in items if item.write is not Write.WITH_ROOM), arrays=False)
        for item in items:
            self._file.append(item.dataset, self._memory[item.start : item.start + item.size])
        self._dirty = True
        self.report(Topic.WRITTEN)

    def _fitted(self, size: int) -> None:
        """Report room again once as much fitted as had not: smaller arrays may find some on a full disk."""
        if self._lacking > 0:
            self._lacking -= size
            if self._lacking <= 0:
                self.report(Topic.ROOM)

    def flush(self) -> None:
        """Flush if that is due, once it is known that the file is still ours, and where it is."""
        if self.due_s > 0:
            return
        self.look()
        if self._dirty:
            self._file.flush()
            self._dirty = False
        self._flushed_s = time.monotonic()

    def look(self, ended: bool = False) -> None:
        """Report where the file is, when that changes; raises Overwritten."""
        self._file.check_own()
        before, self._elsewhere = self._elsewhere, self._file.elsewhere(ended)
        if self._elsewhere != before:
            self.report(Topic.ASTRAY, self._elsewhere)

    @property
    def due_s(self) -> float:
        """Until the next flush."""
        return max(0.0, self._flushed_s + FLUSH_S - time.monotonic())


def serve(path: Path, names: list[str], messages: int, news: int, shared: int) -> None:
    """Write until the sender says that the run is over (a message without items), or has ended."""
    file = GrowingFile(path, names)
    writing = Writing(file, memoryview(mmap.mmap(shared, 0, prot=mmap.PROT_READ)), news)
    lower_priority()  # not before: the run waits for it to start
    writing.report(Topic.READY)
    complete = False
    try:
        complete = _follow(writing, messages)
    except DiskFull as error:
        # earlier messages have their room
        writing.report(Topic.FAILED, f"the disk is full ({error})")
    except (OSError, RuntimeError):
        file.check_own()  # which may be why
        raise
    writing.look(ended=True)
    file.close(complete)
    writing.report(Topic.CLOSED)


def _follow(writing: Writing, messages: int) -> bool:
    """Write messages to the end; whether the sender said that the run is over."""
    while True:
        ready, _, _ = select.select([messages], [], [], writing.due_s)
        if ready:
            message = receive(messages)
            if message is None:
                return False
            if not message.items:
                return True
            writing.take(message)
        writing.flush()


def main() -> None:
    """Arguments: path, JSON list of the datasets' names, file descriptors: messages, news, memory."""
    ignore_signals()
    path, names, messages, news, shared = sys.argv[1:]
    try:
        serve(Path(path), json.loads(names), int(messages), int(news), int(shared))
    except Exception as error:
        words = " ".join(str(error).split()) or type(error).__name__
        topics = (Topic.ASTRAY, Topic.FAILED) if isinstance(error, Overwritten) else (Topic.FAILED,)
        try:
            for topic in topics:
                os.write(int(news), News(topic, words).encode())
        finally:
            # HDF5 would try to write the rest again, and fail again
            os._exit(1)


if __name__ == "__main__":
    main()
