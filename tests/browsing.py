"""A headless browser, where Debian's chromium is installed, and a command that serves a page."""

import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from small_rigs import BENCH_320, small_rig_file

CHROMIUM = next((path for name in ("chromium", "google-chrome") if (path := shutil.which(name))), None)
START_S = 120.0

CALM_CAMERA = """
import time
from zeromethod.simulation.camera import SimulatedCamera

class CalmCamera(SimulatedCamera):
    reads = 0
    exposure_settable = False

    def read(self, timeout_s):
        self.reads += 1
        time.sleep(0.1 if self.reads > 40 else 0.0)
        return super().read(timeout_s)
"""

needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium is installed: sh tools/system-packages.sh test installs it"
)


@dataclass
class Served:
    """A command that serves a page, and what it prints on standard error."""

    process: subprocess.Popen[str]
    urls: dict[str, str] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)

    @property
    def base(self) -> str:
        return self.urls["view"].partition("/?")[0]

    @property
    def token(self) -> str:
        return self.urls["view"].partition("token=")[2]

    @property
    def view_token(self) -> str:
        return self.urls["view only"].partition("token=")[2]

    @property
    def port(self) -> int:
        return int(self.base.rpartition(":")[2])

    @property
    def control_port(self) -> int:
        return int(self.urls["control"].split()[0].rpartition(":")[2])


def calm_rig_file(folder: Path) -> Path:
    """A small bench that locks at once and then has some 9 frames a second: else it takes all of a core."""
    (folder / "calm.py").write_text(CALM_CAMERA)
    return small_rig_file(folder / "small.toml", BENCH_320 | {"camera.driver": "calm:CalmCamera"})


@contextmanager
def served(*words: str | Path, cwd: Path, wanted: int = 3) -> Iterator[Served]:
    """`zeromethod` with these words, once it has printed so many addresses; ended at the end."""
    command = [sys.executable, "-m", "zeromethod", *map(str, words)]
    pipes: dict[str, Any] = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
    process = subprocess.Popen(command, cwd=cwd, **pipes)
    one, ready = Served(process), threading.Event()

    def read() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            one.lines.append(line)
            found = re.match(r"(view only|view|control): (.*)\n", line)
            if found:
                one.urls[found[1]] = found[2]
            if len(one.urls) == wanted:
                ready.set()
        ready.set()

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        assert ready.wait(START_S)
        assert len(one.urls) == wanted, "".join(one.lines)
        yield one
    finally:
        process.terminate()
        process.wait(START_S)
        reader.join(START_S)
        assert process.stderr is not None
        process.stderr.close()


@contextmanager
def browser() -> Iterator[Any]:
    """A browser with WebGL in software."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(
            executable_path=CHROMIUM,
            args=["--no-sandbox", "--enable-unsafe-swiftshader"],
        )
        yield opened
        opened.close()


@contextmanager
def tab(opened: Any, url: str, width: int = 1280, height: int = 800) -> Iterator[Any]:
    """A tab in which no script fails and that asks no other host for anything."""
    page = opened.new_page(viewport={"width": width, "height": height})
    wrong: list[str] = []
    host = url.partition("//")[2].partition("/")[0]
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)

    def request(asked: Any) -> None:
        if not asked.url.startswith(("blob:", "data:")) and asked.url.split("/")[2] != host:
            wrong.append(f"asked {asked.url}")

    page.on("request", request)
    page.on("websocket", request)
    page.goto(url)
    yield page
    page.close()
    assert not wrong, wrong
