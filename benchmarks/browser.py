"""A headless browser that looks at a page: how late what it paints is, by stage, and what that costs it."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import threading
from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

CHROMIUM = next((path for name in ("chromium", "google-chrome") if (path := shutil.which(name))), None)

STAGES = ("exposed", "stepped", "composed", "received", "packed", "arrived", "decoded", "painted")
"""What happens to a picture, in turn; each has a time stamp by the host's clock."""

_LOOK = """
import json, sys
from playwright.sync_api import sync_playwright
with sync_playwright() as playwright:
    browser = playwright.chromium.launch(executable_path=sys.argv[1], args=[
        "--no-sandbox", "--enable-unsafe-swiftshader"])
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.wait_for_timeout(1000)
    print("open", flush=True)
    page.wait_for_timeout(1000)
    page.goto(sys.argv[2])
    page.wait_for_function("() => zeromethod.contents > 0", timeout=60000)
    first = page.evaluate("zeromethod.first_ms")
    page.wait_for_timeout(5000)
    page.evaluate("() => { zeromethod.stages.length = 0; zeromethod.arrived.length = 0; }")
    print("ready", flush=True)
    sys.stdin.readline()
    print(json.dumps([first, *page.evaluate("[zeromethod.stages, zeromethod.arrived]")]), flush=True)
    browser.close()
"""


def family(root: int) -> dict[int, float]:
    """Processor time, s, that a process and each of all that it started has used so far."""
    children, used_s = defaultdict(list), {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            fields = (folder / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
            children[int(fields[1])].append(int(folder.name))
            used_s[int(folder.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    found, waiting = {}, [root]
    while waiting:
        number = waiting.pop()
        found[number] = used_s.get(number, 0.0)
        waiting += children[number]
    return found


def processor_s(root: int) -> float:
    """Processor time that a process and all that it started have used so far, s."""
    return sum(family(root).values())


def _as_much_of_a_core(root: int) -> None:
    """Give a process and all that it started, in sessions of their own, the weight that this session has."""
    group = Path("/proc/self/autogroup")
    if group.exists():
        nice = group.read_text(encoding="ascii").split()[-1]
        for number in family(root):
            with suppress(OSError):
                Path(f"/proc/{number}/autogroup").write_text(nice, encoding="ascii")


class Browser:
    """A headless browser that looks at a page, in a process of its own."""

    def __init__(self, url: str) -> None:
        """Open the page; `ready` says when it has been open for a while."""
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen([sys.executable, "-c", _LOOK, str(CHROMIUM), url], **pipes)
        self._ready = threading.Event()
        self._from_s = 0.0
        threading.Thread(target=self._await_ready, daemon=True).start()

    @staticmethod
    def there() -> bool:
        """Whether one is installed."""
        return CHROMIUM is not None and importlib.util.find_spec("playwright") is not None

    @property
    def ready(self) -> bool:
        """Whether it has begun to count, or has ended."""
        return self._ready.is_set() or self._process.poll() is not None

    def _await_ready(self) -> None:
        assert self._process.stdout is not None
        self._process.stdout.readline()
        _as_much_of_a_core(self._process.pid)
        self._process.stdout.readline()
        self._from_s = processor_s(self._process.pid)
        self._ready.set()

    def close(self) -> dict[str, Any]:
        """Close it; figures of what it painted since it was ready, ms and 1/s; none of too little.

        stages_ms: from one stage to the next, (median, 99 %), by the name of the later one. first_ms: from
        the page's request until its first picture was painted. picture_ms: its processor time per picture.
        """
        used_s = processor_s(self._process.pid) - self._from_s
        try:
            answer, _ = self._process.communicate("\n", 60)
            first_ms, stages, arrived_ms = json.loads(answer.splitlines()[-1])
        finally:
            self._process.kill()
            self._process.wait()
        if len(stages) < 3:
            return {}
        at_ms = np.array([[one[name] for name in STAGES] for one in stages])
        parts = np.diff(at_ms, axis=1)
        late_ms = at_ms[:, -1] - at_ms[:, 0]
        return {
            "pixel_p50_ms": float(np.median(late_ms)),
            "pixel_p99_ms": float(np.percentile(late_ms, 99)),
            "painted_hz": 1e3 * (len(arrived_ms) - 1) / (arrived_ms[-1] - arrived_ms[0]),
            "first_ms": first_ms,
            "picture_ms": 1e3 * used_s / len(arrived_ms),
            "stages_ms": {
                name: (float(np.median(part)), float(np.percentile(part, 99)))
                for name, part in zip(STAGES[1:], parts.T, strict=True)
            },
        }
