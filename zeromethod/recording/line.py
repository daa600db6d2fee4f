"""The line to the process that writes."""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import subprocess
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zeromethod.arrays import Image
from zeromethod.child_process import start_process
from zeromethod.errors import InputError
from zeromethod.recording.message import Item, send
from zeromethod.recording.ring import Ring, aligned

OPENING_S = 30.0
"""How long the process may take to start."""

LOOK_S = 0.2
"""How often it is looked whether the process is still there, while it is waited for."""

RING_BYTES = 64 << 20
"""Memory that both share, if a message is not so large that it takes more for four of them."""


class Content(NamedTuple):
    """An array for a dataset of that index, which has items of that type and shape."""

    dataset: int
    kind: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    array: Image


class Line:
    """A process of its own that writes into a file; shared memory and two pipes lead there and back."""

    def __init__(self, path: Path, names: Sequence[str], largest: int) -> None:
        """Start it. largest: bytes of a message. Raises InputError where it cannot write into the file."""
        size = max(RING_BYTES, 4 * largest)
        try:
            self._ring = Ring(size)
        except OSError as error:
            raise InputError(f"{path}: no {size >> 20} MB of memory to record by: {error.strerror}") from None
        self._costs: deque[int] = deque()
        self._freed = 0
        theirs_in, self._messages = os.pipe()
        self._news, theirs_out = os.pipe()
        os.set_blocking(self._news, False)
        self._told = b""
        self._unread: list[dict[str, Any]] = []
        handles = theirs_in, theirs_out, self._ring.handle
        arguments = str(path), json.dumps(list(names)), *map(str, handles)
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
                if "ready" in news:
                    return
                if "failed" in news:
                    self.abandon()
                    raise InputError(f"{path}: cannot be written: {news['failed']}")
            if self._process.poll() is not None:
                break
            time.sleep(0.01)
        self.abandon()
        raise InputError(f"{path}: the process that writes recordings does not start")

    @property
    def process_id(self) -> int:
        """As the system numbers it."""
        return self._process.pid

    def send(self, time_ns: int, contents: Sequence[Content], cost: int) -> None:
        """Hand over a message; waits while the process has too much before it.

        cost: what `freed` tells once it is written. Raises OSError when the process is gone.
        """
        sizes = [content.dtype.itemsize * math.prod(content.shape) for content in contents]
        start = self._room(sum(aligned(size) for size in sizes))
        items = []
        for content, size in zip(contents, sizes, strict=True):
            place = np.frombuffer(self._ring.memory, content.dtype, math.prod(content.shape), start)
            np.copyto(place.reshape(content.shape), content.array, casting="same_kind")
            items.append(Item(content.dataset, content.kind, start, size))
            start += aligned(size)
        self._costs.append(cost)
        send(self._messages, time_ns, items)

    def end(self) -> None:
        """Tell that the run is over."""
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
        """Whether something that was handed over is not yet written."""
        return bool(self._costs)

    def freed(self) -> int:
        """Cost of what was written since the last call."""
        freed, self._freed = self._freed, 0
        return freed

    def news(self) -> list[dict[str, Any]]:
        """What it told since the last call."""
        self._listen()
        told, self._unread = self._unread, []
        return told

    def _listen(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while part := os.read(self._news, 1 << 16):
                self._told += part
        *lines, self._told = self._told.split(b"\n")
        for line in lines:
            news = json.loads(line)
            if "done" in news:
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
        """Send nothing more: the process writes what it was given, and ends."""
        for handle in (self._messages, self._news):
            with contextlib.suppress(OSError):
                os.close(handle)
        self._ring.close()
