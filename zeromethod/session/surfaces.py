"""The surfaces of a run, read in its process or, live, in one that shares no interpreter with the loop."""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from zeromethod.array_exchange import NONE, ArrayExchange, shared_memory
from zeromethod.child_process import ignore_signals, lower_priority, start_process, take_output
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.thread_limits import limit_threads
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

_BYTES_PER_NODE = 400
"""Shared memory: twice what the arrays of two surfaces take, as parts cut off are one of their own."""

_PARTS = 4
"""Parts of it: for two requests under way, and for their answers."""

PATIENCE_S = 5.0
"""How long a reading may take before its process is given up; it takes some 20 ms."""


class ReadingLost(Exception):
    """The process that reads surfaces is gone; why, in words."""


class SurfaceProcess:
    """A `SurfaceReader` in a process of its own: of the same warps in turn the same readings, bit for bit."""

    def __init__(
        self, rig: Rig, grid: NodeGrid, module: str = __name__, size: int = 0, patience_s: float | None = None
    ) -> None:
        """Start it; `read` waits until it has started. Raises ReadingLost where it cannot be.

        module: whose `main` it runs. size: bytes of shared memory; 0: what surfaces need. patience_s: how
        long a reading may take.
        """
        self._patience_s = patience_s
        self._turn = threading.Lock()
        self._asked_s: float | None = None
        self._under_way: deque[tuple[int, object]] = deque()
        self._why = ""
        size = _PARTS * (size or _BYTES_PER_NODE * math.prod(grid.shape))
        memory = shared_memory("zeromethod surfaces", size)
        self._exchange = ArrayExchange(memory, _PARTS)
        # else two processes might wait for each other's pipe to be read
        self._goes_ahead = memory != NONE
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        handles = () if memory == NONE else (memory,)
        try:
            self._process = start_process(module, str(memory), pass_fds=handles, **pipes)
        except OSError as error:
            raise ReadingLost(f"it does not start: {error.strerror}") from None
        finally:
            for handle in handles:
                os.close(handle)
        self._setting: tuple[Rig, NodeGrid] | None = rig, grid

    @property
    def process_id(self) -> int:
        """As the system numbers it."""
        return self._process.pid

    def read(self, warp: Warp) -> tuple[Surface, Peak]:
        """Surface of a measured warp and its peak, as `SurfaceReader.follow`, which see.

        Raises what reading raised; ReadingLost once the process has ended.
        """
        surface, deepest = self.ask(warp)
        return surface, deepest

    def begin(self, request: object) -> None:
        """Send a request ahead: it is `ask`ed next, or after the one that was begun before it.

        So the process need not wait while the answer before is being dealt with.
        """
        with self._turn:
            if self._goes_ahead and len(self._under_way) < 2:
                with contextlib.suppress(OSError, ValueError):  # `ask` says why
                    self._send(request)

    def ask(self, request: object) -> Any:
        """Answer of the process to a request; raises as `read`."""
        with self._turn:
            self._asked_s = time.monotonic()
            try:
                answer = self._ask(request)
            finally:
                self._asked_s = None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _send(self, request: object) -> None:
        given = self._process.stdin
        assert given is not None
        part = 1 - self._under_way[-1][0] if self._under_way else 0
        self._exchange.send((self._setting, part, request), given, part)
        self._setting = None
        self._under_way.append((part, request))

    def _ask(self, request: object) -> Any:
        answers = self._process.stdout
        assert answers is not None
        try:
            if all(one is not request for _, one in self._under_way):
                while len(self._under_way) > 1:  # given up by whoever began it
                    self._exchange.receive(answers)
                    self._under_way.popleft()
                self._send(request)
            while True:
                answer = self._exchange.receive(answers)
                if self._under_way.popleft()[1] is request:
                    return answer
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            raise ReadingLost(self._why or self._end()) from None

    def give_up_if_late(self) -> None:
        """End it where a reading takes longer than it may, which makes that raise ReadingLost."""
        asked_s, patience_s = self._asked_s, self._patience_s or PATIENCE_S
        if asked_s is not None and time.monotonic() - asked_s > patience_s and not self._why:
            self._why = f"a reading took more than {patience_s:g} s"
            self._process.kill()

    def _end(self) -> str:
        """Why it ended by itself."""
        code = self._process.wait()
        return f"signal {-code}" if code < 0 else f"exit code {code}"

    def close(self) -> None:
        """End it; a reading under way raises ReadingLost. May be called again."""
        self._why = "it was ended"
        self._process.kill()
        self._process.wait()
        with self._turn:
            for stream in (self._process.stdin, self._process.stdout):
                assert stream is not None
                with contextlib.suppress(OSError):  # what was not yet sent cannot be
                    stream.close()


