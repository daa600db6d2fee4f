"""The live status of a run: one line in the terminal, and notes above it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from zeromethod.approach import FAULTY
from zeromethod.contact import ContactFigures
from zeromethod.loop.state import State
from zeromethod.loop.step import StepFigures
from zeromethod.operating.lasting import LastingState
from zeromethod.still_busy import StillBusy
from zeromethod.view.progress import PlainLines

STATE_COLOURS = {
    State.LOCKED: "#2e9e5b",
    State.RESTING: "#7cc7a0",
    State.APPROACH: "#5b7fd9",
    State.PASSIVE: "#3f8f8c",
    State.NULLING: "#e0b100",
    State.STARTING: "#c9b26b",
    State.HOLDING: "#e07b00",
    State.PAUSED: "#4fa3d1",
    State.UNCALIBRATED: "#a98467",
    State.MOVED: "#ff5d8f",
    State.COVERED: "#8d6e63",
    State.LOST: "#b5179e",
    State.FAULT: "#d62828",
    State.STOPPED: "#808080",
}
EXPLAINED = frozenset(
    {
        State.APPROACH,
        State.HOLDING,
        State.UNCALIBRATED,
        State.MOVED,
        State.COVERED,
        State.LOST,
        State.FAULT,
    }
)
"""States whose reason is shown in place of the figures."""

_STATE, _TIME, _BAR = 9, 7, 10
"""Columns of the terminal that each takes at least."""


def fitting(parts: Sequence[tuple[int, str]], width: int) -> str:
    """As many parts as fit into so many columns, in their order; of the last rank first to go, 0 never."""
    kept = list(parts)
    while len(line := "  ".join(text for _, text in kept)) > width and (last := max(kept))[0] > 0:
        kept.remove(last)
    return line


def contact_words(touching: Sequence[ContactFigures]) -> str:
    """What touches, in a few words; "" for nothing."""
    force = sum(one.force_n for one in touching)
    how_hard = f", {force:.3f} N" if math.isfinite(force) else ""
    if len(touching) > 1:
        return f"{len(touching)} contacts of {sum(one.area_mm2 for one in touching):.2f} mm²{how_hard}"
    return "".join(f"contact {one.id} of {one.area_mm2:.2f} mm²{how_hard}" for one in touching)


class LiveStatus:
    """Progress bar with state, residual, peak depth and loop time; a line now and then without a terminal.

    Notes are printed above it, and where there is no terminal; there, too, that it is starting, if the first
    frame takes long. In the states of `EXPLAINED` it shows the
    reason in place of the figures.
    """

    def __init__(self, console: Console, total: float | None, unit: str, keys: str = "") -> None:
        """`total` in `unit` ("frames" or "seconds"), None: no end is known. keys: what each does."""
        self._unit, self._total = unit, total
        self._lines = PlainLines(console)
        self._peak_mm: float | None = None
        self._touching = ""
        self._lasting = LastingState()
        self._figures = ""
        self._console = console
        self._progress = Progress(
            # what matters most is never cut short; in a narrow terminal the figures are
            TextColumn("{task.fields[state]}", table_column=Column(no_wrap=True, min_width=_STATE)),
            TimeElapsedColumn(table_column=Column(no_wrap=True, min_width=_TIME)),
            *([] if total is None else [BarColumn(bar_width=_BAR)]),
            # figures are chosen to fit; a reason takes as many lines as it needs
            TextColumn("{task.fields[figures]}", table_column=Column(overflow="fold", ratio=1)),
            console=console,
            disable=not console.is_terminal,
        )
        if keys and console.is_terminal:
            console.print(f"keys: {keys}", style="dim", highlight=False)
        self._busy = StillBusy(lambda words: console.print(words, highlight=False, soft_wrap=True))
        self._task: TaskID = self._progress.add_task("", total=total, state="starting", figures="")

    def __enter__(self) -> LiveStatus:
        self._progress.start()
        if not self._console.is_terminal:
            self._busy.doing("starting: waiting for the first frame")
        return self

    def __exit__(self, *_: object) -> None:
        self._busy.close()
        self._progress.stop()

    def say(self, *notes: str) -> None:
        """Print notes above the line, and where there is no terminal."""
        for note in notes:
            self._console.print(
                f"note: {note}", style="yellow", markup=False, highlight=False, soft_wrap=True
            )

    def update(self, step: StepFigures, done_frames: int, values: Mapping[str, Any] | None = None) -> None:
        """Show the newest frame. values: of the run (`zeromethod.operating.run_table`), where there are."""
        self._busy.close()
        self.say(*step.notes)
        if step.peak is not None:
            self._peak_mm = step.peak.depth_mm
            self._touching = contact_words(step.touching)
        state = self._lasting.see(step.state, step.time_s)
        if state is step.state:
            self._figures = step.reason
            if state not in EXPLAINED:
                self._figures = fitting(self._measured(step, values or {}), self._width_of_figures(state))
        done = done_frames if self._unit == "frames" else step.time_s
        of = "" if self._total is None else f" of {self._total:g}"
        self._lines.say(lambda: f"{round(done, 1):g}{of} {self._unit}: {state}  {self._figures}")
        self._progress.update(
            self._task,
            completed=done,
            state=f"[{STATE_COLOURS[state]}]{state}[/]",
            figures=escape(self._figures),
        )

    def _width_of_figures(self, state: State) -> int:
        """Columns of the terminal that state, time and bar, each with a blank, leave."""
        bar = 0 if self._progress.tasks[0].total is None else _BAR + 1
        return self._console.width - max(len(state), _STATE) - 1 - _TIME - 1 - bar - 1

    def _measured(self, step: StepFigures, values: Mapping[str, Any]) -> list[tuple[int, str]]:
        """The figures that are known, or what is waited for, each after its rank: 0 matters most."""
        parts = [(4, step.phase)] if step.phase else []
        if self._peak_mm is not None:
            sigma_mm = values.get("peak_sigma_mm")
            sigma = "" if sigma_mm is None else f" ± {1e3 * sigma_mm:.2f}"
            relative = "" if step.calibrated else " (relative)"
            parts.append((0, f"peak {1e3 * self._peak_mm:.2f}{sigma} µm{relative}"))
        if self._touching:
            parts.append((1, self._touching))
        if step.contact_status is not None:
            parts.append((1, step.contact_status.words))
        if step.approach is not None and step.approach.watching in FAULTY:
            parts.append((1, step.approach.watching))
        if math.isfinite(step.residual_rms_px):
            parts.append((3, f"residual {step.residual_rms_px:.3f} px"))
            parts.append((2, f"valid {100 * step.valid_share:.1f} %"))
            if (rate_hz := values.get("loop_rate_hz")) is not None:
                parts.append((5, f"{rate_hz:.0f} Hz  {values['dropped']} dropped"))
            parts.append((6, f"loop {step.loop_ms:.1f} ms"))
        elif self._peak_mm is None:
            parts.append((0, "waiting for a frame that shows the pattern"))
        return parts
