"""What the operator's page costs the loop, and how soon a frame is on the screen.

The live session (camera and drawing in threads, reading in a process of its own, coded strips) runs over
frames of 1280x1024 in 8 bits from memory, at 60 per second of the host's clock; pictures are taken at once,
as a graphics card takes them. Block by block, by turns, it serves its page to three viewers that take what
they get (WebSocket clients, each a process of its own), and to none; each block with viewers is compared
with the one before it without.

rate: frames that went round the loop per second. pictures: messages with a picture of 640x512 and the depth
map that a viewer got per second; on a slow link, by a viewer that takes 10 Mbit/s. exposure to pixel: from
mid-exposure until a headless browser has painted the picture, which runs by itself then, its graphics in
software. stalled: how much the server's memory grows with a viewer that asks and does not read, and after how
long it is dropped. slope: growth of the server's memory, with viewers that ask for values alone.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing as mp
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

import aiohttp
import numpy as np

from benchmarks.browser import Browser
from benchmarks.memory_devices import FastLiveClock, MemoryCamera, MemoryDisplay, Noted, Prepared
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import changed
from zeromethod.devices.opening import Devices
from zeromethod.loop.step import Step
from zeromethod.operating.readings import HISTORY, Readings
from zeromethod.operating.run_controls import RunControls
from zeromethod.operating.run_table import RUN
from zeromethod.page.http import static_files
from zeromethod.page.process import PageProcess
from zeromethod.page.run_feed import RunFeed
from zeromethod.rig.load import load_rig
from zeromethod.session.session import Session
from zeromethod.view.progress import progress

PAIRS, QUICK_PAIRS, BLOCK_S = 20, 5, 4.0
VIEWERS = 3
SLOW_BYTES_PER_S = 10e6 / 8
PARTS = ["camera", "surface"]


def _view(url: str, go: Any, over: Any, count: Any, parts: list[str], bytes_per_s: float | None) -> None:
    """A viewer: while `go` it asks, takes and counts."""

    async def run() -> None:
        async with aiohttp.ClientSession() as client, client.ws_connect(url, max_msg_size=0) as socket:
            await socket.receive()
            while not over.is_set():
                if not go.is_set():
                    await asyncio.sleep(0.05)
                    continue
                began_s = time.monotonic()
                await socket.send_json({"next": parts})
                data = (await socket.receive()).data
                if not isinstance(data, bytes):
                    return
                (length,) = struct.unpack("<I", data[:4])
                count.value += not parts or "camera" in json.loads(data[4 : 4 + length])["parts"]
                if bytes_per_s is not None:
                    await asyncio.sleep(max(0.0, began_s + len(data) / bytes_per_s - time.monotonic()))

    asyncio.run(run())


class Viewers:
    """Viewers in processes of their own, which ask until they are ended."""

    def __init__(self, url: str, number: int, parts: list[str], bytes_per_s: float | None = None) -> None:
        spawn = mp.get_context("spawn")
        self.go, self.over = spawn.Event(), spawn.Event()
        self.counts = [spawn.Value("i", 0) for _ in range(number)]
        self._all = [
            spawn.Process(
                target=_view, args=(url, self.go, self.over, count, parts, bytes_per_s), daemon=True
            )
            for count in self.counts
        ]
        for one in self._all:
            one.start()

    @property
    def messages(self) -> int:
        """Messages that all of them got."""
        return sum(count.value for count in self.counts)

    def start(self, served: Served) -> None:
        """Have them ask, and run until each of them has got something."""
        self.go.set()
        until_s = time.monotonic() + 60
        while not all(count.value for count in self.counts) and time.monotonic() < until_s:
            served.rate_hz(0.2)

    def close(self) -> None:
        """End them."""
        self.over.set()
        for one in self._all:
            one.join(5)
            one.kill()


class Served:
    """A live session over devices of memory, with its page."""

    def __init__(self) -> None:
        known = {"known": "exact"}
        rig = changed(load_rig("simulated"), control={"strips": "edges"}, geometry=known)
        prepared = Prepared(rig)
        clock = FastLiveClock(True)
        display = MemoryDisplay(prepared, False, clock)
        self._stack = ExitStack()
        self._stack.enter_context(patch("zeromethod.loop.drawing.PatternRenderer", Noted))
        camera = MemoryCamera(prepared, display, clock)
        devices = Devices(camera, display, clock, lambda: camera)
        self.session = self._stack.enter_context(Session(rig, devices=devices))
        self.page = self._stack.enter_context(PageProcess(RUN, HISTORY, view=("127.0.0.1", 0)))
        readings = Readings(self.session)
        run = RunControls(self.session, devices, Path("/nonexistent"))
        self.page.attach(run.controls)
        feed = RunFeed(self.page, self.session, readings, clock)

        def steps() -> Iterator[Step]:
            self.session.loop.on_wait = run.controls.attend
            for step in self.session.run(seconds=1e6):
                run.see(step)
                feed.see(step, readings.see(step))
                yield step

        self._steps = steps()
        self._frames = 0

    @property
    def live_url(self) -> str:
        """Where viewers connect."""
        return self.page.url.replace("http", "ws", 1).replace("/?", "/live?")

    def rate_hz(self, seconds: float) -> float:
        """Run for so long; frames per second."""
        began_s, frames = time.monotonic(), 0
        while time.monotonic() - began_s < seconds:
            frames += next(self._steps).sensed
        return frames / (time.monotonic() - began_s)

    def memory_mb(self) -> float:
        """What the server holds, MB."""
        with open(f"/proc/{self.page.process_id}/smaps_rollup", encoding="ascii") as file:
            return next(float(line.split()[1]) for line in file if line.startswith("Private_Dirty")) / 1e3

    def close(self) -> None:
        """End it."""
        self._steps.close()  # type: ignore[attr-defined]
        self._stack.close()


def _stalled(served: Served, report: dict[str, Any]) -> None:
    """A viewer that asks for all it can and reads nothing."""
    spawn = mp.get_context("spawn")
    begun = spawn.Event()
    asker = spawn.Process(target=_ask_and_do_not_read, args=(served.live_url, begun), daemon=True)
    before_mb = served.memory_mb()
    asker.start()
    while not begun.is_set():
        served.rate_hz(0.2)
    began_s, most_mb, dropped_s = time.monotonic(), before_mb, None
    while time.monotonic() - began_s < 25 and dropped_s is None:
        served.rate_hz(0.2)
        most_mb = max(most_mb, served.memory_mb())
        if any("stopped reading" in line for line in served.page.notes()):
            dropped_s = time.monotonic() - began_s
    asker.kill()
    report |= {"stalled_mb": most_mb - before_mb, "dropped_s": dropped_s}


def _ask_and_do_not_read(url: str, begun: Any) -> None:
    async def run() -> None:
        async with aiohttp.ClientSession() as client, client.ws_connect(url, max_msg_size=0) as socket:
            connection: Any = socket._conn  # there is no public way to stop reading
            connection.protocol.pause_reading()
            begun.set()
            while not socket.closed:
                await socket.send_json({"next": [*PARTS, "residual", "sigma", "place"]})
                await asyncio.sleep(0.02)

    with suppress(ConnectionError, aiohttp.ClientError):  # it is dropped
        asyncio.run(run())


def _paired(served: Served, pairs: int, data: dict[str, Any]) -> None:
    viewers = Viewers(served.live_url, VIEWERS, PARTS)
    viewers.start(served)
    without, with_viewers, pictures = [], [], []
    with progress(pairs, "loop without and with viewers") as advance:
        for number in range(pairs):
            viewers.go.clear()
            served.rate_hz(0.5)
            without.append(served.rate_hz(BLOCK_S))
            viewers.go.set()
            served.rate_hz(0.5)
            before = viewers.messages
            began_s = time.monotonic()
            with_viewers.append(served.rate_hz(BLOCK_S))
            pictures.append((viewers.messages - before) / VIEWERS / (time.monotonic() - began_s))
            advance(f"{number + 1} of {pairs}")
    viewers.close()
    change = 100 * (np.array(with_viewers) / np.array(without) - 1)
    half = 1.96 * float(change.std(ddof=1)) / len(change) ** 0.5
    data |= {"without_hz": without, "with_hz": with_viewers, "change_percent": float(change.mean())}
    data |= {"interval_percent": half, "pictures_hz": float(np.mean(pictures))}


def _counted(
    served: Served, number: int, parts: list[str], bytes_per_s: float | None, seconds: float
) -> float:
    """Messages per second and viewer."""
    viewers = Viewers(served.live_url, number, parts, bytes_per_s)
    viewers.start(served)
    before, began_s = viewers.messages, time.monotonic()
    served.rate_hz(seconds)
    found = (viewers.messages - before) / number / (time.monotonic() - began_s)
    viewers.close()
    return found


def _slope(served: Served, seconds: float, data: dict[str, Any]) -> None:
    viewers = Viewers(served.live_url, 2, [])
    viewers.start(served)
    served.rate_hz(2.0)
    before, first_mb, began_s = viewers.messages, served.memory_mb(), time.monotonic()
    served.rate_hz(seconds)
    count, hours = viewers.messages - before, (time.monotonic() - began_s) / 3600
    grown_mb = served.memory_mb() - first_mb
    viewers.close()
    data |= {"slope_messages": count, "slope_mb": grown_mb, "slope_mb_per_hour": grown_mb / hours}


@benchmark("page_cost", __doc__)
def command(quick: bool) -> Report:
    """Measure; see the module."""
    data: dict[str, Any] = {"page_bytes": sum(len(content) for content, _ in static_files().values())}
    served = Served()
    try:
        served.rate_hz(3.0)
        _paired(served, QUICK_PAIRS if quick else PAIRS, data)
        data["slow_link_hz"] = _counted(served, 1, PARTS, SLOW_BYTES_PER_S, 6.0)
        _stalled(served, data)
        _slope(served, 10.0 if quick else 60.0, data)
        if Browser.there():
            browser = Browser(served.page.url)
            while not browser.ready:
                served.rate_hz(0.5)
            served.rate_hz(10.0 if quick else 30.0)
            data |= browser.close()
    finally:
        served.close()
    change, half = data["change_percent"], data["interval_percent"]
    dropped = "never" if data["dropped_s"] is None else f"{data['dropped_s']:.1f} s"
    late = data.get("pixel_p50_ms")
    figures = [
        Figure(
            f"loop's rate with three viewers, of {np.mean(data['without_hz']):.1f} Hz",
            f"{change:+.2f} % (95 %: {change - half:+.2f} to {change + half:+.2f})",
            ">= -1 %",
            # where other programs scatter it more widely than that, this run cannot say
            True if change - half >= -1.0 else False if change + half < -1.0 else None,
        ),
        Figure(
            "pictures per second and viewer", f"{data['pictures_hz']:.1f}", ">= 25", data["pictures_hz"] >= 25
        ),
        Figure("the same at 10 Mbit/s", f"{data['slow_link_hz']:.1f}", ">= 10", data["slow_link_hz"] >= 10),
        Figure(
            "exposure to pixel, median / 99 %",
            "no browser" if late is None else f"{late:.0f} / {data['pixel_p99_ms']:.0f} ms",
            "<= 120 / 300 ms",
            None if late is None else late <= 120 and data["pixel_p99_ms"] <= 300,
        ),
        Figure(
            "memory for a viewer that does not read",
            f"{data['stalled_mb']:.1f} MB",
            "<= 16 MB",
            data["stalled_mb"] <= 16,
        ),
        Figure("it is dropped after", dropped, "<= 12 s", (data["dropped_s"] or 99) <= 12),
        Figure(
            f"server's memory over {data['slope_messages']} messages",
            f"{data['slope_mb']:+.2f} MB ({data['slope_mb_per_hour']:+.1f} MB an hour)",
        ),
        Figure(
            "page, compressed",
            f"{1e-6 * data['page_bytes']:.2f} MB",
            "<= 1 MB",
            data["page_bytes"] <= 1_000_000,
        ),
    ]
    return Report("What the operator's page costs, 1280x1024 at 60 Hz", figures, (), data)


if __name__ == "__main__":
    start(command)
