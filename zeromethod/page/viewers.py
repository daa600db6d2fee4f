"""Viewers: a WebSocket each, which gets the newest when it has asked for it, and nothing else.

A viewer has one credit: it asks ("next"), gets one message, and must ask again. So at most one message waits
for it here, and one that stops reading costs that much and no more. It is dropped after `PATIENCE_S`.
"""

from __future__ import annotations

import asyncio
import json
import socket
import time
from typing import Any

from aiohttp import WSMsgType, web

from zeromethod.errors import InputError, MeasurementError
from zeromethod.page.access import Right
from zeromethod.page.encoding import packed
from zeromethod.page.hub import Hub
from zeromethod.page.message import PARTS, asked_of, content_parts, unix_ms

PATIENCE_S = 10.0
"""How long a viewer may leave what was sent to it unread."""

PING_S, LOOK_S = 2.5, 0.5
LATE_S = 0.3
"""How long a content without all wanted parts is passed over."""

SEND_BUFFER_BYTES = 1 << 18
"""Kernel buffer per viewer: about one message."""

MOST_MESSAGE_BYTES = 1 << 16
FIRST_ROWS = 3000
"""Rows of the history that a viewer gets at first, at most."""


class Stalled(Exception):
    """A viewer has not read for `PATIENCE_S`."""


