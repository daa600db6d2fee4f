"""A headless browser that looks at a page, and how late what it paints is."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
import threading
from typing import Any

import numpy as np

CHROMIUM = next((path for name in ("chromium", "google-chrome") if (path := shutil.which(name))), None)

_LOOK = """
import json, sys
from playwright.sync_api import sync_playwright
with sync_playwright() as playwright:
    browser = playwright.chromium.launch(executable_path=sys.argv[1], args=[
        "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(sys.argv[2])
    page.wait_for_timeout(5000)
    page.evaluate("() => { zeromethod.latencies_ms.length = 0; zeromethod.arrived.length = 0; }")
    print("ready", flush=True)
    sys.stdin.readline()
    print(json.dumps(page.evaluate("[zeromethod.latencies_ms, zeromethod.arrived]")), flush=True)
    browser.close()
"""


class Browser:
    """A headless browser that looks at a page, in a process of its own."""

    def __init__(self, url: str) -> None:
        """Open the page; `ready` says when it has been open for a while."""
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen([sys.executable, "-c", _LOOK, str(CHROMIUM), url], **pipes)
        self._ready = threading.Event()
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
        self._ready.set()

    def close(self) -> dict[str, float]:
        """Close it; figures of what it painted since it was ready, ms and 1/s; none of too little."""
        try:
            answer, _ = self._process.communicate("\n", 60)
            late_ms, arrived_ms = json.loads(answer.splitlines()[-1])
        finally:
            self._process.kill()
            self._process.wait()
        if len(late_ms) < 3:
            return {}
        return {
            "pixel_p50_ms": float(np.median(late_ms)),
            "pixel_p99_ms": float(np.percentile(late_ms, 99)),
            "painted_hz": 1e3 * (len(arrived_ms) - 1) / (arrived_ms[-1] - arrived_ms[0]),
        }
