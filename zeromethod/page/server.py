"""The server's process: it takes in what the run sends, and serves viewers and programs."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import logging
import os
import queue
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from zeromethod.array_exchange import ArrayExchange
from zeromethod.child_process import ignore_signals, lower_priority, take_output
from zeromethod.page.access import Access
from zeromethod.page.address import USUAL_PORT, shown
from zeromethod.page.http import page_app
from zeromethod.page.hub import Hub
from zeromethod.page.lcd import LcdPictures
from zeromethod.page.lines import MOST_LINE_BYTES, LineClient
from zeromethod.page.message import ANSWER, CONTENT, READY, REFUSED, SAID, Setting

CLOSING_S = 3.0
"""How long viewers may take to learn that the run is over; most take a tenth."""


class _Refused(Exception):
    """An address cannot be served; why, in one line."""


def _words(error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return "the port is in use"
    return os.strerror(error.errno) if error.errno else str(error)


def _ours(record: logging.LogRecord) -> bool:
    """Whether an error is the server's own: what a client sent wrong, that client was told."""
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, HttpProcessingError | web.RequestPayloadError | TimeoutError)


class Sender:
    """Writes lines to the run in a thread of its own: the event loop never waits for that process."""

    def __init__(self, output: BinaryIO) -> None:
        self._lines: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._output = output
        self._thread = threading.Thread(target=self._serve, name="to the run", daemon=True)
        self._thread.start()

    def send(self, line: dict[str, Any]) -> None:
        """Send a line. Returns at once."""
        self._lines.put(line)

    def _serve(self) -> None:
        with contextlib.suppress(OSError, ValueError):  # nobody listens any more
            while (line := self._lines.get()) is not None:
                self._output.write(json.dumps(line).encode() + b"\n")
                self._output.flush()

    def close(self) -> None:
        """Write what waits, and end."""
        self._lines.put(None)
        self._thread.join(CLOSING_S)


async def _bound(app: web.Application, host: str, port: int) -> tuple[web.AppRunner, int]:
    """The page's server and its port."""
    runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=CLOSING_S)
    await runner.setup()
    # the usual port where it is free, else any
    for wanted in (USUAL_PORT, 0) if (port == USUAL_PORT) else (port,):
        site = web.TCPSite(runner, host, wanted, reuse_address=True)
        try:
            await site.start()
        except OSError as error:
            if wanted == USUAL_PORT == port:
                continue
            raise _Refused(f"--view: {shown(host, port)}: cannot be served: {_words(error)}") from None
        return runner, int(runner.addresses[0][1])
    raise _Refused("--view: no port is free")


async def _control(hub: Hub, access: Access, where: tuple[str, int] | str) -> tuple[asyncio.Server, str]:
    """The control socket and its address."""
    unix = isinstance(where, str)

    async def client(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await LineClient(hub, None if unix else access, reader, writer).serve()

    try:
        if isinstance(where, str):
            before = os.umask(0o177)  # mode 0600 from its first moment on
            try:
                server = await asyncio.start_unix_server(client, where, limit=MOST_LINE_BYTES)
            finally:
                os.umask(before)
            return server, f"unix:{where}"
        server = await asyncio.start_server(client, *where, limit=MOST_LINE_BYTES)
        return server, f"tcp://{shown(where[0], server.sockets[0].getsockname()[1])}"
    except OSError as error:
        name = where if isinstance(where, str) else shown(*where)
        raise _Refused(f"--control: {name}: cannot be served: {_words(error)}") from None


async def _serve(setting: Setting, exchange: ArrayExchange, stream: BinaryIO, sender: Sender) -> None:
    loop = asyncio.get_running_loop()

    def drawn(about: dict[str, Any], picture: bytes) -> None:
        loop.call_soon_threadsafe(hub.take_lcd, about, picture)

    pictures = LcdPictures(drawn)
    hub = Hub(setting, sender.send, pictures.draw)
    access = Access(setting.host, setting.tokens)
    runner, control = None, None
    ready: dict[str, Any] = {"kind": READY, "url": "", "view_only_url": "", "control": ""}
    try:
        if setting.port is not None:
            runner, port = await _bound(page_app(hub, access), setting.host, setting.port)
            base = f"http://{shown(setting.host, port)}/?token="
            ready |= {"url": base + setting.tokens[0], "view_only_url": base + setting.tokens[1]}
        if setting.control is not None:
            control, ready["control"] = await _control(hub, access, setting.control)
        sender.send(ready)
        lower_priority()
        threading.Thread(
            target=_receive, args=(exchange, stream, hub, loop), name="from the run", daemon=True
        ).start()
        hub.begin()
        await hub.over.wait()
        await asyncio.sleep(0.2)  # viewers are informed
    except _Refused as error:
        sender.send({"kind": REFUSED, "words": str(error)})
    finally:
        if control is not None:
            control.close()
            if isinstance(setting.control, str):
                Path(setting.control).unlink(missing_ok=True)
        if runner is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(runner.cleanup(), CLOSING_S)


def _receive(exchange: ArrayExchange, stream: BinaryIO, hub: Hub, loop: asyncio.AbstractEventLoop) -> None:
    """Hand what the run sends to the hub, in its thread, until the run ends."""

    def do(call: Callable[..., None], *arguments: Any) -> None:
        loop.call_soon_threadsafe(call, *arguments)

    try:
        while True:
            kind, value = exchange.receive(stream)
            if kind == CONTENT:
                do(hub.take_content, *value)
            elif kind == SAID:
                do(hub.take_said, value)
            elif kind == ANSWER:
                do(hub.take_answer, *value)
            else:
                do(hub.take_drawing, value)
    except (EOFError, OSError):
        with contextlib.suppress(RuntimeError):  # it has ended by itself
            do(hub.end)


def main() -> None:
    """Contents come in at standard input, lines of JSON go out at standard output.

    Argument: the file descriptor of the memory for arrays.
    """
    ignore_signals()
    logging.getLogger("aiohttp.server").addFilter(_ours)
    exchange = ArrayExchange(int(sys.argv[1]))
    stream = sys.stdin.buffer
    with contextlib.suppress(BrokenPipeError), take_output() as output:  # the run may have been killed
        try:
            _, setting = exchange.receive(stream)
        except EOFError:
            os._exit(0)
        sender = Sender(output)
        asyncio.run(_serve(setting, exchange, stream, sender))
        sender.close()
    os._exit(0)
