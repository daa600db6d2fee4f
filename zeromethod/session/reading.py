"""Steps read into surfaces, and published: at once, or live in a thread that is a few steps late at most."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from operator import or_
from typing import TypedDict

import numpy as np

from zeromethod.contact import Contact, ContactFigures
from zeromethod.loop.step import Step
from zeromethod.rubbing import ContactStatus
from zeromethod.session.outputs import StepPublisher
from zeromethod.surface import Peak, Surface
from zeromethod.surface.comparison import Comparison
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp
from zeromethod.worker import SameThread, Worker


class Read(TypedDict, total=False):
    """What reading fills in of a step; all of it goes on to the step at which it is ready."""

    surface: Surface
    peak: Peak
    contacts: tuple[Contact, ...]
    touching: tuple[ContactFigures, ...]
    total_force_n: float
    sigma_total_force_n: float
    contact_status: ContactStatus | None
    truth: Comparison
    untouched_rms_nm: tuple[float, float]
    read_ms: float
    latency_ms: float


CLOSING_S = 0.3
"""How long after the end of a run steps that wait are still read, and how long it waits for the last one."""

WAITING_STEPS = 8
"""Steps that wait to be read, at most: at 60 Hz as long as a reading takes that must begin from rest."""


def first_warp(rest: Rest) -> Warp:
    """A warp of the mirror at rest, which a process that reads is given first: it answers when it is ready.

    It changes the reader's weights: whoever reads a session again starts with it, too.
    """
    return Warp(rest.q, np.full_like(rest.q, 0.01), rest.flags, 0)


class StepReader:
    """Reads steps that were measured, and publishes all: at once, or live in a thread of its own.

    Live, `WAITING_STEPS` wait for a reading that takes longer than the time between two frames; where these
    do not suffice, the last of them is replaced by a newer one and goes unread. The loop never waits.
    """

    def __init__(
        self,
        read: Callable[[Step], Step],
        publisher: StepPublisher | None,
        live: bool,
        now_ns: Callable[[], int] | None = None,
        begin: Callable[[Step], None] | None = None,
        follow: Callable[[Step], Step] | None = None,
    ) -> None:
        """Begin. now_ns: the clock of the steps, by which surfaces are late; None: not to be known.

        begin: is given each measured step in its turn, once, before it is read; the next one, too, if it
        waits already. follow: is given all steps before they are published, with what was read.
        """
        self._read = read
        self._begin, self._follow = begin, follow
        self._begun: set[int] = set()
        self._publisher = publisher
        self._now_ns = now_ns
        self._until_s = float("inf")
        self._worker: Worker[dict[bool, Step], list[Step]] | SameThread[dict[bool, Step], list[Step]]
        if live:
            self._worker = Worker(
                "read surface", lambda: nullcontext(self._serve), waiting=WAITING_STEPS, merge=or_
            )
        else:
            self._worker = SameThread(lambda: nullcontext(self._serve))

    def post(self, step: Step) -> None:
        """Read a step next, and publish it. Live, it returns at once; raises what a reading raised."""
        self._worker.raise_failure()
        self._worker.post({step.measured is not None: step})

    def collect(self) -> list[Step]:
        """Steps with their surfaces, finished since the last call, in order; raises what a reading raised."""
        return [reading for readings in self._worker.take() for reading in readings]

    def close(self) -> None:
        """Read what waits, as far as `CLOSING_S` goes, and publish the rest; raises what a reading raised."""
        self._until_s = time.monotonic() + CLOSING_S
        self._worker.close(2.0 * CLOSING_S, finish=True)
        self._worker.raise_failure()

    def _serve(self, steps: dict[bool, Step]) -> list[Step]:
        readings = []
        for step in sorted(steps.values(), key=lambda step: step.number):
            if step.measured is not None:
                if time.monotonic() > self._until_s and step.number not in self._begun:
                    continue
                self._begin_with_next(step)
                step = self._read(step)  # noqa: PLW2901 - the same step, with its surface
            if self._follow is not None:
                step = self._follow(step)  # noqa: PLW2901 - as above
            if self._publisher is not None:
                self._publisher.publish(step)
            if step.measured is not None:
                if self._now_ns is not None:
                    step = replace(step, latency_ms=1e-6 * (self._now_ns() - step.time_ns))  # noqa: PLW2901
                readings.append(step)
        return readings

    def _begin_with_next(self, step: Step) -> None:
        """Begin a step, if it was not, and the one after it, if that waits."""
        if self._begin is None:
            return
        waiting = [one[True] for one in self._worker.first_waiting if True in one]
        for one in (step, *waiting):
            if one.number not in self._begun:
                self._begun.add(one.number)
                self._begin(one)
        self._begun.remove(step.number)


def timed(read: Callable[[], tuple[Surface, Peak]]) -> tuple[Surface, Peak, float]:
    """Surface, its peak, and how long the reading took, ms."""
    started = time.perf_counter()
    surface, deepest = read()
    return surface, deepest, 1e3 * (time.perf_counter() - started)


def with_reading(step: Step, read: Step | None) -> Step:
    """The step with the newest reading."""
    if read is None:
        return step
    if read.number == step.number:
        return replace(read, notes=step.notes, pointers=step.pointers)
    return replace(step, **{name: getattr(read, name) for name in Read.__annotations__})


def rms_nm(surface: Surface) -> float:
    """Depth of the valid nodes, rms, nm."""
    depth_mm = surface.depth_mm[surface.valid]
    return 1e6 * float(np.sqrt(np.mean(depth_mm**2))) if depth_mm.size else float("nan")
