"""A recording followed while it grows: state, rate, residual and peak depth in another terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from zeromethod.errors import InputError
from zeromethod.loop.state import State
from zeromethod.loop.step import NAN
from zeromethod.recording.recording import Recording
from zeromethod.view.live import EXPLAINED, STATE_COLOURS
from zeromethod.view.table import cell

PERIOD_S = 0.2
"""How often the file is looked at."""

STALLED_S = 3.0
"""Silence of the writer that is reported."""

_BEGINNING_S = 10.0
"""How long a new file may not be a recording yet."""

_REST = 9.0
"""Pause after a look, in times of how long the look took."""

_RECENT_NS = 2_000_000_000
"""Time over which the rate is taken."""


@dataclass(frozen=True)
class Glance:
    """State of a growing recording. time_s from its start; rate_hz: frames per second lately; NaN unknown."""

    time_s: float = 0.0
    state: State = State.STARTING
    reason: str = ""
    rate_hz: float = NAN
    residual_rms_px: float = NAN
    peak_mm: float = NAN
    peak_sigma_mm: float = NAN
    dropped: int = 0

    def words(self) -> str:
        """One line, without the state."""
        if self.state in EXPLAINED:
            return self.reason
        parts = [
            f"{self.rate_hz:.1f} frames/s",
            f"residual {self.residual_rms_px:.3f} px",
            f"peak {1e3 * self.peak_mm:.2f} µm (sigma {cell(1e3 * self.peak_sigma_mm, '{:.2f}')})",
        ]
        known = (self.rate_hz, self.residual_rms_px, self.peak_mm)
        finite = [part for part, value in zip(parts, known, strict=True) if np.isfinite(value)]
        return "  ".join([*finite, *([f"dropped {self.dropped}"] if self.dropped else [])])


class Tail:
    """The end of a recording that is still being written."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._steps = 0
        self._notes = 0

    @property
    def complete(self) -> bool:
        """Whether the writer has closed the file."""
        return self._recording.complete

    def grown(self) -> bool:
        """Look again; whether there are new steps."""
        self._recording.refresh()
        before, self._steps = self._steps, len(self._recording.steps)
        return self._steps > before

    def glance(self) -> Glance:
        """Its newest state and figures."""
        recording = self._recording
        steps, peaks = recording.steps, recording.peaks
        if not len(steps):
            return Glance()
        last = steps[-1]
        known = steps["residual_rms_px"][np.isfinite(steps["residual_rms_px"])]
        times = steps["time_ns"][steps["frame_number"] >= 0]
        recent = times[times > last["time_ns"] - _RECENT_NS]
        span_ns = int(recent[-1] - recent[0]) if len(recent) > 1 else 0
        return Glance(
            time_s=recording.seconds,
            state=recording.state_of(last),
            reason=recording.text(last["reason"]),
            rate_hz=1e9 * (len(recent) - 1) / span_ns if span_ns else NAN,
            residual_rms_px=float(known[-1]) if len(known) else NAN,
            peak_mm=float(peaks["depth_mm"][-1]) if len(peaks) else NAN,
            peak_sigma_mm=float(peaks["depth_sigma_mm"][-1]) if len(peaks) else NAN,
            dropped=int(np.sum(recording.drops["count"])),
        )

    def notes(self) -> list[str]:
        """Notes since the last call."""
        notes = self._recording.notes
        new, self._notes = notes[self._notes :], len(notes)
        return [self._recording.text(note["text"]) for note in new]


class FollowDisplay:
    """One line that changes, in a terminal; a line per second elsewhere."""

    def __init__(self, console: Console, now: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._now = now
        self._live = Live(console=console, refresh_per_second=1 / PERIOD_S) if console.is_terminal else None
        self._shown_at = float("-inf")
        self._stalled = False

    def __enter__(self) -> FollowDisplay:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, text: str, style: str = "") -> None:
        """A line that is not replaced."""
        self._console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

    def show(self, glance: Glance, silent_s: float = 0.0, *, last: bool = False) -> None:
        """Show the newest state; silent_s: time since new data came."""
        state = (glance.state, STATE_COLOURS[glance.state])
        line = Text.assemble(
            f"{glance.time_s:8.1f} s  ", state, f"  {glance.words()}", no_wrap=True, overflow="ellipsis"
        )
        stalled, before = silent_s >= STALLED_S, self._stalled
        self._stalled = stalled
        if self._live is not None:
            self._live.update(line.append(f"  no new data for {silent_s:.0f} s", "red") if stalled else line)
        elif stalled:
            if not before:
                self.say(f"no new data for {STALLED_S:.0f} s")
        elif last or self._now() - self._shown_at >= 1.0:
            self._shown_at = self._now()
            self.say(line.plain)


def follow(path: Path, console: Console, *, sleep: Callable[[float], None] = time.sleep) -> None:
    """Show how a recording grows until its writer closes it. A file that is not there yet is waited for.

    Raises InputError for a file that is not a recording.
    """
    with FollowDisplay(console) as display:
        if not path.exists():
            display.say(f"waiting for {path}")
        while not path.exists():
            sleep(PERIOD_S)
        with _open(path, sleep) as recording:
            _watch(Tail(recording), display, sleep)
        display.say("recording ended")


def _watch(tail: Tail, display: FollowDisplay, sleep: Callable[[float], None]) -> None:
    new_at = time.monotonic()
    ended = False
    while not ended:
        looked_at = time.monotonic()
        if tail.grown():
            new_at = time.monotonic()
        ended = tail.complete
        if ended:
            tail.grown()  # what came between the look and the end
        for note in tail.notes():
            display.say(f"note: {note}", "yellow")
        display.show(tail.glance(), 0.0 if ended else time.monotonic() - new_at, last=ended)
        if not ended:
            # tables grow: leave most of the time to the process that records
            sleep(max(PERIOD_S, _REST * (time.monotonic() - looked_at)))


def _open(path: Path, sleep: Callable[[float], None]) -> Recording:
    """Open a recording; a file that is only just being made is given time to become one."""
    patience_s = _BEGINNING_S
    while True:
        try:
            return Recording(path)
        except (InputError, OSError, KeyError, RuntimeError):  # half a file fails in many ways
            patience_s -= PERIOD_S
            if patience_s < 0 or time.time() - path.stat().st_mtime > _BEGINNING_S:
                raise
            sleep(PERIOD_S)
