"""Calls of methods, from whatever thread or process, carried out one after the other in one thread."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, NamedTuple

from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.call import DONE, Call
from zeromethod.operating.table import Table

MOST_WAITING = 100
"""Calls that may wait; more are refused."""

Answer = dict[str, Any]
Perform = Callable[..., "Answer | Future[Answer] | None"]
"""Carries out a method, given its arguments by name. A future: it is done when that is."""


class _Asked(NamedTuple):
    name: str
    arguments: dict[str, Any]
    source: str
    future: Future[Answer]


_REFUSALS = (InputError, MeasurementError, OSError)


class Controls:
    """Carries out the methods of a table.

    `call` may be used from any thread and returns at once; what it asks for is done in `attend`, which the
    thread that owns the run calls often. Every call ends in `note`, refused ones too.
    """

    def __init__(
        self, table: Table, perform: Mapping[str, Perform], note: Callable[[Call], None] = lambda _call: None
    ) -> None:
        """perform: by name, for each method of the table. note: keeps a call, in the thread of `attend`."""
        assert set(perform) == {one.name for one in table.methods}
        self.table = table
        self.on_call: Callable[[Call], None] = lambda _call: None
        """Called with each call that has ended, after it was noted."""
        self._perform = perform
        self._note = note
        self._lock = threading.Lock()
        self._waiting: deque[_Asked] = deque()
        self._under_way: list[tuple[_Asked, Future[Answer]]] = []
        self._closed = False

    def call(
        self, name: str, arguments: Mapping[str, Any] | None = None, source: str = "python"
    ) -> Future[Answer]:
        """Have a method carried out.

        The future gives what it answers; InputError or MeasurementError, one line, where it is refused.
        source: who calls, for the recording.
        """
        future: Future[Answer] = Future()
        try:
            checked = self.table.method(name).checked(arguments or {})
        except InputError as error:
            future.set_exception(error)
            return future
        with self._lock:
            if self._closed:
                future.set_exception(MeasurementError(f"{name}: the run is over"))
            elif len(self._waiting) >= MOST_WAITING:
                future.set_exception(MeasurementError(f"{name}: {MOST_WAITING} calls are waiting already"))
            else:
                self._waiting.append(_Asked(name, checked, source, future))
        return future

    def attend(self) -> None:
        """Carry out what was called; to be called often in the thread that owns the run. Never waits."""
        if not self._waiting and not self._under_way:
            return
        self._end_done()  # before what is asked for since: calls end in the order in which they take effect
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
        for asked in waiting:
            try:
                answer = self._perform[asked.name](**asked.arguments)
            except _REFUSALS as error:
                self._end(asked, error)
                continue
            if isinstance(answer, Future):
                self._under_way.append((asked, answer))
            else:
                self._end(asked, answer or {})
        self._end_done()

    def _end_done(self) -> None:
        for asked, finished in [one for one in self._under_way if one[1].done()]:
            self._under_way.remove((asked, finished))
            self._end(asked, finished.exception() or finished.result())

    def close(self) -> None:
        """Refuse what waits and whatever comes; may be called again."""
        with self._lock:
            self._closed = True
            waiting = [*self._waiting, *(asked for asked, _ in self._under_way)]
            self._waiting.clear()
            self._under_way.clear()
        for asked in waiting:
            asked.future.set_exception(MeasurementError(f"{asked.name}: the run is over"))

    def _end(self, asked: _Asked, answer: Answer | BaseException) -> None:
        error = answer if isinstance(answer, BaseException) else None
        outcome = DONE if error is None else f"refused: {' '.join(str(error).split())}"
        given = {key: value for key, value in asked.arguments.items() if value is not None}
        call = Call(asked.name, json.dumps(given, ensure_ascii=False), asked.source, outcome)
        self._note(call)
        self.on_call(call)
        if isinstance(answer, BaseException):
            asked.future.set_exception(answer)
        else:
            asked.future.set_result(answer)
