"""What the operator's page costs the loop, and how soon a frame is on the screen.

The live session (camera and drawing in threads, reading in a process of its own, coded strips) runs over
frames of 1280x1024 in 8 bits from memory, at 60 per second of the host's clock; pictures are taken at once,
as a graphics card takes them. Block by block it serves its page to three viewers that take what they get
(WebSocket clients, each a process of its own), or to none, in the order without, with, with, without, so that
a load that grows or fades counts for both alike. Two blocks make a pair; intervals are of the median over the
pairs, by resampling them.

rate: frames that went round the loop per second, by the host's clock, which any other program delays.
processor time: of the loop's thread per frame, and of its whole process, which bounds what the page's own
threads can keep the loop waiting for; both are there to decide on a busy machine. pictures: messages with a
picture of 640x512 and the depth map that a viewer got per second; on a slow link, by a viewer that takes
10 Mbit/s. exposure to pixel: from mid-exposure until a headless browser without a graphics card has handed
the picture over to the screen, which runs by itself then; by stages, each from the one before. stalled: how
much the server's memory grows with a viewer that asks and does not read, and after how long it is dropped.
load: programs that wanted a core, mean over the last minute, this one's own among them.
How the server's memory grows over a million messages: `python -m benchmarks.page_memory`.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing as mp
import os
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import aiohttp
import numpy as np

from benchmarks.browser import Browser
from benchmarks.memory_devices import FastLiveClock, MemoryCamera, MemoryDisplay, Noted, Prepared
from benchmarks.report import Figure, Report, benchmark, figure, start
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

PAIRS, QUICK_PAIRS, BLOCK_S, SETTLING_S = 24, 6, 2.0, 0.4
RESAMPLED, SEED = 4000, 5
RATE_PERCENT = 1.0
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
            served.run(0.2)

    def close(self) -> None:
        """End them."""
        self.over.set()
        for one in self._all:
            one.join(5)
            one.kill()


class Block(NamedTuple):
    """A block of the loop: frames, wall time, and processor time of its thread and of its process, s."""

    frames: int
    wall_s: float
    thread_s: float
    process_s: float

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self.frames / self.wall_s


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

    def run(self, seconds: float) -> Block:
        """Run for so long."""
        began = time.monotonic(), time.thread_time(), time.process_time()
        frames = 0
        while time.monotonic() - began[0] < seconds:
            frames += next(self._steps).sensed
        ended = time.monotonic(), time.thread_time(), time.process_time()
        return Block(frames, *(after - before for before, after in zip(began, ended, strict=True)))

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
        served.run(0.2)
    began_s, most_mb, dropped_s = time.monotonic(), before_mb, None
    while time.monotonic() - began_s < 25 and dropped_s is None:
        served.run(0.2)
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
    blocks: dict[bool, list[Block]] = {False: [], True: []}
    pictures = []
    with progress(pairs, "loop without and with viewers") as advance:
        for number in range(pairs):
            for viewed in (False, True) if number % 2 == 0 else (True, False):
                (viewers.go.set if viewed else viewers.go.clear)()
                served.run(SETTLING_S)
                before = viewers.messages
                blocks[viewed].append(block := served.run(BLOCK_S))
                if viewed:
                    pictures.append((viewers.messages - before) / VIEWERS / block.wall_s)
            advance(f"{number + 1} of {pairs}")
    viewers.close()
    pair = list(zip(blocks[False], blocks[True], strict=True))
    data["without_hz"] = [block.rate_hz for block in blocks[False]]
    data["pictures_hz"] = float(np.median(pictures))
    data["rate_percent"] = _interval([100 * (one.rate_hz / none.rate_hz - 1) for none, one in pair])
    data["without_ms"] = float(np.median([1e3 * one.thread_s / one.frames for one in blocks[False]]))
    for name in ("thread_s", "process_s"):
        data[name.replace("_s", "_ms")] = _interval(
            [
                1e3 * (getattr(one, name) / one.frames - getattr(none, name) / none.frames)
                for none, one in pair
            ]
        )


def _interval(values: list[float]) -> tuple[float, float, float]:
    """Median of the pairs, and the limits of its 95 % interval, by resampling them."""
    rng = np.random.default_rng(SEED)
    drawn = np.median(rng.choice(values, (RESAMPLED, len(values))), axis=1)
    return float(np.median(values)), *np.percentile(drawn, [2.5, 97.5]).tolist()


def _counted(
    served: Served, number: int, parts: list[str], bytes_per_s: float | None, seconds: float
) -> float:
    """Messages per second and viewer."""
    viewers = Viewers(served.live_url, number, parts, bytes_per_s)
    viewers.start(served)
    before, began_s = viewers.messages, time.monotonic()
    served.run(seconds)
    found = (viewers.messages - before) / number / (time.monotonic() - began_s)
    viewers.close()
    return found


def _words(interval: tuple[float, float, float], unit: str, digits: int = 2) -> str:
    middle, low, high = interval
    return f"{middle:+.{digits}f} {unit} (95 %: {low:+.{digits}f} to {high:+.{digits}f})"


def _decided(worst: float, best: float, bar: float) -> bool | None:
    """Whether all of an interval is at least the bar; None where it is on both sides of it."""
    return True if worst >= bar else False if best < bar else None


@benchmark("page_cost", __doc__)
def command(quick: bool) -> Report:
    """Measure; see the module."""
    data: dict[str, Any] = {"page_bytes": sum(len(content) for content, _ in static_files().values())}
    served = Served()
    try:
        served.run(3.0)
        _paired(served, QUICK_PAIRS if quick else PAIRS, data)
        data["slow_link_hz"] = _counted(served, 1, PARTS, SLOW_BYTES_PER_S, 6.0)
        _stalled(served, data)
        if Browser.there():
            browser = Browser(served.page.url)
            while not browser.ready:
                served.run(0.5)
            served.run(10.0 if quick else 30.0)
            data |= browser.close()
    finally:
        served.close()
    data["load"] = os.getloadavg()[0]
    frame_ms = 1e3 / load_rig("simulated").camera.rate_hz
    most_ms = 0.01 * RATE_PERCENT * frame_ms
    percent, low, high = data["rate_percent"]
    error = 0.01 * (high - low) / (2 * 1.96)
    dropped = "never" if data["dropped_s"] is None else f"{data['dropped_s']:.1f} s"
    late = data.get("pixel_p50_ms")
    first = data.get("first_ms")
    stages = [(name, *(f"{value:.1f}" for value in both)) for name, both in data.get("stages_ms", {}).items()]
    figures = [
        figure("change of the loop's rate by three viewers", 0.01 * percent, error, unit="%", least=-0.01),
        Figure("the rate without", f"{np.median(data['without_hz']):.1f} Hz"),
        Figure(
            f"its thread's processor time a frame, of {data['without_ms']:.1f} ms",
            _words(data["thread_ms"], "ms", 3),
            f"<= {most_ms:.3f} ms",
            _decided(-data["thread_ms"][2], -data["thread_ms"][1], -most_ms),
        ),
        Figure("its process's, the page's threads in it", _words(data["process_ms"], "ms", 3)),
        Figure(
            "pictures per second and viewer", f"{data['pictures_hz']:.1f}", ">= 25", data["pictures_hz"] >= 25
        ),
        Figure("the same at 10 Mbit/s", f"{data['slow_link_hz']:.1f}", ">= 10", data["slow_link_hz"] >= 10),
        Figure("exposure to pixel, 99 %", "no browser" if late is None else f"{data['pixel_p99_ms']:.0f} ms"),
        *([] if late is None else [figure("exposure to pixel, median", late, unit="ms", most=150.0)]),
        Figure(
            "memory for a viewer that does not read",
            f"{data['stalled_mb']:.1f} MB",
            "<= 16 MB",
            data["stalled_mb"] <= 16,
        ),
        Figure("it is dropped after", dropped, "<= 12 s", (data["dropped_s"] or 99) <= 12),
        Figure(
            "page asked for to first picture",
            "no browser" if first is None else f"{first:.0f} ms",
            "<= 1000 ms",
            None if first is None else first <= 1000,
        ),
        Figure(
            "page, compressed",
            f"{1e-6 * data['page_bytes']:.2f} MB",
            "<= 1 MB",
            data["page_bytes"] <= 1_000_000,
        ),
    ]
    details = [("exposure to pixel, ms", "median", "99 %"), *stages] if stages else ()
    figures.append(Figure("browser's processor time a picture", f"{data.get('picture_ms', np.nan):.0f} ms"))
    figures.append(Figure("load meanwhile", f"{data['load']:.1f}"))
    return Report("What the operator's page costs, 1280x1024 at 60 Hz", figures, details, data)


if __name__ == "__main__":
    start(command)
