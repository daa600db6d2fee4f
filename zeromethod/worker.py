"""Work in another thread: a worker that serves the newest requests, and calls with a time limit.

All threads are daemons: a job that hangs is left to its thread, which does not keep the program from ending.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager, ExitStack
from typing import Generic, TypeVar

Request = TypeVar("Request")
Answer = TypeVar("Answer")
Result = TypeVar("Result")

Serving = Callable[[], AbstractContextManager[Callable[[Request], Answer | None]]]
"""Makes a context, entered and left in the thread, which gives the function that serves a request."""


class Worker(Generic[Request, Answer]):
    """A thread that serves one request at a time; a newer request replaces the last one that waits.

    What an error in the thread ends, its failure, is raised once to whoever asks next.
    """

    def __init__(
        self,
        name: str,
        serving: Serving[Request, Answer],
        *,
        kept: int | None = None,
        waiting: int = 1,
        merge: Callable[[Request, Request], Request] = lambda _waiting, newer: newer,
        idle: tuple[float, Request] | None = None,
    ) -> None:
        """Start the thread.

        serving: an answer of None is none. kept: how many answers wait to be taken, the newest; None: all.
        waiting: how many requests may wait, each for its turn. merge: where these are so many, makes one
        request of the last one and a newer one. idle: (seconds, request), a request that is served whenever
        none was posted for so long.
        """
        self._serving = serving
        self._merge = merge
        self._idle = idle
        self._changed = threading.Condition()
        self._most_waiting = waiting
        self._waiting: list[Request] = []
        self._answers: deque[Answer] = deque(maxlen=kept)
        self._failure: BaseException | None = None
        self._began_s: float | None = None
        self._is_open = self._ended = self._closed = self._finishing = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def busy_s(self) -> float:
        """How long the present request has been served, s; 0 for none."""
        began_s = self._began_s
        return 0.0 if began_s is None else time.monotonic() - began_s

    @property
    def first_waiting(self) -> list[Request]:
        """The request that is served after the present one; empty where none waits.

        Of several places, posting more changes only the last.
        """
        with self._changed:
            return self._waiting[:1]

    def opened(self, timeout_s: float) -> bool:
        """Whether the context was entered within that time; else the worker is closed.

        Raises what entering it raised.
        """
        try:
            with self._changed:
                self._changed.wait_for(lambda: self._is_open or self._ended, timeout_s)
                return self._is_open
        finally:
            if not self._is_open:
                self.close(0.0)
                self.raise_failure()

    def post(self, request: Request) -> None:
        """Serve a request next. Returns at once."""
        with self._changed:
            if len(self._waiting) == self._most_waiting:
                request = self._merge(self._waiting.pop(), request)
            self._waiting.append(request)
            self._changed.notify_all()

    def take(self, timeout_s: float = 0.0) -> list[Answer]:
        """Answers since the last call, in order; waits for one up to `timeout_s`.

        Raises the failure after all answers.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._answers or self._ended or self._closed, timeout_s)
            answers = list(self._answers)
            self._answers.clear()
        if not answers:
            self.raise_failure()
        return answers

    def raise_failure(self) -> None:
        """Raise the failure, if there is one that was not yet raised."""
        with self._changed:
            failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def close(self, timeout_s: float, finish: bool = False) -> None:
        """End the thread, waiting for it up to `timeout_s`; returns at once when called again.

        finish: serve the waiting requests before.
        """
        with self._changed:
            if self._closed:
                return
            self._closed, self._finishing = True, finish
            self._changed.notify_all()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            with self._serving() as serve:
                with self._changed:
                    self._is_open = True
                    self._changed.notify_all()
                while requests := self._next():
                    answer = serve(requests[0])
                    with self._changed:
                        self._began_s = None
                        if answer is not None:
                            self._answers.append(answer)
                        self._changed.notify_all()
        except BaseException as error:  # whatever it is, it belongs to the thread that asks
            self._failure = error
        finally:
            with self._changed:
                self._began_s = None
                self._ended = True
                self._changed.notify_all()

    def _next(self) -> list[Request]:
        """The request to serve; empty at the end."""
        with self._changed:
            pause_s = None if self._idle is None else self._idle[0]
            self._changed.wait_for(lambda: self._waiting or self._closed, pause_s)
            if self._closed and not self._finishing:
                return []
            requests, self._waiting = self._waiting[:1], self._waiting[1:]
            if not requests and not self._closed and self._idle is not None:
                requests = [self._idle[1]]
            self._began_s = time.monotonic()
            return requests


class SameThread(Generic[Request, Answer]):
    """A `Worker` without a thread: each request is served where it is posted, and errors are raised there."""

    busy_s = 0.0
    first_waiting: Sequence[Request] = ()

    def __init__(self, serving: Serving[Request, Answer]) -> None:
        self._stack = ExitStack()
        self._serve = self._stack.enter_context(serving())
        self._answers: list[Answer] = []

    def opened(self, timeout_s: float) -> bool:  # noqa: ARG002 - as of `Worker`
        """Whether the context was entered: always."""
        return True

    def post(self, request: Request) -> None:
        """Serve a request now."""
        answer = self._serve(request)
        if answer is not None:
            self._answers.append(answer)

    def take(self) -> list[Answer]:
        """Answers since the last call, in order."""
        answers, self._answers = self._answers, []
        return answers

    def raise_failure(self) -> None:
        """Nothing: errors were raised where they came up."""

    def close(self, timeout_s: float, finish: bool = False) -> None:  # noqa: ARG002 - as of `Worker`
        """Leave the context; may be called again."""
        self._stack.close()


def completed(call: Callable[[], Result], future: Future[Result] | None = None) -> Future[Result]:
    """Call now; the future (a new one if none is given) has the result or what was raised."""
    future = future or Future()
    try:
        future.set_result(call())
    except BaseException as error:  # whatever it is, it belongs to the thread that asks
        future.set_exception(error)
    return future


def in_thread(name: str, call: Callable[[], Result]) -> Future[Result]:
    """Call in a thread of its own, which gives the future its result or what was raised."""
    future: Future[Result] = Future()
    threading.Thread(target=completed, args=(call, future), name=name, daemon=True).start()
    return future


def call_within(timeout_s: float, call: Callable[[], Result], name: str) -> Result:
    """Call in a thread of its own; TimeoutError when it takes longer than `timeout_s`."""
    future = in_thread(name, call)
    if not wait([future], timeout_s).done:
        raise TimeoutError(f"not within {timeout_s:g} s")
    return future.result()
