"""The control socket: one JSON object a line, for programs in any language.

Its first line is the token (not on a Unix socket, which only its owner can open). Then a request a line:

    {"id": 1, "call": "gain", "arguments": {"value": 0.5}}    -> {"id": 1, "result": {}}, or "error": "..."
    {"id": 2, "get": "state"}                                 -> {"id": 2, "result": {"state": "locked", ...}}
    {"id": 3, "get": "api"}                                   -> {"id": 3, "result": {"methods": [...], ...}}

What happens meanwhile is pushed: {"event": {"kind": "state", "words": "locked: nulled", "time_s": 1.2}}.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from typing import Any

from zeromethod.errors import InputError, MeasurementError
from zeromethod.page.access import Access, Right
from zeromethod.page.hub import Hub
from zeromethod.page.message import asked_of

TOKEN_S = 10.0
"""How long the first line may take."""

PATIENCE_S = 10.0
"""How long a client may leave what was sent to it unread."""

MOST_LINE_BYTES = 1 << 16


class LineClient:
    """One connection."""

    def __init__(
        self, hub: Hub, access: Access | None, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """access: None where whoever could connect may do everything."""
        self._hub, self._access = hub, access
        self._reader, self._writer = reader, writer
        self._right = Right.CONTROL
        self._turn = asyncio.Lock()

    async def serve(self) -> None:
        """Serve it until it leaves, is dropped, or the run is over."""
        events: asyncio.Task[None] | None = None
        try:
            if self._access is not None:
                first = await asyncio.wait_for(self._reader.readline(), TOKEN_S)
                self._right = self._access.right_of(first.decode("utf-8", "replace").strip())
                if self._right is Right.NONE:
                    await self._send({"error": "no valid token: the first line is the token"})
                    return
            events = asyncio.create_task(self._push())
            while line := await self._reader.readline():
                await self._send(await self._answer(line))
        except ValueError:  # what is left of the line would pass for others
            await self._last({"error": f"a line of more than {MOST_LINE_BYTES} bytes: the connection ends"})
        except TimeoutError:
            if not self._stalled:
                await self._last({"error": f"no token within {TOKEN_S:g} s: the first line is the token"})
        except ConnectionError:
            pass  # it has left
        finally:
            if events is not None:
                events.cancel()
                await asyncio.gather(events, return_exceptions=True)
            self._writer.transport.abort() if self._stalled else self._writer.close()

    _stalled = False

    async def _last(self, value: dict[str, Any]) -> None:
        """Send why the connection ends, to a client that may have left."""
        with contextlib.suppress(TimeoutError, ConnectionError):
            await self._send(value)

    async def _answer(self, line: bytes) -> dict[str, Any]:
        number: Any = None
        try:
            asked = asked_of(line)
            number = asked.get("id")
            return {"id": number, "result": await self._result(asked)}
        except (InputError, MeasurementError) as error:
            return {"id": number, "error": str(error)}

    async def _result(self, asked: dict[str, Any]) -> Any:
        if "call" in asked:
            if self._right is not Right.CONTROL:
                raise MeasurementError("this token may only view")
            arguments = asked.get("arguments") or {}
            if not isinstance(arguments, dict):
                raise InputError("arguments: an object is wanted")
            return await self._hub.call(str(asked["call"]), arguments, "socket")
        if asked.get("get") == "state":
            return self._hub.values
        if asked.get("get") == "api":
            return self._hub.setting.table
        raise InputError('"call" or "get" ("state", "api") is wanted')

    async def _push(self) -> None:
        """Push what happens, until the end of the run, which closes the connection."""
        seen = self._hub.said_count
        while not self._hub.over.is_set():
            await self._hub.changed()
            new = [one for number, one in self._hub.said if number > seen]
            seen = self._hub.said_count
            for one in new:
                event = {"kind": one.kind, "words": one.words, "time_s": one.time_s}
                await self._send({"event": event})
        with contextlib.suppress(ConnectionError):
            await self._send({"event": {"kind": "over", "words": "the run is over", "time_s": None}})
        self._writer.close()

    async def _send(self, value: dict[str, Any]) -> None:
        text = json.dumps(value, allow_nan=False) + "\n"
        async with self._turn:
            self._writer.write(text.encode())
            try:
                await asyncio.wait_for(self._writer.drain(), PATIENCE_S)
            except TimeoutError:
                self._stalled = True
                self._hub.news(f"control: a client stopped reading for {PATIENCE_S:g} s and was dropped")
                self._writer.transport.abort()
                raise
