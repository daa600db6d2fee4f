"""Setting up by eye in the terminal: the newest frame's figures, live, or a line of them every second."""

from __future__ import annotations

import math
from dataclasses import asdict
from types import TracebackType
from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from zeromethod.arrays import Float
from zeromethod.commissioning.orientation import Orientation
from zeromethod.commissioning.setting_up import Sight

_BARS = " ▁▂▃▄▅▆▇█"
_UPDATES_HZ = 4
_LINE_EVERY_S = 1.0


def sparkline(shares: Float) -> str:
    """One character per share, by its square root, so that few pixels still show."""
    heights = np.sqrt(shares / max(float(shares.max()), 1e-12))
    return "".join(_BARS[math.ceil(height * (len(_BARS) - 1))] for height in heights)


def sight_table(sight: Sight) -> RenderableType:
    """Figures of one frame, and what to do."""
    report = sight.report
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    blur = f"(blur {report.blur_px:.1f} px)" if math.isfinite(report.blur_px) else ""
    table.add_row("focus score, 0 to 1", f"{_number(report.score, '.3f')} {blur}")
    for row, label in zip(report.modulation, ("... by region", "", ""), strict=True):
        table.add_row(label, "  ".join(_number(value, ".2f") for value in row))
    light = f"mean {report.mean_grey:.0f}, brightest {report.bright_grey:.0f} of {report.full_grey:.0f}"
    table.add_row("exposure", f"{1e-6 * sight.frame.exposure_ns:.3g} ms; {light}")
    table.add_row("grey levels", f"|{sparkline(report.histogram)}|")
    table.add_row("saturated", f"{report.saturated_share:.2%} of the pixels")
    table.add_row("should see the LCD", f"{report.seen_share:.0%} of the view, by the rig file")
    table.add_row("usable of that", f"{report.usable_share:.1%} ({report.dark_share:.1%} dark)")
    if math.isfinite(sight.flicker_share):
        table.add_row("flicker", f"{sight.flicker_share:.2%} from frame to frame")
    if sight.seen is not None:
        stray = f"stray light {_number(sight.seen.stray_share, '.1%')}"
        table.add_row("LCD", f"seen in {sight.seen.seen_share:.0%} of the image; {_lie(sight.seen)}; {stray}")
    if (place := sight.place) is not None:
        size = f"{place.wider:+.1%} wide, {place.higher:+.1%} high, turned by {place.turn_deg:+.1f} degrees"
        table.add_row(
            "picture, by the rig file", f"{size}, {place.right_px:+.1f} px right, {place.down_px:+.1f} down"
        )
    lines = [Text(f"-> {line}", style="yellow" if sight.advice else "green") for line in sight.lines]
    return Group(table, *lines)


def _lie(seen: Orientation) -> str:
    if not math.isfinite(seen.turn_deg):
        return "how it lies is not known"
    if seen.upright:
        return "the right way round"
    return ("mirrored, " if seen.mirrored else "") + f"turned by {90 * seen.quarter_turns} degrees"


def sight_line(sight: Sight) -> str:
    """The same in one line."""
    report = sight.report
    return (
        f"{sight.time_s:6.1f} s  focus {_number(report.score, '.3f')}  grey {report.mean_grey:.0f}"
        f"  brightest {report.bright_grey:.0f}/{report.full_grey:.0f}  saturated {report.saturated_share:.1%}"
        f"  usable {report.usable_share:.0%}  {sight.lines[0]}"
    )


def sight_figures(sight: Sight) -> dict[str, Any]:
    """The same for `--summary`."""
    report = {name: value for name, value in vars(sight.report).items() if name != "alignment"}
    return {
        "time_s": sight.time_s,
        "focus_score": report.pop("score"),
        "focus_by_region": report.pop("modulation"),
        "exposure_s": 1e-9 * sight.frame.exposure_ns,
        **report,
        "flicker_share": sight.flicker_share,
        "picture": None if sight.place is None else asdict(sight.place),
        "lcd": None if sight.seen is None else asdict(sight.seen),
        "advice": sight.lines,
    }


class FocusView:
    """Shows sights as they come: a table that renews itself on a terminal, else a line every second.

    keys: what they do, shown below the table; "" for none.
    """

    def __init__(self, console: Console, keys: str = "") -> None:
        self._console = console
        self._keys = keys
        self._live = Live(console=console, refresh_per_second=_UPDATES_HZ) if console.is_terminal else None
        self._last_s = -math.inf

    def __enter__(self) -> FocusView:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, sight: Sight) -> None:
        """Show the newest frame."""
        if self._live is not None:
            self._live.update(Group(sight_table(sight), Text(self._keys, style="dim")))
        elif sight.time_s - self._last_s >= _LINE_EVERY_S:
            self._last_s = sight.time_s
            self._console.print(sight_line(sight), soft_wrap=True, highlight=False, markup=False)


def _number(value: float, pattern: str) -> str:
    return format(value, pattern) if math.isfinite(value) else "-"
