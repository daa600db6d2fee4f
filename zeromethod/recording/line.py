"""The line to the process that writes: shared memory and two pipes."""

from __future__ import annotations

import contextlib
import errno
import json
import mmap
import os
import select
import subprocess
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from zeromethod.child_process import start_process
from zeromethod.errors import InputError
from zeromethod.recording.message import Item, News, Topic, send
from zeromethod.recording.rows import Added
from zeromethod.recording.schema import Dataset
from zeromethod.recording.size_limit import size_limit

OPENING_S = 30.0
"""How long the process may take to start."""

LOOK_S = 0.2
"""How often a wait checks whether the process still runs."""

RING_BYTES = 64 << 20
"""Shared memory; more where four of the largest messages take more."""

ALIGNED = 64
"""Items begin at multiples of so many bytes."""


def aligned(size: int) -> int:
    """Size with the gap up to the next item."""
    return -(-size // ALIGNED) * ALIGNED


class Ring:
    """Memory shared by two processes, first in, first out: the sender's side.

    While the receiver keeps up, the same few pages are used again and again.
    """

    def __init__(self, size: int) -> None:
        self.handle = os.memfd_create("zeromethod recording")
        os.ftruncate(self.handle, size)
        self.memory = mmap.mmap(self.handle, size)
        self._size = size
        self._used: deque[tuple[int, int]] = deque()

    def take(self, size: int) -> int | None:
        """Offset of free memory of that size, in use from now on; None where there is none yet."""
        start = self._free(size)
        if start is not None:
            self._used.append((start, start + size))
        return start

    def _free(self, size: int) -> int | None:
        if not self._used:
            return 0 if size <= self._size else None
        first, (last, end) = self._used[0][0], self._used[-1]
        if last >= first and end + size <= self._size:
            return end
        start = 0 if last >= first else end
        # never up to the first byte in use: full would look like empty
        return start if start + size < first else None

    def release(self) -> None:
        """Free what was taken first."""
        self._used.popleft()


class Line:
    """A process of its own that writes into a file, as the run's process has it."""

    def __init__(self, path: Path, parts: Mapping[str, Dataset], largest: int) -> None:
        """Start it. parts: the file's datasets. largest: bytes of a message.

        Raises InputError where it cannot write into the file.
        """
        size = max(RING_BYTES, 4 * largest)
        try:
            self._ring = Ring(size)
        except OSError as error:
            # the limit of a file's size holds for shared memory, too
            why = size_limit() if error.errno == errno.EFBIG else error.strerror
            raise InputError(f"{path}: no {size >> 20} MB of shared memory to record by: {why}") from None
        self._parts = list(parts.values())
        self._index = {name: index for index, name in enumerate(parts)}
        self._costs: deque[int] = deque()
        self._freed = 0
        theirs_in, self._messages = os.pipe()
        self._news, theirs_out = os.pipe()
        os.set_blocking(self._news, False)
        self._received = b""
        self._unread: list[News] = []
        handles = theirs_in, theirs_out, self._ring.handle
        arguments = str(path), json.dumps(list(parts)), *map(str, handles)
        try:
            self._process = start_process(
                "zeromethod.recording.writing",
                *arguments,
                pass_fds=handles,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            self.abandon()
            raise InputError(
                f"{path}: the process that writes recordings does not start: {error.strerror}"
            ) from None
        finally:
            os.close(theirs_in)
            os.close(theirs_out)
        self._await_ready(path)

    def _await_ready(self, path: Path) -> None:
        until_s = time.monotonic() + OPENING_S
        while time.monotonic() < until_s:
            for news in self.news():
                if news.topic is Topic.READY:
                    return
                if news.topic is Topic.FAILED:
                    self.abandon()
                    raise InputError(f"{path}: cannot be written: {news.text}")
            if self._process.poll() is not None:
                break
            time.sleep(0.01)
        self.abandon()
        raise InputError(f"{path}: the process that writes recordings does not start")

    @property
    def process_id(self) -> int:
        """Its number in the system."""
        return self._process.pid

    def send(self, time_ns: int, added: Sequence[Added], cost: int) -> None:
        """Hand over a message; waits while the memory is full.

        cost: added to `freed` once it is written. Raises OSError when the process has ended, ValueError for
        an array of another shape than its dataset's.
        """
        indices = [self._index[name] for _, name, _ in added]
        start = self._room(sum(aligned(self._parts[index].bytes) for index in indices))
        items = []
        for index, (write, name, array) in zip(indices, added, strict=True):
            part = self._parts[index]
            if array.shape != part.shape:
                raise ValueError(f"{name}: an array of {array.shape}, not {part.shape}")
            place = np.ndarray(part.shape, part.dtype, self._ring.memory, start)
            np.copyto(place, array, casting="same_kind")
            items.append(Item(index, write, start, part.bytes))
            start += aligned(part.bytes)
        self._costs.append(cost)
        send(self._messages, time_ns, items)

    def end(self) -> None:
        """Say that the run is over."""
        send(self._messages, 0, [])

    def _room(self, size: int) -> int:
        while True:
            self._listen()
            start = self._ring.take(size)
            if start is not None:
                return start
            select.select([self._news], [], [], LOOK_S)
            if self._process.poll() is not None:
                raise BrokenPipeError

    @property
    def busy(self) -> bool:
        """Whether a message is not yet written."""
        return bool(self._costs)

    def freed(self) -> int:
        """Cost of the messages written since the last call."""
        freed, self._freed = self._freed, 0
        return freed

    def news(self) -> list[News]:
        """Its reports since the last call, but for written messages."""
        self._listen()
        unread, self._unread = self._unread, []
        return unread

    def _listen(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while part := os.read(self._news, 1 << 16):
                self._received += part
        *lines, self._received = self._received.split(b"\n")
        for line in lines:
            news = News.decode(line)
            if news.topic is Topic.WRITTEN:
                self._ring.release()
                self._freed += self._costs.popleft()
            else:
                self._unread.append(news)

    def wait(self, timeout_s: float) -> bool:
        """Whether the process has ended, within that time."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def abandon(self) -> None:
        """Send nothing more: the process writes all that it was given, and ends."""
        for handle in (self._messages, self._news, self._ring.handle):
            with contextlib.suppress(OSError):
                os.close(handle)
