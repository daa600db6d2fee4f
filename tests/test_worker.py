"""The worker thread: newest request only, bounded waits, errors passed on; and calls with a time limit."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import pytest
from hanging import PATIENCE_S, SOON_S, eventually, raising, takes

from zeromethod.worker import SameThread, Worker, call_within, completed, in_thread


class Job:
    """Answers a request with itself; waits for `go`, raises what it is given to raise, answers None to 0."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.go.set()
        self.served: list[Any] = []
        self.threads: set[threading.Thread] = set()
        self.left = threading.Event()
        self.opening: Callable[[], object] = lambda: None

    def __call__(self, request: Any) -> Any:
        self.threads.add(threading.current_thread())
        self.served.append(request)
        self.go.wait(PATIENCE_S)
        if isinstance(request, BaseException):
            raise request
        return request or None

    @contextmanager
    def serving(self) -> Iterator[Job]:
        self.opening()
        self.threads.add(threading.current_thread())
        try:
            yield self
        finally:
            self.threads.add(threading.current_thread())
            self.left.set()


@pytest.fixture
def job() -> Iterator[Job]:
    made = Job()
    yield made
    made.go.set()


def test_the_newest_request_replaces_the_one_that_waits(job):
    job.go.clear()
    worker = Worker("test", job.serving)
    worker.post(1)
    eventually(lambda: job.served == [1])
    with takes(0, SOON_S):
        for number in range(2, 40):
            worker.post(number)
        assert worker.take() == []
    job.go.set()
    eventually(lambda: job.served == [1, 39])
    worker.close(PATIENCE_S)
    assert worker.take() == [1, 39]
    assert worker.take() == []


@pytest.mark.parametrize("waiting", [1, 2])
def test_requests_can_be_merged_with_the_last_one_that_waits(job, waiting):
    job.go.clear()
    worker = Worker("test", job.serving, waiting=waiting, merge=lambda last, newer: last + newer)
    worker.post("a")
    eventually(lambda: job.served == ["a"])
    for letter in "bcd":
        worker.post(letter)
    job.go.set()
    eventually(lambda: job.served == (["a", "bcd"] if waiting == 1 else ["a", "b", "cd"]))
    worker.close(1)


def test_only_so_many_answers_are_kept_and_none_is_no_answer(job):
    worker = Worker("test", job.serving, kept=1)
    for number in range(3):
        worker.post(number)
        eventually(lambda number=number: job.served[-1:] == [number] and not worker.busy_s)
    assert worker.take() == [2]
    worker.post(0)
    eventually(lambda: job.served[-1] == 0)
    assert worker.take(0.02) == []
    worker.close(1)


def test_taking_waits_for_an_answer_and_no_longer(job):
    worker = Worker("test", job.serving)
    with takes(0.05, SOON_S):
        assert worker.take(0.05) == []
    threading.Timer(0.1, worker.post, ("late",)).start()
    assert worker.take(PATIENCE_S) == ["late"]
    threading.Timer(0.1, worker.close, (0.0,)).start()
    with takes(0, SOON_S):
        assert worker.take(PATIENCE_S) == []


def test_an_idle_worker_serves_its_idle_request(job):
    worker = Worker("test", job.serving, idle=(0.01, "idle"))
    assert worker.take(PATIENCE_S) == ["idle"]
    worker.post("posted")
    eventually(lambda: "posted" in job.served and job.served[-1] == "idle")
    worker.close(1)


def test_everything_happens_in_one_thread_of_its_own(job):
    worker = Worker("test", job.serving)
    assert worker.opened(PATIENCE_S)
    worker.post(1)
    assert worker.take(PATIENCE_S) == [1]
    assert not job.left.is_set()
    worker.close(PATIENCE_S)
    assert job.left.is_set()
    assert len(job.threads) == 1
    assert threading.current_thread() not in job.threads


