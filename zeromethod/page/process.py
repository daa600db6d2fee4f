"""The server's process, as the run's process has it: the newest goes there, calls come back.

The run never waits for it: `offer` and `say` return at once, whatever the server or its viewers do.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import subprocess
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from zeromethod.array_exchange import NONE, ArrayExchange, shared_memory
from zeromethod.child_process import start_process
from zeromethod.errors import InputError
from zeromethod.loop.call import DONE, Call
from zeromethod.operating.controls import Controls
from zeromethod.operating.table import Table
from zeromethod.page.address import LOOPBACK, USUAL_PORT
from zeromethod.page.message import (
    ANSWER,
    ASK,
    CALL,
    CONTENT,
    DRAWING,
    NEWS,
    READY,
    REFUSED,
    SAID,
    SETTING,
    Content,
    Said,
    Setting,
)

OPENING_S = 30.0
"""How long the server may take to start."""

CLOSING_S = 5.0
"""How long it may take to inform its viewers that the run is over."""

MEMORY_BYTES = 24 << 20
"""Shared memory: a picture of 16 bits and five megapixels, and the maps."""

MOST_SAID = 200
"""Lines that wait to be sent; the newest are kept."""

Compose = Callable[[frozenset[str]], Content]
"""Makes a content with these parts; called in a thread of the server's process's own."""


class PageProcess:
    """A page, a control socket, or both, served by a process of their own until `close`."""

    def __init__(
        self,
        table: Table,
        columns: tuple[str, ...] = (),
        *,
        view: tuple[str, int] | None = (LOOPBACK, USUAL_PORT),
        control: tuple[str, int] | str | None = None,
    ) -> None:
        """Start it and wait until it serves. view, control: see `Setting`; None for none.

        Calls are refused until there is something to control, by `attach`. Raises InputError, one line, for
        an address that cannot be served.
        """
        self._controls: Controls | None = None
        self.tokens = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
        host, port = view or (LOOPBACK, None)
        self._setting = Setting(table.described(), columns, host, port, control, self.tokens)
        self._changed = threading.Condition()
        self._newest: Compose | None = None
        self._asked: frozenset[str] | None = None
        self._said: deque[Said] = deque(maxlen=MOST_SAID)
        self._answers: deque[tuple[int, dict[str, Any] | None, str]] = deque()
        self._news: deque[str] = deque(maxlen=20)
        self._drawing: Any = None
        self._closing = False
        self.time_s: float | None = None
        """Time of the run, for what is called; set by who offers."""
        self.url = self.view_only_url = self.control_address = ""
        self._start()

    def attach(self, controls: Controls) -> None:
        """Have calls carried out by these controls from now on."""
        self._controls = controls
        controls.on_call = self._called

    def _start(self) -> None:
        memory = shared_memory("zeromethod page", MEMORY_BYTES)
        self._exchange = ArrayExchange(memory)
        handles = () if memory == NONE else (memory,)
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        try:
            self._process = start_process("zeromethod.page.server", str(memory), pass_fds=handles, **pipes)
        except OSError as error:
            raise InputError(f"--view: the server does not start: {error.strerror}") from None
        finally:
            for handle in handles:
                os.close(handle)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        started: Future[dict[str, Any]] = Future()
        threading.Thread(target=self._listen, args=(started,), name="page answers", daemon=True).start()
        try:
            with contextlib.suppress(OSError, ValueError):
                self._exchange.send((SETTING, self._setting), self._to)
            first = started.result(OPENING_S)
        except TimeoutError:
            self._kill()
            raise InputError(f"--view: the server does not start within {OPENING_S:g} s") from None
        if first["kind"] != READY:
            self._kill()
            raise InputError(first["words"])
        self.url, self.view_only_url = first["url"], first["view_only_url"]
        self.control_address = first["control"]
        threading.Thread(target=self._feed, name="page feed", daemon=True).start()

    @property
    def process_id(self) -> int:
        """As the system numbers it."""
        return self._process.pid

    def offer(self, compose: Compose) -> None:
        """Show what this makes, unless something newer comes first. Returns at once."""
        with self._changed:
            self._newest = compose
            self._changed.notify_all()

    def say(self, said: Said) -> None:
        """Show a line that viewers must not miss. Returns at once."""
        with self._changed:
            self._said.append(said)
            self._changed.notify_all()

    def draw_by(self, drawing: Any) -> None:
        """Draw the LCD's picture from this rig and rest from now on."""
        with self._changed:
            self._drawing = drawing
            self._changed.notify_all()

    def notes(self) -> list[str]:
        """What the operator should know of viewers and the server, since the last call."""
        found = []
        while self._news:
            found.append(self._news.popleft())
        return found

    def close(self) -> None:
        """End the server, once its viewers know that the run is over; may be called again."""
        with self._changed:
            if self._closing:
                return
            self._closing = True
            self._changed.notify_all()
        if self._controls is not None:
            self._controls.close()
        try:
            self._process.wait(CLOSING_S)
        except subprocess.TimeoutExpired:
            self._kill()
        for stream in (self._to, self._from):
            with contextlib.suppress(OSError):
                stream.close()

    def __enter__(self) -> PageProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _kill(self) -> None:
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._process.kill()
        self._process.wait()
        for stream in (self._to, self._from):
            with contextlib.suppress(OSError):  # what was not yet sent cannot be
                stream.close()

    def _called(self, call: Call) -> None:
        outcome = "" if call.outcome == DONE else f" - {call.outcome}"
        arguments = "" if call.arguments == "{}" else f" {call.arguments}"
        self.say(Said("call", f"{call.method}{arguments} ({call.source}){outcome}", self.time_s))

    # In threads of their own

    def _feed(self) -> None:
        """Send what is asked for, and what must not be missed."""
        try:
            while (message := self._next()) is not None:
                self._exchange.send(message, self._to)
            self._to.close()
        except (OSError, ValueError):
            self._lost()

    def _next(self) -> tuple[str, Any] | None:
        """What to send next; None at the end."""
        with self._changed:
            while True:
                if self._answers:
                    return ANSWER, self._answers.popleft()
                if self._said:
                    return SAID, self._said.popleft()
                if self._drawing is not None and self._asked is not None:
                    # one message with arrays at a time: it asks again once it has this one
                    drawing, self._drawing, self._asked = self._drawing, None, None
                    return DRAWING, drawing
                if self._newest is not None and self._asked is not None:
                    compose, self._newest = self._newest, None
                    wanted, self._asked = self._asked, None
                    break
                if self._closing:
                    return None
                self._changed.wait()
        try:
            return CONTENT, (wanted, compose(wanted))
        except Exception as error:  # whatever it is, it must not end the page, let alone the run
            self._news.append(f"the page: {type(error).__name__}: {' '.join(str(error).split())}")
            return CONTENT, (wanted, Content({}))

    def _listen(self, started: Future[dict[str, Any]]) -> None:
        """Take in the server's lines."""
        try:
            for line in self._from:
                self._take(json.loads(line), started)
        except (OSError, ValueError):
            pass  # it has ended
        if not started.done():
            code = self._process.wait()
            started.set_result({"kind": REFUSED, "words": f"--view: the server ended (exit code {code})"})
        self._lost()

    def _take(self, line: dict[str, Any], started: Future[dict[str, Any]]) -> None:
        kind = line["kind"]
        if kind in {READY, REFUSED}:
            started.set_result(line)
        elif kind == ASK:
            with self._changed:
                self._asked = frozenset(line["parts"])
                self._changed.notify_all()
        elif kind == NEWS:
            self._news.append(line["words"])
        elif kind == CALL:
            number = int(line["number"])
            if self._controls is None:
                self._reply(number, None, f"{line['method']}: it is still starting")
                return
            future = self._controls.call(line["method"], line["arguments"], line["source"])
            future.add_done_callback(lambda done: self._answer(number, done))

    def _answer(self, number: int, done: Future[dict[str, Any]]) -> None:
        error = done.exception()
        words = "" if error is None else " ".join(str(error).split())
        self._reply(number, None if error else done.result(), words)

    def _reply(self, number: int, answer: dict[str, Any] | None, error: str) -> None:
        with self._changed:
            self._answers.append((number, answer, error))
            self._changed.notify_all()

    def _lost(self) -> None:
        """Say once that the server is gone, unless that was wanted."""
        with self._changed:
            if self._closing:
                return
            self._closing = True
            self._changed.notify_all()
        self._news.append("the page's server has ended: the run goes on without it")
