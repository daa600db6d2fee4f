"""Cameras that answer from a list, waiting for other threads, and limits on how long something takes."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

PATIENCE_S = 60.0
"""More than anything takes on a busy machine; what hangs, hangs for so long at least."""

SOON_S = 20.0
"""What does not wait for that which hangs is done by then, however busy the machine."""


def eventually(condition: Callable[[], object], seconds: float = PATIENCE_S) -> None:
    """Wait until something is true; fails after a time that only a broken program takes."""
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.002)


@contextmanager
def takes(least_s: float, most_s: float) -> Iterator[None]:
    """Assert how long the block takes."""
    started = time.monotonic()
    yield
    assert least_s <= time.monotonic() - started < most_s


def raising(error: BaseException) -> Callable[..., Any]:
    def call(*_: object) -> None:
        raise error

    return call


class Camera:
    """Answers from a list of things to give, raise or do."""

    shape, bits = (4, 4), 8

    def __init__(self, *answers: Any) -> None:
        self.answers = iter(answers)
        self.reads: list[float] = []
        self.closed = 0

    def read(self, timeout_s: float) -> Any:
        self.reads.append(timeout_s)
        answer = next(self.answers)
        if callable(answer):
            answer = answer()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def close(self) -> None:
        self.closed += 1
