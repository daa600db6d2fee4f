"""The live status of a run in the terminal: one line that follows the loop, silent elsewhere."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from zeromethod.procedures import FrameRecord

_COLOURS = {"locked": "green", "resting": "green", "nulling": "yellow", "starting": "yellow"}


class LiveStatus:
    """Progress bar with state, residual, peak depth and loop time; draws nothing when not on a terminal."""

    def __init__(self, console: Console, total: float, unit: str) -> None:
        """`total` in `unit` ("frames" or "seconds")."""
        self._unit = unit
        self._progress = Progress(
            TextColumn("{task.fields[state]:<18}"),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[figures]}"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._task: TaskID = self._progress.add_task("", total=total, state="starting", figures="")

    def __enter__(self) -> LiveStatus:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def update(self, record: FrameRecord, done_frames: int) -> None:
        """Show the newest frame."""
        state = str(record.state)
        colour = _COLOURS.get(state, "red")
        self._progress.update(
            self._task,
            completed=done_frames if self._unit == "frames" else record.time_s,
            state=f"[{colour}]{state}[/] {record.phase}",
            figures=(
                f"residual {record.residual_rms_px:6.3f} px  peak {1e3 * record.depth_peak_mm:8.2f} um  "
                f"valid {100 * record.valid_share:5.1f} %  loop {record.loop_ms:4.1f} ms"
            ),
        )
