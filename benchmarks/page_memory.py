"""How the memory of the operator's page's server grows over a million messages.

The server's own process, as a run starts it, is offered made-up contents as fast as it asks for them: values,
rows of the history, now and then a line. A hundred viewers ask for values alone, one for pictures and maps
as well. Once the history that is kept is full, memory that only this process holds is noted every so many
messages, and a line is fitted. Per hour: of three viewers that get 25 messages a second each.
"""

from __future__ import annotations

import asyncio
import base64
import itertools
import os
import threading
import time
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from benchmarks.process_use import memory_mb
from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.operating.readings import HISTORY
from zeromethod.operating.run_table import RUN
from zeromethod.page.hub import KEPT_ROWS
from zeromethod.page.message import Content, Said
from zeromethod.page.process import PageProcess
from zeromethod.view.progress import progress

MESSAGES, QUICK_MESSAGES, NOTED = 1_000_000, 60_000, 40
VIEWERS, ROWS = 100, 20
VIEWED_PER_HOUR = 3 * 25 * 3600
MOST_MB_PER_HOUR = 1.0
SAID_EVERY = 50
NODES = 64, 80


class Contents:
    """Made-up contents, each of them new; offered again and again from a thread of its own until `close`."""

    def __init__(self, page: PageProcess) -> None:
        self._page, self._over = page, threading.Event()
        rng = np.random.default_rng(1)
        self._image = rng.integers(0, 255, (512, 640), np.uint8)
        depth = rng.normal(size=NODES).astype(np.float32)
        maps = dict.fromkeys(("depth", "sigma", "x", "y"), depth)
        self._maps = maps | {"slope": np.zeros((*NODES, 2), np.float32), "kind": np.ones(NODES, np.uint8)}
        self._numbers = itertools.count()
        self._thread = threading.Thread(target=self._offer)
        self._thread.start()

    def _compose(self, parts: frozenset[str]) -> Content:
        number = next(self._numbers)
        values: dict[str, Any] = dict.fromkeys((one.name for one in RUN.values), 0.1234567)
        values |= {"state": "locked", "reason": f"step {number}", "step": number, "contacts": []}
        rows = [tuple(1e-3 * (number + column) for column in range(len(HISTORY)))] * ROWS
        arrays = {"camera": {"image": self._image}, "surface": self._maps}
        meta: dict[str, Any] = {"camera": {"step": number, "bits": 8}, "surface": {"time_s": 1e-3 * number}}
        wanted = {name: part for name, part in arrays.items() if name in parts}
        return Content(values, rows, {"exposed": 1.0}, wanted, {name: meta[name] for name in wanted})

    def _offer(self) -> None:
        for number in itertools.count():
            if self._over.wait(0.005):
                return
            self._page.offer(self._compose)
            if number % SAID_EVERY == 0:
                self._page.say(Said("note", f"line {number}", float(number)))

    def close(self) -> None:
        """Offer no more."""
        self._over.set()
        self._thread.join()


class Viewers:
    """WebSockets that ask and throw away what comes; as little of a client as will do."""

    def __init__(self) -> None:
        self.messages = 0
        self.over = False

    async def look(self, url: str, parts: str) -> None:
        """One viewer, until it is over."""
        where = urlsplit(url)
        reader, writer = await asyncio.open_connection(where.hostname, where.port)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = (
            f"GET /live?{where.query} HTTP/1.1",
            f"Host: {where.netloc}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}",
            "Sec-WebSocket-Version: 13",
        )
        writer.write(("\r\n".join(lines) + "\r\n\r\n").encode())
        await reader.readuntil(b"\r\n\r\n")
        asked = f'{{"next": [{parts}]}}'.encode()
        frame = bytes([0x81, 0x80 | len(asked), 0, 0, 0, 0]) + asked  # masked with zeros
        kind = await self._message(reader)
        while not self.over:
            if kind in {0x81, 0x82}:  # its hello, then what was asked for; pings are let pass
                self.messages += kind == 0x82
                writer.write(frame)
            kind = await self._message(reader)
        writer.close()

    @staticmethod
    async def _message(reader: asyncio.StreamReader) -> int:
        """First byte of the next message."""
        kind, length = await reader.readexactly(2)
        if length >= 126:
            length = int.from_bytes(await reader.readexactly(2 if length == 126 else 8), "big")
        await reader.readexactly(length)
        return kind


async def _look(page: PageProcess, messages: int) -> tuple[list[int], list[float], float]:
    """Messages and memory as they grew, and how long it took, s."""
    viewers = Viewers()
    tasks = [asyncio.create_task(viewers.look(page.url, "")) for _ in range(VIEWERS)]
    tasks.append(asyncio.create_task(viewers.look(page.url, '"camera", "surface", "sigma", "place"')))
    full = 2 * (VIEWERS + 1) * KEPT_ROWS // ROWS
    counts, held_mb = [], []
    began_s = time.monotonic()
    with progress(NOTED + 1, "messages") as advance:
        for number in range(NOTED + 1):
            until = full + number * messages // NOTED
            while viewers.messages < until:
                await asyncio.sleep(0.02)
                for task in tasks:
                    if task.done():
                        task.result()
            if number == 0:
                began_s = time.monotonic()
            counts.append(viewers.messages)
            held_mb.append(memory_mb(page.process_id))
            advance(f"{counts[-1]}")
    took_s = time.monotonic() - began_s
    viewers.over = True
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return counts, held_mb, took_s


@benchmark("page_memory", __doc__)
def command(quick: bool) -> Report:
    """Measure; see the module."""
    with PageProcess(RUN, HISTORY, view=("127.0.0.1", 0)) as page:
        contents = Contents(page)
        try:
            counts, held_mb, took_s = asyncio.run(_look(page, QUICK_MESSAGES if quick else MESSAGES))
        finally:
            contents.close()
    (slope, _), covariance = np.polyfit(counts, held_mb, 1, cov=True)
    per_hour, sigma = VIEWED_PER_HOUR * slope, VIEWED_PER_HOUR * float(covariance[0, 0]) ** 0.5
    number = counts[-1] - counts[0]
    data = {"messages": counts, "memory_mb": held_mb, "seconds": took_s, "mb_per_hour": (per_hour, sigma)}
    figures = [
        Figure(
            f"server's memory over {number} messages",
            f"{held_mb[0]:.1f} to {held_mb[-1]:.1f} MB, largest {max(held_mb):.1f}",
        ),
        Figure("messages per second", f"{number / took_s:.0f}"),
        Figure(
            "growth, of three viewers with 25 messages a second",
            f"{per_hour:+.3f} +- {sigma:.3f} MB an hour",
            f"<= {MOST_MB_PER_HOUR:g} MB an hour",
            per_hour + 2 * sigma <= MOST_MB_PER_HOUR,
        ),
    ]
    return Report("Memory of the operator's page's server", figures, (), data)


if __name__ == "__main__":
    start(command)
