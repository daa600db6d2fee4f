"""Runs on a Dask cluster: the same tasks, the same outcomes, other machines."""

from __future__ import annotations

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

from zeromethod.errors import InputError, MeasurementError
from zeromethod.study.pool import killed, overdue
from zeromethod.study.runs import carry_out
from zeromethod.study.task import Message

_CONNECT_S = 10
_LOOK_S = 1.0
_LONELY_S = 3.0
"""Without any worker for so long, that is told."""
_RESTART_S = 20


class Cluster:
    """Workers of a running Dask scheduler. As many runs are under way as there are workers."""

    def __init__(self, address: str, tell: Callable[[str], None] = lambda _: None) -> None:
        """address: of the scheduler, tcp://host:8786. tell: a line that a person should read."""
        self.address = address
        self._tell = tell

    def check(self) -> None:
        """Raise InputError where the cluster cannot be reached."""
        with self._client():
            pass

    def outcomes(self, tasks: Sequence[Message]) -> Iterator[Message]:
        """Outcome of every task, as they come.

        A run whose worker was lost is done again by the scheduler. One that the scheduler gives up (its
        setting `distributed.scheduler.allowed-failures`) is tried once more by itself at the end, as it may
        only have been there when another one killed the worker; then it has failed. So has one that takes
        longer than its `limit_s`; its worker is begun anew. Raises InputError where the cluster cannot be
        reached or has another zeromethod, MeasurementError where it is lost.
        """
        with self._client() as client:
            suspects: list[Message] = []
            work = _Work(client, self.address, self._tell)
            for task, outcome in work.done(tasks, alone=False):
                if outcome is None:
                    suspects.append(task)
                else:
                    yield outcome
            for task, outcome in work.done(suspects, alone=True):
                yield outcome or killed(task, "ended its worker again and again")

    @contextmanager
    def _client(self) -> Iterator[Any]:
        try:
            import distributed  # noqa: PLC0415 - an extra
        except ImportError:
            raise InputError("--cluster: needs Dask: pip install 'zeromethod[cluster]'") from None
        try:
            connect: Any = distributed.Client
            client = connect(self.address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--cluster: {self.address}: no Dask scheduler answers "
                f"({str(error) or type(error).__name__}): an address such as tcp://host:8786"
            ) from None
        try:
            yield client
        finally:
            client.close(timeout=2)


class _Work:
    """Tasks on their way through a cluster."""

    def __init__(self, client: Any, address: str, tell: Callable[[str], None]) -> None:
        self._client = client
        self._address = address
        self._tell = tell
        self._checked: set[str] = set()
        self._lonely_since: float | None = None

    def done(self, tasks: Sequence[Message], *, alone: bool) -> Iterator[tuple[Message, Message | None]]:
        """Tasks and outcomes, None where the scheduler gave a task up; `alone`: one after the other."""
        import distributed  # noqa: PLC0415 - an extra

        wait: Any = distributed.wait
        waiting = deque(tasks)
        under_way: dict[Any, tuple[Message, float]] = {}
        try:
            while waiting or under_way:
                workers = self._workers()
                while waiting and len(under_way) < min(workers, 1 if alone else workers):
                    task = waiting.popleft()
                    future = self._client.submit(carry_out, task, pure=False)
                    under_way[future] = task, time.monotonic()
                if not under_way:
                    time.sleep(_LOOK_S)
                    continue
                try:
                    with self._client.as_current():
                        done = wait(list(under_way), timeout=_LOOK_S, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    done = ()
                self._look_after()
                for future in done:
                    task, _ = under_way.pop(future)
                    yield task, _outcome(task, future)
                for future, (task, began_s) in list(under_way.items()):
                    if time.monotonic() - began_s > task["limit_s"]:
                        del under_way[future]
                        self._give_up(future)
                        yield task, overdue(task)
        finally:
            for future in under_way:
                future.cancel()

    def _look_after(self) -> None:
        if self._client.status not in {"running", "connecting"}:
            raise MeasurementError("the cluster is lost")

    def _workers(self) -> int:
        """Number of workers, new ones looked at; that there is none is told."""
        self._look_after()
        workers = set(self._client.scheduler_info(n_workers=-1)["workers"])
        if new := workers - self._checked:
            self._check(sorted(new))
        if workers:
            self._lonely_since = None
        elif self._lonely_since is None:
            self._lonely_since = time.monotonic()
        elif time.monotonic() - self._lonely_since >= _LONELY_S:
            self._lonely_since = math.inf  # told once each time
            self._tell(
                f"--cluster: {self._address}: no worker yet, waiting for one: dask worker {self._address}"
            )
        return len(workers)

    def _check(self, workers: list[str]) -> None:
        """Refuse workers that would not compute the same."""
        ours = version("zeromethod")
        for worker, theirs in self._client.run(_version, workers=workers, on_error="return").items():
            if isinstance(theirs, OSError):
                continue  # gone meanwhile
            if theirs != ours:
                told = theirs if isinstance(theirs, str) else "none that can be imported"
                raise InputError(
                    f"--cluster: {self._address}: worker {worker} has zeromethod {told}: {ours}, as here"
                )
            self._checked.add(worker)

    def _give_up(self, future: Any) -> None:
        """Forget a run that takes too long, and have the process that is at it begun anew."""
        key = future.key
        at = [worker for worker, keys in self._client.processing().items() if key in keys]
        future.cancel()
        # without a nanny it cannot be: such a worker stays at what hangs
        with contextlib.suppress(Exception):
            self._client.restart_workers(at, timeout=_RESTART_S, raise_for_error=False)


def _outcome(task: Message, future: Any) -> Message | None:
    """Outcome of a finished future; None: the scheduler gave it up."""
    import distributed  # noqa: PLC0415

    if future.status == "finished":
        found: Message = future.result()
        return found
    if future.status == "cancelled":
        raise MeasurementError("the cluster is lost")
    error = future.exception()
    return (
        None
        if isinstance(error, distributed.KilledWorker)
        else killed(task, f"{type(error).__name__}: {error}")
    )


def _version() -> str:
    return version("zeromethod")
