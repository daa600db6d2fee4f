"""Make a picture of the operator's page: a simulated press, seen by a headless browser.

python tools/screenshot.py docs/images/page.png
python tools/screenshot.py docs/interactive.png Projector 0.45 --rig interactive
The second opens a tab, at a time of the run's clock in s, of a run with other options.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

WIDTH, HEIGHT = 1280, 800
RUN = ("run", "--seconds", "600", "--view", "127.0.0.1:0")
PRESS = ("--scenario", "ball")
SHOWN_S = 0.9
"""Time of the run's clock at which the press is held."""
PATIENCE_S = 600.0
COLOURS = 256
"""Of the picture's palette, which keeps the file small."""


def shoot(path: Path, tab: str, at_s: float, options: Sequence[str]) -> None:
    """Run with these options, look at that time, with a tab open if one is given, and write the picture."""
    chromium = next((found for name in ("chromium", "google-chrome") if (found := shutil.which(name))), None)
    if chromium is None:
        sys.exit("no chromium is installed: sh tools/system-packages.sh test installs it")
    command = [sys.executable, "-m", "zeromethod", *RUN, *options]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as run,
        sync_playwright() as playwright,
    ):
        assert run.stderr is not None
        url = next(found[1] for line in run.stderr if (found := re.match(r"view: (\S+)", line)))
        arguments = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.goto(url)
        if tab:  # what it shows comes with the next frames
            page.get_by_role("button", name=tab, exact=True).click(timeout=1e3 * PATIENCE_S)
        until_s = time.monotonic() + PATIENCE_S
        while not (page.evaluate("zeromethod.values.time_s") or 0) >= at_s:
            if time.monotonic() > until_s:
                sys.exit(f"the run did not come so far within {PATIENCE_S:.0f} s")
            page.wait_for_timeout(50)
        page.screenshot(path=str(path))
        browser.close()
        run.terminate()
    with Image.open(path) as picture:
        few = picture.convert("RGB").quantize(COLOURS, kmeans=3, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("a file name is wanted: python tools/screenshot.py docs/images/page.png")
    name, *more = sys.argv[1:]
    tab, at_s, *options = more or ("", SHOWN_S, *PRESS)
    shoot(Path(name), tab, float(at_s), options)
