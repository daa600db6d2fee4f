"""Make the picture of the operator's page: a simulated press, seen by a headless browser.

python tools/screenshot.py docs/images/page.png
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
from playwright.sync_api import sync_playwright

WIDTH, HEIGHT = 1280, 800
RUN = ("run", "--scenario", "default", "--seconds", "600", "--view", "127.0.0.1:0")
SHOWN_S = 1.0
"""Time of the run's clock at which the press is held."""

LEVEL = 8
"""Grey levels that become one."""


def shoot(path: Path) -> None:
    """Run, look, and write the picture."""
    chromium = next((found for name in ("chromium", "google-chrome") if (found := shutil.which(name))), None)
    if chromium is None:
        sys.exit("no chromium is installed: sh tools/system-packages.sh test installs it")
    command = [sys.executable, "-m", "zeromethod", *RUN]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as run,
        sync_playwright() as playwright,
    ):
        assert run.stderr is not None
        url = next(found[1] for line in run.stderr if (found := re.match(r"view: (\S+)", line)))
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.goto(url)
        until_s = time.monotonic() + 120
        while not (page.evaluate("zeromethod.values.time_s") or 0) >= SHOWN_S:
            if time.monotonic() > until_s:
                sys.exit("the run did not come so far within two minutes")
            page.wait_for_timeout(50)
        page.keyboard.press("p")  # the picture stays, and so do the figures
        page.wait_for_timeout(1500)
        page.keyboard.press("p")
        page.wait_for_timeout(1000)
        page.screenshot(path=str(path))
        browser.close()
        run.terminate()
    small(path)


def small(path: Path) -> None:
    """The same picture with fewer grey levels a colour: noise costs most of the file."""
    picture = cv2.imread(str(path))
    levels = (picture // LEVEL) * LEVEL + LEVEL // 2
    levels[picture > 255 - LEVEL] = 255
    cv2.imwrite(str(path), levels, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("one file name is wanted: python tools/screenshot.py docs/images/page.png")
    shoot(Path(sys.argv[1]))
