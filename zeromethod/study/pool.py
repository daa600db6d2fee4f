"""Runs in processes of this machine. A process that dies costs nothing but its run, which is done again."""

from __future__ import annotations

import contextlib
import json
import math
import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

from zeromethod.errors import MeasurementError
from zeromethod.study.runs import QUIET
from zeromethod.study.task import Message

ATTEMPTS = 3
"""How often a run may kill its worker before it is given up."""

_CHUNK = 1 << 20


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalPool:
    """So many worker processes, each a fresh interpreter with one thread per library."""

    def __init__(self, workers: int | None = None) -> None:
        self.size = workers or cores()

    def outcomes(self, tasks: Sequence[Message]) -> Iterator[Message]:
        """Outcome of every task, as they come.

        Closing the iterator, or an exception in the caller, ends all workers at once. Raises MeasurementError
        where workers die before they have begun.
        """
        crew = _Crew(self.size, tasks)
        try:
            while crew.busy:
                crew.employ()
                yield from crew.listen()
        finally:
            crew.end()


class _Crew:
    """The workers of one study and what is left to do."""

    def __init__(self, size: int, tasks: Sequence[Message]) -> None:
        self._size = size
        self._waiting = deque(tasks)
        self._deaths: Counter[int] = Counter()
        self._failed_starts = 0
        self._workers: list[_Worker] = []
        self._selector = selectors.DefaultSelector()

    @property
    def busy(self) -> bool:
        """Whether there is something to do or to wait for."""
        return bool(self._waiting) or any(worker.task is not None for worker in self._workers)

    def employ(self) -> None:
        """Start the workers that are missing, and give work to those that have none."""
        free = sum(worker.task is None for worker in self._workers)
        for _ in range(min(self._size - len(self._workers), len(self._waiting) - free)):
            worker = _Worker()
            self._workers.append(worker)
            self._selector.register(worker.answers, selectors.EVENT_READ, worker)
        for worker in self._workers:
            if worker.ready and worker.task is None and self._waiting:
                worker.give(self._waiting.popleft())

    def listen(self) -> Iterator[Message]:
        """Wait until a worker says something or dies; outcomes that came of it."""
        for key, _ in self._selector.select(self._patience_s()):
            worker: _Worker = key.data
            said, alive = worker.heard()
            for outcome in said:
                worker.task = None
                yield outcome
            if not alive:
                yield from self._bury(worker)
        for worker in [one for one in self._workers if one.left_s <= 0.0]:
            yield self._give_up(worker)

    def _patience_s(self) -> float | None:
        """Until the next run has taken too long; None: all have time without end."""
        left_s = min((worker.left_s for worker in self._workers), default=math.inf)
        return max(left_s, 0.0) if math.isfinite(left_s) else None

    def _give_up(self, worker: _Worker) -> Message:
        """End a worker whose run takes too long; the run's outcome."""
        self._selector.unregister(worker.answers)
        self._workers.remove(worker)
        worker.end()
        assert worker.task is not None
        return overdue(worker.task)

    def _bury(self, worker: _Worker) -> Iterator[Message]:
        """Take a dead worker's run back, or give it up."""
        self._selector.unregister(worker.answers)
        self._workers.remove(worker)
        reason = worker.buried()
        if not worker.ready:
            self._failed_starts += 1
            if self._failed_starts >= ATTEMPTS:
                raise MeasurementError(f"worker processes do not start: {reason}")
        task = worker.task
        if task is None:
            return
        self._deaths[task["run"]] += 1
        if self._deaths[task["run"]] < ATTEMPTS:
            self._waiting.appendleft(task)
        else:
            yield killed(task, f"ended its process {ATTEMPTS} times: {reason}")

    def end(self) -> None:
        """End all workers, whatever they are at."""
        for worker in self._workers:
            worker.end()
        self._selector.close()


def killed(task: Message, why: str) -> Message:
    """Outcome of a run that nobody came back from."""
    return {
        "run": task["run"],
        "seed": task["seed"],
        "figures": None,
        "failure": why,
        "seconds": None,
        "worker": None,
    }


def overdue(task: Message) -> Message:
    """Outcome of a run that took too long."""
    return killed(task, f"took longer than limit_s = {task['limit_s']:g} s, and was ended")


class _Worker:
    """One worker process, with the task that it is at."""

    def __init__(self) -> None:
        # a session of its own: Ctrl-C reaches the study, which ends its workers
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the worker
        self._process = subprocess.Popen(
            [sys.executable, "-m", "zeromethod.study.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=os.environ | QUIET | {"PYTHONFAULTHANDLER": "1"},
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self.answers = self._process.stdout
        self.task: Message | None = None
        self.ready = False
        self._given_s = 0.0
        self._unread = b""

    def give(self, task: Message) -> None:
        """Hand over a task. A worker that has just died is found out when it is listened to."""
        self.task = task
        self._given_s = time.monotonic()
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(task).encode() + b"\n")
            self._process.stdin.flush()

    @property
    def left_s(self) -> float:
        """Time left for its run, s; without end where it has none."""
        if self.task is None:
            return math.inf
        return float(self.task["limit_s"]) - (time.monotonic() - self._given_s)

    def heard(self) -> tuple[list[Message], bool]:
        """Outcomes that came in, and whether more may come."""
        chunk = os.read(self.answers.fileno(), _CHUNK)
        *lines, self._unread = (self._unread + chunk).split(b"\n")
        said: list[dict[str, Any]] = [json.loads(line) for line in lines]
        if any("ready" in one for one in said):
            self.ready = True
        return [one for one in said if "ready" not in one], bool(chunk)

    def buried(self) -> str:
        """Why it died, in words."""
        code = self._process.wait()
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        self._close()
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"{how}: {lines[-1].strip()}" if lines and code > 0 else how

    def end(self) -> None:
        """End it, whatever it is at."""
        self._process.kill()
        self._process.wait()
        self._close()

    def _close(self) -> None:
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
