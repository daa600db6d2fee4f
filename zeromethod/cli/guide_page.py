"""The operator's page while a bench is set up or calibrated."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

from zeromethod.cli.output import TerminalPrompts
from zeromethod.cli.page_options import opened_page
from zeromethod.commissioning.setting_up import Sight
from zeromethod.devices.contract import RAISED, said_by
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import Camera
from zeromethod.operating.controls import Controls
from zeromethod.operating.readings import number
from zeromethod.operating.table import Table
from zeromethod.page.guide_feed import GuideFeed, WatchedCamera
from zeromethod.view.focus import sight_figures

LAST_LOOK_S = 0.4
"""How long the last values have to reach the page before it ends."""


def _interrupt() -> None:
    """End as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def guide_page(
    view: str | None, table: Table, bits: int, stop: Callable[[], None] = _interrupt
) -> Iterator[GuideFeed | None]:
    """The page of a procedure; None where none was asked for. How the procedure ends is shown there."""
    with opened_page(view, None, table) as page:
        if page is None:
            yield None
            return
        feed = GuideFeed(page, table, Controls(table, {"stop": stop}), bits)
        try:
            yield feed
        except RAISED as error:
            feed.set(state="failed", reason=said_by(error), fresh=False)
            raise
        finally:
            time.sleep(LAST_LOOK_S)
            feed.close()


def watched(devices: Devices, feed: GuideFeed | None) -> Devices:
    """The same devices, with the camera's pictures on the page."""
    if feed is not None:
        devices.camera = cast(Camera, WatchedCamera(devices.camera, feed))
    return devices


class PagePrompts(TerminalPrompts):
    """Prompts in the terminal and on the page."""

    def __init__(self, feed: GuideFeed | None) -> None:
        self._feed = feed

    @contextmanager
    def part(self, words: str, total: int) -> Iterator[Callable[[], object]]:
        """A bar over `total` steps."""
        feed = self._feed
        if feed is None:
            with super().part(words, total) as advance:
                yield advance
            return
        done = 0
        feed.set(state="working", step_name=words, progress=0.0)
        with super().part(words, total) as advance:

            def both() -> None:
                nonlocal done
                done += 1
                feed.set(progress=min(1.0, done / max(total, 1)))
                advance()

            yield both

    def say(self, words: str) -> None:
        """A line."""
        super().say(words)
        if self._feed is not None:
            self._feed.say(words)


def show_sight(feed: GuideFeed, sight: Sight) -> None:
    """Show a frame of setting up by eye, with its figures and advice."""
    figures: dict[str, Any] = sight_figures(sight)
    names = (
        "focus_score",
        "blur_px",
        "mean_grey",
        "bright_grey",
        "full_grey",
        "saturated_share",
        "usable_share",
    )
    values = {name: number(float(figures[name])) for name in (*names, "flicker_share")}
    feed.set(
        **values,
        state="working" if sight.advice else "done",
        reason="" if sight.advice else "nothing is left to do",
        step_name="Set up by eye",
        instruction=sight.lines[0],
        lines=list(sight.lines),
        exposure_ms=1e-6 * sight.frame.exposure_ns,
    )
    feed.picture(sight.frame)
