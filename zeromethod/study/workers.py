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

_LOCAL: dict[str, Any] = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # no worker of this machine is dropped for being slow, and none is sampled 100 times a second
    "distributed.scheduler.worker-ttl": None,
    "distributed.comm.timeouts.connect": "5 minutes",
    "distributed.worker.profile.enabled": False,
}

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

        A run whose worker process ends (of a cluster: leaves it) is done again, ATTEMPTS times in all; one
        that takes longer than its `limit_s` is given up, and its worker process restarted. Closing the
        iterator ends the processes of this machine. Raises InputError where the cluster cannot be reached or
        has another version of zeromethod, MeasurementError where it is lost, or processes do not start.
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
                **_LOCAL,
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
        # the cluster gives a worker up that is down so long after it died, be it for the second time
        with dask.config.set({"distributed.deploy.lost-worker-timeout": "365 days"}):
            yield cluster.scheduler_address
    finally:
        with contextlib.suppress(TimeoutError):
            cluster.sync(end_workers)
        cluster.close()
        nanny.removeHandler(exits)


@dataclass(frozen=True)
class _Attempt:
    """A run that a worker is at. worker: address. pid: of its process. since_s: start, monotonic time."""

    task: Task
    worker: str
    pid: int
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
        self._under_way: dict[Any, _Attempt] = {}
        self._alone_since_s: float | None = None
        self._reported = False

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        """Outcome of every task, as they come."""
        self._waiting.extend(tasks)
        look_s = 0.0
        try:
            while self._waiting or self._under_way:
                if time.monotonic() >= look_s:
                    self._look()
                    yield from self._given_up()
                    look_s = time.monotonic() + _POLL_S
                self._give()
                for future in self._finished():
                    yield from self._outcome(future)
        finally:
            for future in self._under_way:
                future.cancel()

    def _give(self) -> None:
        """Give a task to every worker that has none."""
        busy = {attempt.worker for attempt in self._under_way.values()} | self._ending
        free = [one for one in self._pids.items() if one[0] not in busy and one[1] not in self._exits.by_pid]
        for (worker, pid), _ in zip(free, list(self._waiting), strict=False):
            task = self._waiting.popleft()
            future = self._client.submit(carry_out, task, workers=[worker], pure=False)
            self._under_way[future] = _Attempt(task, worker, pid, time.monotonic())

    def _finished(self) -> set[Any]:
        """Futures that are done, after a short wait for the first."""
        if not self._under_way:
            time.sleep(_POLL_S)
            return set()
        wait: Any = _distributed().wait
        try:
            with self._client.as_current():
                done: set[Any] = wait(
                    list(self._under_way), timeout=_POLL_S, return_when="FIRST_COMPLETED"
                ).done
        except TimeoutError:
            return set()
        return done

    def _outcome(self, future: Any) -> Iterator[Outcome]:
        """Outcome of a finished future; none yet where its worker is slow to hand it over."""
        if future.status == "cancelled":
            raise MeasurementError("the cluster is lost")
        task = self._under_way[future].task
        try:
            outcome = future.result(timeout=_RESULT_S)
        except TimeoutError:
            return
        except Exception as error:  # whatever keeps a worker from it: the other runs go on
            outcome = failed(task, f"{type(error).__name__}: {error}")
        del self._under_way[future]
        yield outcome

    def _given_up(self) -> Iterator[Outcome]:
        """Outcomes of runs that took too long, or have lost their worker ATTEMPTS times."""
        for future, attempt in list(self._under_way.items()):
            task, exited = attempt.task, self._exits.by_pid.get(attempt.pid)
            gone = self._pids.get(attempt.worker) != attempt.pid
            # a process of this machine has died only when it is not there any more
            lost = exited or (gone and not (self._address is None and _exists(attempt.pid)))
            overdue = time.monotonic() - attempt.since_s > task.limit_s and not future.done()
            if not (lost or overdue):
                continue
            del self._under_way[future]
            future.cancel()
            if not lost:
                self._end(attempt)
                yield failed(task, f"took longer than limit_s = {task.limit_s:g} s, and was ended")
                continue
            self._deaths[task.run] += 1
            if self._deaths[task.run] < ATTEMPTS:
                self._waiting.appendleft(task)
            else:
                what = "ended its process" if self._address is None else "lost its worker"
                yield failed(task, f"{what} {ATTEMPTS} times" + (f": {exited}" if exited else ""))

    def _end(self, attempt: _Attempt) -> None:
        """End a worker process, which its nanny restarts; without a nanny it stays, and is given nothing."""
        self._ending.add(attempt.worker)
        with contextlib.suppress(Exception):
            self._client.run(os.kill, attempt.pid, signal.SIGKILL, workers=[attempt.worker], nanny=True)

    def _look(self) -> None:
        """Look which workers there are, check new ones, and report that there is none."""
        if self._client.status not in {"running", "connecting"}:
            raise MeasurementError("the cluster is lost")
        try:
            # not scheduler_info: the client replaces that by one without workers every two seconds
            present = set(self._client.nthreads())
        except OSError:
            return  # a slow scheduler: asked again
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
            self._exits.by_pid.pop(pid, None)


def _exists(pid: int) -> bool:
    """Whether a process of this machine is there."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def _identity() -> tuple[str, int]:
    """Version of zeromethod and process id of a worker."""
    return version("zeromethod"), os.getpid()
