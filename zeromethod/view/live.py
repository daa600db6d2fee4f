"""The live status of a run: one line in the terminal, and what the operator should know."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from zeromethod.loop.step import Step

_COLOURS = {
    "locked": "green",
    "resting": "green",
    "nulling": "yellow",
    "starting": "yellow",
    "paused": "cyan",
}
_EXPLAINED = frozenset({"holding", "lost", "fault", "paused"})


class LiveStatus:
    """Progress bar with state, residual, peak depth and loop time, which only a terminal shows.

    Notes are printed above it, elsewhere too. In `holding`, `lost`, `fault` and `paused` the reason stands in
    place of the figures.
    """

    def __init__(self, console: Console, total: float | None, unit: str, keys: str = "") -> None:
        """`total` in `unit` ("frames" or "seconds"), None: no end is known. keys: what they do."""
        self._unit = unit
        self._peak_mm = float("nan")
        self._console = console
        self._progress = Progress(
            # what matters most is never cut short; in a narrow terminal the figures are
            TextColumn("{task.fields[state]}", table_column=Column(no_wrap=True, min_width=9)),
            TimeElapsedColumn(table_column=Column(no_wrap=True, min_width=7)),
            *([] if total is None else [BarColumn(bar_width=10)]),
            TextColumn(
                "{task.fields[figures]}", table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1)
            ),
            console=console,
            disable=not console.is_terminal,
        )
        if keys and console.is_terminal:
            console.print(f"keys: {keys}", style="dim", highlight=False)
        self._task: TaskID = self._progress.add_task("", total=total, state="starting", figures="")

    def __enter__(self) -> LiveStatus:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def update(self, step: Step, done_frames: int) -> None:
        """Show the newest frame."""
        for note in step.notes:
            self._console.print(
                f"note: {note}", style="yellow", markup=False, highlight=False, soft_wrap=True
            )
        if step.peak is not None:
            self._peak_mm = step.peak.depth_mm
        state = str(step.state)
        colour = _COLOURS.get(state, "red")
        figures = (
            f"peak {1e3 * self._peak_mm:.2f} um  residual {step.residual_rms_px:.3f} px  "
            f"valid {100 * step.valid_share:.1f} %  loop {step.loop_ms:.1f} ms"
        )
        self._progress.update(
            self._task,
            completed=done_frames if self._unit == "frames" else step.time_s,
            state=f"[{colour}]{state}[/]",
            figures=escape(step.reason if state in _EXPLAINED else f"{step.phase}  {figures}".strip()),
        )
