"""Worker processes that die, and studies that are stopped."""

import os
import signal
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest

from zeromethod.errors import MeasurementError
from zeromethod.study import LocalPool, Study, conduct
from zeromethod.study.tasks import tasks

Squares = Callable[..., Study]


def messages(study: Study) -> list[dict[str, Any]]:
    return [task.message() for task in tasks(study)]


def test_a_run_that_kills_its_worker_fails_alone(squares: Squares, tmp_path: Path) -> None:
    results = conduct(squares(8, "kills_at = 3"), tmp_path, LocalPool(2))
    assert [row["run"] for row in results.failures] == [3]
    assert results.failures[0]["failure"] == "ended its process 3 times: signal 9"
    assert results.failures[0]["seed"] > 0
    assert [row["square"] for row in results.rows if row["run"] != 3] == [0, 1, 4, 16, 25, 36, 49]


def test_a_run_that_hangs_is_given_up_and_the_others_go_on(squares: Squares, tmp_path: Path) -> None:
    study = squares(5, "waits_at = 1", f'mark = "{tmp_path / "waiting"}"', limit_s=4.0)
    started = time.monotonic()
    results = conduct(study, tmp_path, LocalPool(1))
    # the run itself would take a minute
    assert time.monotonic() - started < 40.0
    assert [(row["run"], row["failure"]) for row in results.failures] == [
        (1, "took longer than limit_s = 4 s, and was ended")
    ]
    assert [row["square"] for row in results.rows if row["run"] != 1] == [0, 4, 9, 16]


def test_workers_end_at_once_when_the_study_does(squares: Squares, tmp_path: Path) -> None:
    mark = tmp_path / "waiting"
    study = squares(4, "waits_at = 3", f'mark = "{mark}"')
    pids = set()
    with closing(LocalPool(1).outcomes(messages(study))) as outcomes:
        for _ in range(3):
            pids.add(next(outcomes)["worker"]["pid"])
        # the fourth run is handed over when the next outcome is asked for, and takes a minute
        with pytest.raises(TimeoutError), _within(20.0, mark):
            next(outcomes)
        started = time.monotonic()
    assert time.monotonic() - started < 5.0
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_workers_that_cannot_start_are_told_of(
    squares: Squares, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = squares()
    (tmp_path / "zeromethod.py").write_text("raise SystemExit('no such package')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MeasurementError, match="worker processes do not start: exit code 1: "):
        list(LocalPool(2).outcomes(messages(study)))


class _within:  # noqa: N801 - reads as words
    """Interrupt what waits once a file is there (or after so many seconds)."""

    def __init__(self, seconds: float, mark: Path) -> None:
        self._until, self._mark = time.monotonic() + seconds, mark

    def _look(self, number: int, frame: object) -> None:
        if self._mark.exists() or time.monotonic() > self._until:
            raise TimeoutError

    def __enter__(self) -> None:
        self._before = signal.signal(signal.SIGALRM, self._look)
        signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        with suppress(ValueError):
            signal.signal(signal.SIGALRM, self._before)