class Viewer:
    """One WebSocket."""

    def __init__(self, hub: Hub, right: Right, peer: str) -> None:
        self._hub, self._right, self._peer = hub, right, peer
        self._socket = web.WebSocketResponse(
            autoping=False, compress=False, max_msg_size=MOST_MESSAGE_BYTES, timeout=1.0
        )
        self._heard_s = time.monotonic()
        self._wanted: frozenset[str] | None = None
        self._wanted_s = 0.0
        self._asked = asyncio.Event()
        self._probe: tuple[int, int] | None = None
        self._seen = self._rows_seen = self._said_seen = 0
        self._lcd_seen: tuple[dict[str, Any], bytes] | None = None
        self._calls: set[asyncio.Task[None]] = set()

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        """Serve it until it leaves, is dropped, or the run is over."""
        try:
            await self._socket.prepare(request)
        except ConnectionError:
            return self._socket  # it left before it was answered
        except ValueError:
            raise web.HTTPBadRequest(text="no handshake of a WebSocket\n") from None
        transport = request.transport
        plain: Any = None if transport is None else transport.get_extra_info("socket")
        if (
            plain is not None
        ):  # what the kernel holds is old by the time it is read, and memory of this machine
            plain.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        tasks: list[asyncio.Task[None]] = []
        reason = ""
        try:
            await self._send_text(self._hello())
            tasks = [asyncio.create_task(one) for one in (self._listen(), self._show(), self._watch())]
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except Stalled:
            reason = f"stopped reading for {PATIENCE_S:g} s"
        except (ConnectionError, InputError) as error:
            reason = str(error)
        finally:
            for task in [*tasks, *self._calls]:
                task.cancel()
            await asyncio.gather(*tasks, *self._calls, return_exceptions=True)
            self._hub.no_longer(self)
            await self._close(request, reason)
        return self._socket

    async def _close(self, request: web.Request, reason: str) -> None:
        if "stopped reading" in reason:
            self._hub.news(f"view: the viewer at {self._peer} {reason} and was dropped")
            if request.transport is not None:
                request.transport.abort()
            return
        words = "the run is over" if self._hub.over.is_set() else reason
        code = 4000 if self._hub.over.is_set() else 1000
        try:
            await asyncio.wait_for(self._socket.close(code=code, message=words.encode()[:120]), 1.0)
        except (TimeoutError, ConnectionError, RuntimeError):
            if request.transport is not None:
                request.transport.abort()

    def _hello(self) -> dict[str, Any]:
        hub = self._hub
        rows = list(hub.rows)
        self._rows_seen, self._said_seen = hub.row_count, hub.said_count
        return {
            "hello": hub.setting.table,
            "columns": hub.setting.columns,
            "may_control": self._right is Right.CONTROL,
            "rows": rows[:: max(1, -(-len(rows) // FIRST_ROWS))],
            "said": [_said(one) for _, one in hub.said],
            "parts": PARTS,
        }

    async def _listen(self) -> None:
        async for message in self._socket:
            self._heard_s = time.monotonic()
            if message.type is WSMsgType.PING:
                await self._within(self._socket.pong(message.data))
            elif message.type is WSMsgType.TEXT:
                await self._take(message.data)
            elif message.type is not WSMsgType.PONG:
                return

    async def _take(self, text: str) -> None:
        asked = asked_of(text)
        if "next" in asked:
            names = asked["next"] if isinstance(asked["next"], list) else []
            self._wanted = frozenset(str(name) for name in names) & frozenset(PARTS)
            if "probe" in asked:
                self._probe = _node(asked["probe"])
            self._wanted_s = time.monotonic()
            parts = self._wanted | ({"surface"} if self._probe is not None else frozenset())
            self._hub.want(self, parts)
            self._asked.set()
        if "call" in asked:
            if len(self._calls) >= 20:
                raise InputError("too many calls at a time")
            task = asyncio.create_task(self._call(asked))
            self._calls.add(task)
            task.add_done_callback(self._calls.discard)

    async def _call(self, asked: dict[str, Any]) -> None:
        answer: dict[str, Any] = {"id": asked.get("id")}
        arguments = asked.get("arguments") or {}
        try:
            if self._right is not Right.CONTROL:
                raise MeasurementError("this page may only view")
            if not isinstance(arguments, dict):
                raise InputError("arguments: an object is wanted")
            answer["result"] = await self._hub.call(str(asked["call"]), arguments, "page")
        except (InputError, MeasurementError) as error:
            answer["error"] = str(error)
        await self._send_text(answer)

    async def _show(self) -> None:
        """Send the newest whenever it was asked for."""
        while not self._hub.over.is_set():
            await self._asked.wait()
            while not self._there():
                try:
                    await asyncio.wait_for(self._hub.changed(), LATE_S)
                except TimeoutError:
                    continue
                if self._hub.over.is_set():
                    return
            wanted, self._wanted = self._wanted, None
            self._asked.clear()
            self._hub.no_longer(self)
            await self._within(self._socket.send_bytes(self._message(wanted or frozenset())))

    def _there(self) -> bool:
        """Whether there is something new with all that was wanted, as far as it exists."""
        newest = self._hub.newest
        if newest is None or newest.number <= self._seen:
            return False
        wanted = self._wanted or frozenset()
        needed = content_parts(wanted) - {"lcd"}
        return needed <= newest.parts or time.monotonic() - self._wanted_s > LATE_S

    def _message(self, wanted: frozenset[str]) -> bytes:
        hub, newest = self._hub, self._hub.newest
        assert newest is not None
        self._seen = newest.number
        missed = min(hub.row_count - self._rows_seen, len(hub.rows), FIRST_ROWS)
        rows = [hub.rows[len(hub.rows) - missed + index] for index in range(missed)]
        said = [_said(one) for number, one in hub.said if number > self._said_seen]
        self._rows_seen, self._said_seen = hub.row_count, hub.said_count
        header: dict[str, Any] = {"values": newest.content.values, "rows": rows, "said": said}
        if self._probe is not None:
            header["probe"] = newest.probe(*self._probe)
        found = {name: newest.part(name) for name in PARTS if name in wanted}
        if "lcd" in wanted and hub.lcd is not None and hub.lcd is not self._lcd_seen:
            found["lcd"] = self._lcd_seen = hub.lcd
        if newest.content.stages:
            header["stages_ms"] = newest.content.stages | {"packed": unix_ms()}
        return packed(header, {name: part for name, part in found.items() if part is not None})

    async def _watch(self) -> None:
        """Notice a viewer that has gone silent, and the end of the run."""
        pinged_s = time.monotonic()
        ping: asyncio.Task[None] | None = None
        try:
            while not self._hub.over.is_set():
                try:
                    await asyncio.wait_for(self._hub.over.wait(), LOOK_S)
                except TimeoutError:
                    now_s = time.monotonic()
                    if now_s - self._heard_s > PATIENCE_S:
                        raise Stalled from None
                    if now_s - pinged_s > PING_S and (ping is None or ping.done()):
                        pinged_s, ping = now_s, asyncio.create_task(self._socket.ping())
        finally:
            if ping is not None:
                ping.cancel()
                await asyncio.gather(ping, return_exceptions=True)

    async def _send_text(self, value: dict[str, Any]) -> None:
        await self._within(self._socket.send_str(json.dumps(value, allow_nan=False)))

    @staticmethod
    async def _within(sending: Any) -> None:
        """Wait for a sending; raises Stalled where the other end takes nothing."""
        try:
            await asyncio.wait_for(sending, PATIENCE_S)
        except TimeoutError:
            raise Stalled from None


def _said(one: Any) -> dict[str, Any]:
    return {"kind": one.kind, "words": one.words, "time_s": one.time_s}


def _node(value: Any) -> tuple[int, int] | None:
    """(column, row) of a node; None where it is none."""
    if isinstance(value, list) and len(value) == 2 and all(isinstance(one, int) for one in value):
        return value[0], value[1]
    return None
