"""The server's side of a run: its newest content, its history, what was said, and calls on their way."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from zeromethod.errors import MeasurementError
from zeromethod.page.encoding import Encoded
from zeromethod.page.message import ASK, CALL, NEWS, Content, Said, Setting, content_parts, unix_ms

MOST_PER_S = 40.0
"""Contents that are asked for per second at most: of 60 frames per second, every other one."""

IDLE_S = 0.1
"""How often values alone are asked for while no viewer waits."""

KEPT_ROWS = 20_000
"""Rows of the history that are kept: five minutes at 60 frames per second."""

KEPT_SAID = 200

ANSWER_S = 30.0
"""How long a call may take: a zero takes up to 60 frames."""

Send = Callable[[dict[str, Any]], None]


class Hub:
    """Everything that viewers share. Used in the thread of the server's event loop only."""

    def __init__(self, setting: Setting, send: Send, draw_lcd: Callable[[Any, Encoded], None]) -> None:
        """send: a line to the run's process. draw_lcd: has the LCD's picture drawn, when it is wanted."""
        self.setting = setting
        self._send = send
        self._draw_lcd = draw_lcd
        self.newest: Encoded | None = None
        self.lcd: tuple[dict[str, Any], bytes] | None = None
        """Newest picture of the LCD, and what is said of it."""
        self.rows: deque[tuple[Any, ...]] = deque(maxlen=KEPT_ROWS)
        self.row_count = 0
        self.said: deque[tuple[int, Said]] = deque(maxlen=KEPT_SAID)
        self.said_count = 0
        self.wants: dict[object, frozenset[str]] = {}
        """Parts wanted by each viewer that waits."""
        self.over = asyncio.Event()
        self.drawing: Any = None
        self._changed = asyncio.Event()
        self._asked: frozenset[str] | None = None
        self._asked_s = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._numbers = itertools.count(1)
        self._calls: dict[int, asyncio.Future[dict[str, Any]]] = {}

    @property
    def values(self) -> dict[str, Any]:
        """All values, as of the newest content; empty before the first."""
        return {} if self.newest is None else self.newest.content.values

    # From the run

    def take_content(self, parts: frozenset[str], content: Content) -> None:
        """Take in a content, made with these parts."""
        number = 1 if self.newest is None else self.newest.number + 1
        if content.stages:
            content.stages["received"] = unix_ms()
        self.newest = Encoded(number, parts, content)
        self.rows.extend(content.rows)
        self.row_count += len(content.rows)
        self._asked = None
        if "lcd" in content.arrays and self.drawing is not None:
            self._draw_lcd(self.drawing, self.newest)
        self._wake()
        self._ask_soon()

    def take_lcd(self, about: dict[str, Any], picture: bytes) -> None:
        """Take in a picture of the LCD."""
        self.lcd = about, picture

    def take_said(self, said: Said) -> None:
        """Take in something that happened."""
        self.said_count += 1
        self.said.append((self.said_count, said))
        self._wake()

    def take_answer(self, number: int, answer: dict[str, Any] | None, error: str) -> None:
        """Take in what became of a call."""
        future = self._calls.pop(number, None)
        if future is None or future.done():
            return
        if answer is None:
            future.set_exception(MeasurementError(error))
        else:
            future.set_result(answer)

    def take_drawing(self, drawing: Any) -> None:
        """Draw the LCD's pictures from this from now on."""
        self.drawing = drawing
        self._asked = None
        self._ask_soon()

    def end(self) -> None:
        """The run is over."""
        self.over.set()
        for future in self._calls.values():
            if not future.done():
                future.set_exception(MeasurementError("the run is over"))
        self._calls.clear()
        self._wake()

    # To the run

    def begin(self) -> None:
        """Ask for the first content."""
        self._ask(frozenset())

    def want(self, viewer: object, parts: frozenset[str]) -> None:
        """A viewer waits for these parts of the next content."""
        self.wants[viewer] = parts
        if self._asked is not None and not content_parts(parts) <= self._asked:
            self._ask(self._asked | content_parts(parts))
        else:
            self._ask_soon()

    def no_longer(self, viewer: object) -> None:
        """A viewer does not wait any more."""
        self.wants.pop(viewer, None)

    async def call(self, method: str, arguments: Mapping[str, Any], source: str) -> dict[str, Any]:
        """Have a method carried out; raises MeasurementError, one line, where it is refused."""
        if self.over.is_set():
            raise MeasurementError(f"{method}: the run is over")
        number = next(self._numbers)
        future: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._calls[number] = future
        asked = {"method": method, "arguments": dict(arguments), "source": source}
        self._send({"kind": CALL, "number": number} | asked)
        try:
            return await asyncio.wait_for(future, ANSWER_S)
        except TimeoutError:
            raise MeasurementError(f"{method}: the run did not answer within {ANSWER_S:g} s") from None
        finally:
            self._calls.pop(number, None)

    def news(self, words: str) -> None:
        """A line for the operator, in the terminal and on every page."""
        self._send({"kind": NEWS, "words": words})

    async def changed(self) -> None:
        """Return once there is something new."""
        await self._changed.wait()

    def _wake(self) -> None:
        event, self._changed = self._changed, asyncio.Event()
        event.set()

    def _ask(self, parts: frozenset[str]) -> None:
        self._asked, self._asked_s = parts, time.monotonic()
        self._send({"kind": ASK, "parts": sorted(parts)})

    def _ask_soon(self) -> None:
        """Ask for the next content, at once where a viewer waits and the last was long enough ago."""
        if self._asked is not None or self.over.is_set():
            return
        if self._timer is not None:
            self._timer.cancel()
        pause_s = 1 / MOST_PER_S if self.wants else IDLE_S
        left_s = max(0.0, self._asked_s + pause_s - time.monotonic())
        self._timer = asyncio.get_running_loop().call_later(left_s, self._ask_now)

    def _ask_now(self) -> None:
        self._timer = None
        if self._asked is None and not self.over.is_set():
            self._ask(content_parts(frozenset().union(*self.wants.values())))