class Surfaces:
    """Reads the surfaces of a run's warps in turn, in this process or in another one."""

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid) -> None:
        """As `SurfaceReader`."""
        self._rig, self._grid = rig, grid
        self._own = SurfaceReader(rig, optics, grid)
        self._process: SurfaceProcess | None = None
        self._begun: dict[int, tuple[Warp, float]] = {}
        self._free_s = 0.0
        self._ended = False
        self._note = ""

    @contextlib.contextmanager
    def in_own_process(self, first: Warp) -> Iterator[None]:
        """Within this context, read in a process of its own: else the loop waits while reading computes.

        first: read at once: the run begins when the process has imported what it needs and answers.
        """
        self._ended = False
        process: SurfaceProcess | None = None
        try:
            self._process = process = SurfaceProcess(self._rig, self._grid)
        except ReadingLost as why:
            self._give_up(why)
        try:
            self.read(first)
            yield
        finally:
            self._ended = True
            self._process = None
            if process is not None:
                process.close()

    @property
    def process_id(self) -> int | None:
        """Of the process that reads, as the system numbers it; None where this one does."""
        return None if self._process is None else self._process.process_id

    def begin(self, number: int, warp: Warp) -> None:
        """Take the warp of a step; a process that reads begins with it. See `SurfaceProcess.begin`."""
        self._begun[number] = warp, time.perf_counter()
        if self._process is not None:
            self._process.begin(warp)

    def finish(self, number: int) -> tuple[Surface, Peak, float]:
        """As `read`, of a step that was begun, and how long the reading took, ms."""
        warp, began_s = self._begun.pop(number)
        surface, deepest = self.read(warp)
        since_s, self._free_s = max(began_s, self._free_s), time.perf_counter()
        return surface, deepest, 1e3 * (self._free_s - since_s)

    def read(self, warp: Warp) -> tuple[Surface, Peak]:
        """Surface of a measured warp, and its peak; as `SurfaceReader.follow`."""
        process = self._process
        if process is not None:
            try:
                return process.read(warp)
            except ReadingLost as why:
                if self._ended:
                    raise
                self._give_up(why)
        surface = self._own.follow(warp)
        return surface, peak(surface)

    def notes(self) -> tuple[str, ...]:
        """News for the operator, each once; to be called in every step."""
        process, note = self._process, self._note
        if process is not None:
            process.give_up_if_late()
        self._note = ""
        return (note,) if note else ()

    def _give_up(self, why: ReadingLost) -> None:
        self._process = None
        self._note = (
            f"the process that reads surfaces is lost ({why}): the run's own process reads now, slower"
        )


def _reads(rig: Rig, grid: NodeGrid) -> Callable[[Warp], tuple[Surface, Peak]]:
    reader = SurfaceReader(rig, Optics(rig), grid)

    def read(warp: Warp) -> tuple[Surface, Peak]:
        surface = reader.follow(warp)
        return surface, peak(surface)

    return read


def _serve(
    exchange: ArrayExchange, reads: Callable[[Rig, NodeGrid], Callable[[Any], object]], keeps: bool
) -> None:
    requests = sys.stdin.buffer
    with take_output() as answers:
        read: Callable[[Any], object] | None = None
        setting: Any = None
        while True:
            first, part, request = exchange.receive(requests, copied=keeps or setting is None)
            setting = first or setting
            answer: object
            try:
                read = read or reads(*setting)
                answer = read(request)
            except Exception as error:
                error.add_note(f"In the process that reads surfaces: {traceback.format_exc()}")
                answer = error
            exchange.send(answer, answers, 2 + part)
            lower_priority()  # not before the first one: the run waits for it


def main() -> None:
    """Warps come in at standard input, surfaces with their peaks go out at standard output."""
    serve(_reads)


def serve(reads: Callable[[Rig, NodeGrid], Callable[[Any], object]], keeps: bool = True) -> None:
    """Answer the requests at standard input at standard output, until nobody sends any more.

    reads: makes the function that answers, of rig and grid, which come with the first request. keeps: it may
    keep arrays of a request, or answer with them. The process's argument: the file descriptor of the memory
    for arrays.
    """
    ignore_signals()
    limit_threads()
    try:
        _serve(ArrayExchange(int(sys.argv[1]), _PARTS), reads, keeps)
    except (EOFError, BrokenPipeError):
        os._exit(0)  # the run is over, and nobody listens
