"""Runs on Dask workers: processes of this machine, or those of a running cluster."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing.resource_tracker
import os
import re
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from zeromethod.errors import InputError, MeasurementError
from zeromethod.study.runs import ONE_THREAD, Outcome, carry_out, failed
from zeromethod.study.task import Task

_NO_PAGES: dict[str, Any] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}

ATTEMPTS = 3
"""How often a run may end its worker process before it is given up."""

_CONNECT_S = 10
_RESULT_S = 10
_POLL_S = 0.5
_REPORT_S = 3.0
"""Time without any worker after which that is reported."""
_START_S = 60.0
"""Time without any worker after which processes of this machine are given up."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Workers:
    """Worker processes that carry out one run at a time each.

    count: processes of this machine (one per core). address: of a running Dask scheduler, tcp://host:8786,
    whose workers are used instead. report: called with a line for a person.
    """

    count: int | None = None
    address: str | None = None
    report: Callable[[str], None] = lambda _: None

    def check(self) -> None:
        """Raise InputError where Dask is not installed or the cluster cannot be reached."""
        _distributed()
        if self.address is not None:
            _connect(self.address).close(timeout=2)

    def outcomes(self, tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        """Outcome of every task, as they come.

        A run whose worker dies is done again, ATTEMPTS times in all; one that takes longer than its
        `limit_s` is given up, and its worker process restarted. Closing the iterator ends the processes of
        this machine. Raises InputError where the cluster cannot be reached or has another version of
        zeromethod, MeasurementError where it is lost, or where processes do not start.
        """
        exits = _Exits()
        with ExitStack() as stack:
            address = self.address or stack.enter_context(_local_cluster(self.count or cores(), exits))
            client = _connect(address)
            stack.callback(client.close, timeout=2)
            yield from _Assignment(client, self, exits).outcomes(tasks)


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError("study: needs Dask: pip install 'zeromethod[study]'") from None
    return distributed


def _connect(address: str) -> Any:
    """Client of a scheduler. Raises InputError, one line, where none answers."""
    connect = _distributed().Client
    try:
        return connect(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--cluster: {address}: no Dask scheduler answers "
            f"({str(error) or type(error).__name__}): an address such as tcp://host:8786"
        ) from None


class _Exits(logging.Handler):
    """How worker processes of this machine ended, by process id, as their nanny logs it."""

    def __init__(self) -> None:
        super().__init__()
        self.by_pid: dict[int, str] = {}

    def emit(self, record: logging.LogRecord) -> None:
        said = re.match(r"Worker process (\d+) .* (signal -?\d+|status \d+)$", record.getMessage())
        if said:
            self.by_pid[int(said[1])] = said[2].replace("status", "exit code")


@contextmanager
def _local_cluster(count: int, exits: _Exits) -> Iterator[str]:
    """Address of a scheduler in this process with `count` worker processes; all listen on loopback only.

    Workers end with this process, even where it is killed. Raises MeasurementError where they do not start.
    """
    distributed = _distributed()
    import dask  # noqa: PLC0415 - an extra

    nanny = logging.getLogger("distributed.nanny")
    nanny.addHandler(exits)
    nanny.setLevel(logging.INFO)
    # what is set before a worker starts is set in this process too, whose numba must not see it change
    before_start = {name: value for name, value in ONE_THREAD.items() if not name.startswith("NUMBA")}
    in_worker = ONE_THREAD | {"PYTHONFAULTHANDLER": "1"}
    # Ctrl-C in the terminal is for the study alone, which ends its workers: they inherit the blocked signal
    # (starting the tracker would unblock it)
    multiprocessing.resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        with dask.config.set(
            {
                "distributed.nanny.pre-spawn-environ": before_start,
                "distributed.nanny.environ": in_worker,
                **_NO_PAGES,
            }
        ):
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                memory_limit=0,
                silence_logs=logging.CRITICAL + 1,
            )
    except (OSError, RuntimeError, TimeoutError) as error:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        nanny.removeHandler(exits)
        why = ", ".join(sorted(set(exits.by_pid.values()))) or " ".join(str(error).split())
        raise MeasurementError(f"worker processes do not start: {why}") from None

    async def end_workers() -> None:
        nannies = list(cluster.workers.values())
        closed = [asyncio.ensure_future(one.close()) for one in nannies]
        await asyncio.sleep(0)
        # the nannies do not restart them any more; by themselves, workers would end their runs first
        for one in nannies:
            if one.process is not None and one.process.status.name in {"running", "stopping"} and one.pid:
                os.kill(one.pid, signal.SIGKILL)
        await asyncio.gather(*closed)

    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield cluster.scheduler_address
    finally:
        with contextlib.suppress(TimeoutError):
            cluster.sync(end_workers)
        cluster.close()
        nanny.removeHandler(exits)


@dataclass(frozen=True)
class _Attempt:
    """A run that a worker is at. worker: address. since_s: when it was given, monotonic time."""

    task: Task
    worker: str
    since_s: float


