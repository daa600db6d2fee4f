"""Worker processes that die, hang or do not start, and studies that are stopped."""

import itertools
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
from hanging import SOON_S, eventually

from zeromethod.errors import MeasurementError
from zeromethod.study import Study, Workers, run_study, workers
from zeromethod.study.tasks import tasks

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")
Squares = Callable[..., Study]


def test_runs_that_kill_their_worker_or_hang_fail_alone(squares, tmp_path):
    study = squares(6, "kills_at = 3", "waits_at = 1", f'mark = "{tmp_path / "waiting"}"', limit_s=4.0)
    started = time.monotonic()
    results = run_study(study, tmp_path, Workers(1))
    # the run that hangs would take ten minutes
    assert time.monotonic() - started < 200.0
    assert [(row["run"], row["failure"]) for row in results.failures] == [
        (1, "took longer than limit_s = 4 s, and was ended"),
        (3, "ended its process 3 times: signal 9"),
    ]
    assert all(row["seed"] > 0 for row in results.failures)
    assert [row["square"] for row in results.rows if row["run"] not in {1, 3}] == [0, 4, 16, 25]


def test_a_worker_is_started_again_however_soon_the_cluster_would_give_it_up(squares, tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_START_S", 20.0)
    study = squares(4, "kills_at = 1")
    # by default 15 s: the worker is not to be down at that time after any of its deaths
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "1ms"}):
        results = run_study(study, tmp_path, Workers(1))
    assert [row["run"] for row in results.failures] == [1]
    assert [row["square"] for row in results.rows if row["run"] != 1] == [0, 4, 9]


def test_a_scheduler_that_is_slow_or_forgets_its_workers_fails_no_run(squares, tmp_path, monkeypatch):
    known, result, calls = distributed.Client.nthreads, distributed.Future.result, itertools.count()

    def nthreads(client: Any) -> Any:
        if (call := next(calls)) % 3 == 0:
            raise TimeoutError
        return known(client) if call % 3 == 1 else {}

    def late(future: Any, timeout: float) -> Any:
        if next(calls) % 2:
            raise TimeoutError
        return result(future, timeout)

    monkeypatch.setattr(distributed.Client, "nthreads", nthreads)
    monkeypatch.setattr(distributed.Future, "result", late)
    monkeypatch.setattr(workers, "_POLL_S", 0.01)
    results = run_study(squares(20), tmp_path, Workers(2))
    assert results.failures == []
    assert [row["square"] for row in results.rows] == [x * x for x in range(20)]


def test_workers_listen_on_loopback_alone_and_end_at_once_when_the_study_does(squares, tmp_path):
    mark = tmp_path / "waiting"
    study = squares(4, "waits_at = 3", f'mark = "{mark}"')
    pids = set()
    with closing(Workers(1).outcomes(tasks(study))) as outcomes:
        for _ in range(3):
            pids.add(next(outcomes)["worker"]["pid"])
        ports = [
            one.laddr.ip
            for pid in (os.getpid(), *pids)
            for one in psutil.Process(pid).net_connections("tcp")
            if one.status == psutil.CONN_LISTEN
        ]
        assert set(ports) == {"127.0.0.1"}
        # the fourth run is handed over when the next outcome is asked for, and takes ten minutes
        with pytest.raises(KeyboardInterrupt), _within(60.0, mark):
            next(outcomes)
        started = time.monotonic()
    assert time.monotonic() - started < 20.0
    eventually(lambda: all(_ended(pid) for pid in pids), SOON_S)


def _ended(pid: int) -> bool:
    """Whether a process is gone, or only waits for its parent to ask how it ended."""
    try:
        return bool(psutil.Process(pid).status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True


def test_workers_that_cannot_start_are_reported(squares, tmp_path, monkeypatch):
    study = squares()
    (tmp_path / "sitecustomize.py").write_text("raise SystemExit('no such package')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(MeasurementError, match="worker processes do not start: exit code 1"):
        list(Workers(2).outcomes(tasks(study)))


@pytest.fixture
def empty(own: None) -> Iterator[Any]:
    """A scheduler without workers."""
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running


def test_a_cluster_without_workers_is_reported_and_goes_on_when_one_comes(empty, squares, tmp_path):
    reported_s: list[float] = []
    lines: list[str] = []

    def report(line: str) -> None:
        reported_s.append(time.monotonic() - started)
        lines.append(line)
        threading.Thread(target=empty.scale, args=(1,)).start()

    study = squares(4, "waits_at = 2", f'mark = "{tmp_path / "waiting"}"', limit_s=5.0)
    started = time.monotonic()
    results = run_study(study, tmp_path, Workers(address=empty.scheduler_address, report=report))
    address = empty.scheduler_address
    assert lines == [f"--cluster: {address}: no worker yet, waiting for one: dask worker {address}"]
    assert reported_s[0] < 30.0
    # the run that hangs is given up, and those after it find a worker
    assert [(row["run"], row["failure"]) for row in results.failures] == [
        (2, "took longer than limit_s = 5 s, and was ended")
    ]
    assert [row["square"] for row in results.rows if row["run"] != 2] == [0, 1, 9]
    assert time.monotonic() - started < 200.0


class _within:  # noqa: N801 - reads as words
    """Interrupt what waits once a file is there (or after so many seconds)."""

    def __init__(self, seconds: float, mark: Path) -> None:
        self._until, self._mark = time.monotonic() + seconds, mark

    def _look(self, number: int, frame: object) -> None:
        if self._mark.exists() or time.monotonic() > self._until:
            raise KeyboardInterrupt

    def __enter__(self) -> None:
        self._before = signal.signal(signal.SIGALRM, self._look)
        signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        with suppress(ValueError):
            signal.signal(signal.SIGALRM, self._before)
