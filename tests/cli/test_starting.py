"""What a start is doing, and what the line in the terminal says of a run."""

import re
import time
from io import StringIO

import numpy as np
from rich.console import Console

from zeromethod import State, Step, still_busy
from zeromethod.cli.starting import Starting
from zeromethod.page.message import Content
from zeromethod.surface import Peak
from zeromethod.view.live import LiveStatus
from zeromethod.warp.warp import Role, Warp


class Page:
    def __init__(self) -> None:
        self.shown: list[Content] = []

    def offer(self, compose) -> None:
        self.shown.append(compose(frozenset()))


def test_a_start_is_shown_on_the_terminal_and_on_the_page():
    console, page = Console(file=StringIO(), force_terminal=True, width=100), Page()
    with Starting(console, page, "opening LCD and camera") as say:  # type: ignore[arg-type]
        say("preparing the loop")
        say("")
    assert [one.values["reason"] for one in page.shown] == ["opening LCD and camera", "preparing the loop"]
    words = console.file.getvalue()  # type: ignore[attr-defined]
    assert "starting: opening LCD and camera" in words
    assert "starting: preparing the loop" in words


def test_where_there_is_no_terminal_only_what_takes_long_is_said_and_again(monkeypatch):
    monkeypatch.setattr(still_busy, "EVERY_S", 0.02)
    console = Console(file=StringIO(), width=100)
    with Starting(console, None, "opening") as say:
        say("preparing")
        time.sleep(0.2)
        say("")
        said = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    # the same words again say how long it has been
    assert said[0] == "starting: preparing"
    assert all(re.fullmatch(r"starting: preparing \(\d+ s\)", line) for line in said[1:])
    assert len(said) > 1
    time.sleep(0.1)
    assert console.file.getvalue().splitlines()[len(said) + 1 :] == []  # type: ignore[attr-defined]
    assert still_busy.EVERY_S < 2.0


def test_the_line_has_rate_drops_and_sigma_and_depth_while_paused():
    nothing = Warp.drawn(np.zeros((4, 4, 2)), Role.COMMANDED, 0)
    peak = Peak(depth_mm=0.2, x_mm=1.0, y_mm=2.0, sigma_mm=5e-5)
    step = Step(
        number=9,
        time_ns=0,
        time_s=1.0,
        state=State.PAUSED,
        reason="paused: frames are measured, the picture stays",
        residual_rms_px=0.9,
        valid_share=1.0,
        loop_ms=3.0,
        peak=peak,
        commanded=nothing,
        filtered=nothing,
    )
    console = Console(file=StringIO(), force_terminal=True, width=160)
    values = {"peak_sigma_mm": 5e-5, "loop_rate_hz": 59.9, "dropped": 3}
    with LiveStatus(console, None, "seconds") as live:
        live.update(step, 9, values)
    words = console.file.getvalue()  # type: ignore[attr-defined]
    for wanted in ("paused", "peak 200.00 ± 0.05 µm", "60 Hz  3 dropped", "residual 0.900 px"):
        assert wanted in words