class _Assignment:
    """Tasks on their way through a cluster, one at a time for each worker."""

    def __init__(self, client: Any, workers: Workers, exits: _Exits) -> None:
        self._client = client
        self._address, self._report = workers.address, workers.report
        self._exits = exits
        self._pids: dict[str, int] = {}
        self._ending: set[str] = set()
        self._deaths: Counter[int] = Counter()
        self._waiting: deque[Task] = deque()
        self._alone_since_s: float | None = None
        self._reported = False

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        """Outcome of every task, as they come."""
        self._waiting.extend(tasks)
        under_way: dict[Any, _Attempt] = {}
        try:
            while self._waiting or under_way:
                before = dict(self._pids)
                present = self._present()
                for future, attempt in list(under_way.items()):
                    if attempt.worker not in present:
                        del under_way[future]
                        future.cancel()
                        yield from self._died(attempt.task, before[attempt.worker])
                busy = {attempt.worker for attempt in under_way.values()}
                for worker in sorted(present - busy - self._ending)[: len(self._waiting)]:
                    task = self._waiting.popleft()
                    future = self._client.submit(carry_out, task, workers=[worker], pure=False)
                    under_way[future] = _Attempt(task, worker, time.monotonic())
                for future in self._finished(list(under_way)):
                    try:
                        found = list(self._outcome(under_way[future], future))
                    except TimeoutError:
                        continue  # a slow machine: asked for again, unless its worker turns out to be dead
                    del under_way[future]
                    yield from found
                for future, attempt in list(under_way.items()):
                    if time.monotonic() - attempt.since_s > attempt.task.limit_s:
                        del under_way[future]
                        future.cancel()
                        self._end(attempt.worker)
                        limit = f"{attempt.task.limit_s:g} s"
                        yield failed(attempt.task, f"took longer than limit_s = {limit}, and was ended")
        finally:
            for future in under_way:
                future.cancel()

    def _finished(self, futures: list[Any]) -> set[Any]:
        """Futures that are done, after a short wait for the first."""
        if not futures:
            time.sleep(_POLL_S)
            return set()
        wait: Any = _distributed().wait
        try:
            with self._client.as_current():
                done: set[Any] = wait(futures, timeout=_POLL_S, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            return set()
        return done

    def _outcome(self, attempt: _Attempt, future: Any) -> Iterator[Outcome]:
        """Outcome of a finished future; none where the run is done again. Raises TimeoutError."""
        if future.status == "cancelled":
            raise MeasurementError("the cluster is lost")
        try:
            yield future.result(timeout=_RESULT_S)
        except TimeoutError:
            raise
        except _distributed().KilledWorker:
            yield from self._died(attempt.task, self._pids.get(attempt.worker, 0))
        except Exception as error:  # whatever keeps a worker from it: the other runs go on
            yield failed(attempt.task, f"{type(error).__name__}: {error}")

    def _died(self, task: Task, pid: int) -> Iterator[Outcome]:
        """Take the run of a dead worker back, or give it up."""
        self._deaths[task.run] += 1
        if self._deaths[task.run] < ATTEMPTS:
            self._waiting.appendleft(task)
        else:
            reason = self._exits.by_pid.get(pid)
            yield failed(task, f"ended its process {ATTEMPTS} times" + (f": {reason}" if reason else ""))

    def _end(self, worker: str) -> None:
        """End a worker process, which its nanny restarts; without a nanny it stays, and is given nothing."""
        self._ending.add(worker)
        with contextlib.suppress(Exception):
            self._client.run(os.kill, self._pids[worker], signal.SIGKILL, workers=[worker], nanny=True)

    def _present(self) -> set[str]:
        """Addresses of the workers, new ones checked; that there is none is reported."""
        if self._client.status not in {"running", "connecting"}:
            raise MeasurementError("the cluster is lost")
        present = set(self._client.scheduler_info(n_workers=-1)["workers"])
        self._pids = {worker: pid for worker, pid in self._pids.items() if worker in present}
        self._ending &= present
        if new := present - self._pids.keys():
            self._check(sorted(new))
        if self._pids:
            self._alone_since_s, self._reported = None, False
        elif self._alone_since_s is None:
            self._alone_since_s = time.monotonic()
        else:
            self._report_none(time.monotonic() - self._alone_since_s)
        return set(self._pids)

    def _report_none(self, seconds: float) -> None:
        """Report once that there has been no worker for so long."""
        if self._address is None and seconds >= _START_S:
            raise MeasurementError("worker processes do not start again")
        if self._address is not None and seconds >= _REPORT_S and not self._reported:
            self._reported = True
            self._report(
                f"--cluster: {self._address}: no worker yet, waiting for one: dask worker {self._address}"
            )

    def _check(self, workers: list[str]) -> None:
        """Note the process ids of new workers; refuse those that would not compute the same."""
        ours = version("zeromethod")
        for worker, found in self._client.run(_identity, workers=workers, on_error="return").items():
            if isinstance(found, OSError):
                continue  # gone meanwhile
            theirs, pid = found if isinstance(found, tuple) else ("none that can be imported", 0)
            if theirs != ours:
                raise InputError(f"--cluster: worker {worker} has zeromethod {theirs}: {ours}, as here")
            self._pids[worker] = pid


def _identity() -> tuple[str, int]:
    """Version of zeromethod and process id of a worker."""
    return version("zeromethod"), os.getpid()
