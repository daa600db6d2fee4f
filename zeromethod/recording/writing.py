"""The process that writes: nothing that a disk does can keep the run's from going on.

It ends by itself when the run's process has, however that came about, with all written that it was given.
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
from zeromethod.recording.growing import DiskFull, GrowingFile
from zeromethod.recording.message import WITH_ROOM, WITHOUT_ROOM, Message, receive

FLUSH_S = 0.2
"""What is older than this can be read by others."""


class Writing:
    """Takes messages into a file and tells what became of them."""

    def __init__(self, file: GrowingFile, memory: memoryview, news: int) -> None:
        """memory: where the items' bytes lie. news: pipe to the run's process."""
        self._file = file
        self._memory = memory
        self._news = news
        self._flushed_s = time.monotonic()
        self._dirty = False
        self._lacking = 0

    def tell(self, **news: object) -> None:
        """Let the run's process know; it may be gone."""
        with contextlib.suppress(OSError):
            os.write(self._news, json.dumps(news).encode() + b"\n")

    def take(self, message: Message) -> None:
        """Add a message; raises DiskFull where not even tables fit, else as `GrowingFile.append`."""
        arrays = sum(item.size for item in message.items if item.kind == WITH_ROOM)
        lost = False
        if arrays:
            try:
                self._file.claim(arrays, arrays=True)
            except DiskFull as error:
                lost = True
                frames = sum(item.kind == WITHOUT_ROOM for item in message.items)
                self.tell(full=str(error), time_ns=message.time_ns, frames=frames)
                self._lacking = arrays
            else:
                self._fitted(arrays)
        left_out = WITH_ROOM if lost else WITHOUT_ROOM
        items = [item for item in message.items if item.kind != left_out]
        self._file.claim(sum(item.size for item in items if item.kind != WITH_ROOM), arrays=False)
        for item in items:
            self._file.append(item.dataset, self._memory[item.start : item.start + item.size])
        self._dirty = True
        self.tell(done=True)

    def _fitted(self, size: int) -> None:
        """Tell that there is room again: smaller arrays may find some while the disk is full."""
        if self._lacking > 0:
            # what lacked is more than was left then
            self._lacking -= size
            if self._lacking <= 0:
                self.tell(room=True)

    def flush(self) -> None:
        """Flush if that is due."""
        now_s = time.monotonic()
        if self._dirty and now_s - self._flushed_s >= FLUSH_S:
            self._file.flush()
            self._dirty = False
            self._flushed_s = time.monotonic()

    @property
    def due_s(self) -> float | None:
        """Until the next flush; None when nothing is to be flushed."""
        return max(0.0, self._flushed_s + FLUSH_S - time.monotonic()) if self._dirty else None


def serve(path: Path, names: list[str], messages: int, news: int, shared: int) -> None:
    """Write until the sender says that the run is over (a message without items), or is gone."""
    file = GrowingFile(path, names)
    writing = Writing(file, memoryview(mmap.mmap(shared, 0, prot=mmap.PROT_READ)), news)
    lower_priority()  # not before: the run waits for it to start
    writing.tell(ready=True)
    complete = False
    try:
        complete = _follow(writing, messages)
    except DiskFull as error:
        # what was taken before has its room
        writing.tell(failed=f"the disk is full ({error})")
    file.close(complete)
    writing.tell(closed=True)


def _follow(writing: Writing, messages: int) -> bool:
    """Take messages to the end; whether the sender told that it was one."""
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
        try:
            os.write(int(news), json.dumps({"failed": words}).encode() + b"\n")
        finally:
            # HDF5 would try again, and again fail, to write what it could not
            os._exit(1)


if __name__ == "__main__":
    main()
