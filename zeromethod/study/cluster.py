"""Runs on a Dask cluster: the same tasks, the same outcomes, other machines."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

from zeromethod.errors import InputError, MeasurementError
from zeromethod.study.pool import killed
from zeromethod.study.runs import carry_out
from zeromethod.study.task import Message

_CONNECT_S = 10
_LOOK_S = 1.0


class Cluster:
    """Workers of a running Dask scheduler. As many runs are under way as there are workers."""

    def __init__(self, address: str) -> None:
        """address: of the scheduler, tcp://host:8786."""
        self.address = address

    def outcomes(self, tasks: Sequence[Message]) -> Iterator[Message]:
        """Outcome of every task, as they come.

        A run whose worker was lost is done again by the scheduler. One that the scheduler gives up (its
        setting `distributed.scheduler.allowed-failures`) is tried once more by itself at the end, as it may
        only have been there when another one killed the worker; then it has failed. Raises InputError where
        the cluster cannot be reached or has another zeromethod, MeasurementError where it is lost.
        """
        with self._client() as client:
            suspects: list[Message] = []
            for task, outcome in _done(client, tasks, alone=False):
                if outcome is None:
                    suspects.append(task)
                else:
                    yield outcome
            for task, outcome in _done(client, suspects, alone=True):
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
            self._check_versions(client)
            yield client
        finally:
            client.close(timeout=2)

    def _check_versions(self, client: Any) -> None:
        """Refuse workers that would not compute the same."""
        ours = version("zeromethod")
        for worker, theirs in client.run(_version, on_error="return").items():
            if theirs != ours:
                told = theirs if isinstance(theirs, str) else "none that can be imported"
                raise InputError(
                    f"--cluster: {self.address}: worker {worker} has zeromethod {told}: {ours}, as here"
                )


def _version() -> str:
    return version("zeromethod")


def _done(client: Any, tasks: Sequence[Message], *, alone: bool) -> Iterator[tuple[Message, Message | None]]:
    """Tasks and their outcomes, None where the scheduler gave a task up; `alone`: one after the other."""
    import distributed  # noqa: PLC0415

    wait: Any = distributed.wait
    waiting = deque(tasks)
    under_way: dict[Any, Message] = {}
    try:
        while waiting or under_way:
            room = 1 if alone else max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
            while waiting and len(under_way) < room:
                task = waiting.popleft()
                under_way[client.submit(carry_out, task, pure=False)] = task
            try:
                with client.as_current():
                    done = wait(list(under_way), timeout=_LOOK_S, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                done = ()
            if client.status not in {"running", "connecting"}:
                raise MeasurementError("the cluster is lost")
            for future in done:
                task = under_way.pop(future)
                if future.status == "finished":
                    yield task, future.result()
                elif isinstance(error := future.exception(), distributed.KilledWorker):
                    yield task, None
                elif future.status == "cancelled":
                    raise MeasurementError("the cluster is lost")
                else:
                    yield task, killed(task, f"{type(error).__name__}: {error}")
    finally:
        for future in under_way:
            future.cancel()
