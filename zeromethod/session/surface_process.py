"""Reading surfaces in a process of its own, which shares no interpreter with the loop."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from typing import Any

from zeromethod.child_process import ignore_signals, lower_priority, start_process, take_output
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.surface.peak import Peak, peak
from zeromethod.surface.reader import SurfaceReader
from zeromethod.surface.surface import Surface
from zeromethod.thread_limits import limit_threads
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

PATIENCE_S = 5.0
"""How long a reading may take before its process is given up; it takes some 20 ms."""


class ReadingLost(Exception):
    """The process that reads surfaces is gone; why, in words."""


class SurfaceProcess:
    """A `SurfaceReader` in a process of its own: of the same warps in turn the same readings, bit for bit."""

    def __init__(self, rig: Rig, grid: NodeGrid) -> None:
        """Start it; `read` waits until it has started. Raises ReadingLost where it cannot be."""
        self._turn = threading.Lock()
        self._asked_s: float | None = None
        self._why = ""
        try:
            self._process = start_process(__name__, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        except OSError as error:
            raise ReadingLost(f"it does not start: {error.strerror}") from None
        self._setting: tuple[Rig, NodeGrid] | None = rig, grid

    @property
    def process_id(self) -> int:
        """As the system numbers it."""
        return self._process.pid

    def read(self, warp: Warp) -> tuple[Surface, Peak]:
        """Surface of a measured warp and its peak, as `SurfaceReader.read`, which see.

        Raises what reading raised; ReadingLost once the process has ended.
        """
        with self._turn:
            self._asked_s = time.monotonic()
            try:
                answer = self._ask(warp)
            finally:
                self._asked_s = None
        if isinstance(answer, Exception):
            raise answer
        surface, deepest = answer
        return surface, deepest

    def _ask(self, warp: Warp) -> Any:
        given, answers = self._process.stdin, self._process.stdout
        assert given is not None
        assert answers is not None
        try:
            if self._setting is not None:
                pickle.dump(self._setting, given, pickle.HIGHEST_PROTOCOL)
                self._setting = None
            pickle.dump(warp, given, pickle.HIGHEST_PROTOCOL)
            given.flush()
            return pickle.load(answers)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            raise ReadingLost(self._why or self._end()) from None

    def give_up_if_late(self) -> None:
        """End it where a reading takes longer than `PATIENCE_S`, which makes that raise ReadingLost."""
        asked_s = self._asked_s
        if asked_s is not None and time.monotonic() - asked_s > PATIENCE_S and not self._why:
            self._why = f"a reading took more than {PATIENCE_S:g} s"
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


def _serve() -> None:
    requests = sys.stdin.buffer
    with take_output() as answers:
        rig, grid = pickle.load(requests)
        reader: SurfaceReader | None = None
        while True:
            warp = pickle.load(requests)
            answer: object
            try:
                reader = reader or SurfaceReader(rig, Optics(rig), grid)
                surface = reader.read(warp)
                answer = surface, peak(surface)
            except Exception as error:
                error.add_note(f"In the process that reads surfaces: {traceback.format_exc()}")
                answer = error
            pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
            answers.flush()
            lower_priority()  # not before the first one: the run waits for it


def main() -> None:
    """Settings, then warps come in at standard input, surfaces with their peaks go out at standard output."""
    ignore_signals()
    limit_threads()
    try:
        _serve()
    except (EOFError, BrokenPipeError):
        os._exit(0)  # the run is over, and nobody listens