def test_a_failure_is_raised_once_after_all_answers_and_ends_the_worker(job):
    worker = Worker("test", job.serving)
    worker.post(1)
    eventually(lambda: job.served == [1] and not worker.busy_s)
    worker.post(KeyError("odd"))
    assert job.left.wait(PATIENCE_S)
    assert worker.take() == [1]
    with pytest.raises(KeyError, match="odd"):
        worker.take(PATIENCE_S)
    worker.raise_failure()
    assert worker.take(PATIENCE_S) == []
    assert worker.busy_s == 0.0


def test_a_context_that_cannot_be_entered_is_raised_where_it_is_waited_for(job):
    job.opening = raising(KeyError("refused"))
    with pytest.raises(KeyError, match="refused"):
        Worker("test", job.serving).opened(PATIENCE_S)
    with pytest.raises(KeyError, match="refused"):
        Worker("test", job.serving).take(PATIENCE_S)


def test_a_context_that_is_entered_too_late_is_left_at_once(job):
    go = threading.Event()
    job.opening = lambda: go.wait(PATIENCE_S)
    worker = Worker("test", job.serving)
    assert not worker.opened(0.02)
    worker.close(0.0)
    go.set()
    assert job.left.wait(PATIENCE_S)
    assert job.served == []


@pytest.mark.parametrize("finish", [False, True])
def test_closing_drops_or_finishes_what_waits(job, finish):
    job.go.clear()
    worker = Worker("test", job.serving)
    worker.post(1)
    eventually(lambda: job.served == [1])
    worker.post(2)
    threading.Timer(0.1, job.go.set).start()
    worker.close(PATIENCE_S, finish)
    assert worker.take() == ([1, 2] if finish else [1])


def test_a_hung_job_is_left_within_the_bound_and_its_time_is_known(job):
    job.go.clear()
    worker = Worker("test", job.serving)
    worker.post(1)
    eventually(lambda: worker.busy_s > 0.02)
    with takes(0.1, SOON_S):
        worker.close(0.1)
    with takes(0.0, SOON_S):  # the second call does not wait
        worker.close(PATIENCE_S)
    assert not job.left.is_set()
    job.go.set()
    assert job.left.wait(PATIENCE_S)


HUNG = """
import threading
from contextlib import nullcontext
from zeromethod.worker import Worker, in_thread
Worker("hung", lambda: nullcontext(lambda _: threading.Event().wait())).post(1)
in_thread("hung", threading.Event().wait)
"""


def test_hung_threads_do_not_keep_the_program_from_ending():
    run = subprocess.run(
        [sys.executable, "-c", HUNG], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    assert run.stderr == ""


def test_without_a_thread_requests_are_served_and_fail_where_they_are_posted(job):
    worker = SameThread(job.serving)
    assert worker.opened(0.0)
    for number in range(3):
        worker.post(number)
    assert worker.take() == [1, 2]
    assert worker.take() == []
    with pytest.raises(KeyError, match="odd"):
        worker.post(KeyError("odd"))
    worker.raise_failure()
    worker.close(0.0)
    worker.close(0.0)
    assert job.left.is_set()
    assert job.threads == {threading.current_thread()}
    assert SameThread(lambda: nullcontext(job)).busy_s == 0.0


def test_calls_with_a_time_limit_return_or_raise_what_the_call_does():
    assert call_within(PATIENCE_S, lambda: 3, "quick") == 3
    with pytest.raises(ValueError, match="odd"):
        call_within(PATIENCE_S, raising(ValueError("odd")), "quick")
    with pytest.raises(TimeoutError, match="its own"):
        call_within(PATIENCE_S, raising(TimeoutError("its own")), "quick")
    with pytest.raises(TimeoutError, match=r"^not within 0\.05 s$"):
        call_within(0.05, lambda: time.sleep(1.0), "slow")


def test_calls_are_made_here_or_in_a_thread():
    here, there = completed(threading.current_thread), in_thread("there", threading.current_thread)
    assert here.result(0) is threading.current_thread()
    assert there.result(PATIENCE_S).name == "there"
    assert isinstance(completed(raising(KeyError("odd"))).exception(0), KeyError)
    assert isinstance(in_thread("there", raising(SystemExit())).exception(PATIENCE_S), SystemExit)
