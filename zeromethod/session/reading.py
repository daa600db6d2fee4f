"""From a step's warp to depth: in turn, or in a thread beside the loop that reads the newest only."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zeromethod.loop.step import Step
from zeromethod.publishing.publisher import Publisher
from zeromethod.session.truth import Comparison
from zeromethod.surface import Peak, Surface
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

CLOSING_S = 0.4
"""How long the end of a run waits for the reading under way."""


def warm_up_warp(rest: Rest) -> Warp:
    """A made-up warp to read before the first real one, which then waits for no code to be compiled.

    It leaves its mark on the reader's weights: who reads a session again begins with it, too.
    """
    return Warp(rest.q, np.full_like(rest.q, 0.01), rest.flags, 0)


@dataclass(frozen=True)
class Reading:
    """What was read from one step. read_ms: how long it took. truth, untouched_rms_nm: see `FrameRecord`."""

    step: Step
    surface: Surface
    peak: Peak
    read_ms: float
    truth: Comparison | None = None
    untouched_rms_nm: tuple[float, float] | None = None


class ReadInTurn:
    """Reads every step at once."""

    def __init__(self, read: Callable[[Step], Reading], publisher: Publisher | None) -> None:
        self._read = read
        self._publisher = publisher
        self._done: list[Reading] = []

    def post(self, step: Step) -> None:
        """Read a step, if it was measured, and publish it."""
        reading = None if step.measured is None else self._read(step)
        if reading is not None:
            self._done.append(reading)
        if self._publisher is not None:
            self._publisher.publish(step, None if reading is None else (reading.surface, reading.peak))

    def collect(self) -> list[Reading]:
        """Readings since the last call."""
        done, self._done = self._done, []
        return done

    def close(self) -> None:
        """Nothing is under way."""


class ReadInThread:
    """Reads and publishes in a thread of its own. A step that was not yet begun is replaced by the next.

    What is replaced goes unread: the loop never waits, and nothing queues. A step without a measurement does
    not replace one with: it is published before it.
    """

    def __init__(self, read: Callable[[Step], Reading], publisher: Publisher | None) -> None:
        self._in_turn = ReadInTurn(read, publisher)
        self._publisher = publisher
        self._changed = threading.Condition()
        self._measured: Step | None = None
        self._other: Step | None = None
        self._done: list[Reading] = []
        self._error: BaseException | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="read surface", daemon=True)
        self._thread.start()

    def post(self, step: Step) -> None:
        """Read a step next, and publish it. Returns at once; raises what an earlier reading raised."""
        self._raise()
        with self._changed:
            if step.measured is not None:
                self._measured = step
            else:
                self._other = step
            self._changed.notify_all()

    def collect(self) -> list[Reading]:
        """Readings finished since the last call, in order."""
        with self._changed:
            done, self._done = self._done, []
            return done

    def close(self) -> None:
        """Finish what was posted, for `CLOSING_S` at most; raises what reading raised, if not yet told."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join(CLOSING_S)
        self._raise()

    def _raise(self) -> None:
        with self._changed:
            error, self._error = self._error, None
        if error is not None:
            raise error

    def _serve(self) -> None:
        try:
            while steps := self._await():
                for step in steps:
                    self._in_turn.post(step)
                with self._changed:
                    self._done += self._in_turn.collect()
        except BaseException as error:  # whatever it is, it belongs to the thread of the run
            with self._changed:
                self._error = error

    def _await(self) -> list[Step]:
        with self._changed:
            self._changed.wait_for(lambda: self._measured or self._other or self._closed)
            steps = [step for step in (self._other, self._measured) if step is not None]
            self._other = self._measured = None
            return sorted(steps, key=lambda step: step.number)


def timed(read: Callable[[], tuple[Surface, Peak]]) -> tuple[Surface, Peak, float]:
    """Surface, its peak, and how long the reading took, ms."""
    started = time.perf_counter()
    surface, deepest = read()
    return surface, deepest, 1e3 * (time.perf_counter() - started)
