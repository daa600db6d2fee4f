"""Setting up by eye in the terminal: the newest frame's figures, live, or a line of them every second."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from zeromethod.arrays import Float
from zeromethod.commissioning.orientation import Orientation
from zeromethod.commissioning.setting_up import Sight
from zeromethod.view.table import pair_table

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
    blur = f"(blur {report.blur_px:.1f} px)" if math.isfinite(report.blur_px) else ""
    rows = [("focus score, 0 to 1", f"{_number(report.score, '.3f')} {blur}")]
    for row, label in zip(report.modulation, ("... by region", "", ""), strict=True):
        rows.append((label, "  ".join(_number(value, ".2f") for value in row)))
    light = f"mean {report.mean_grey:.0f}, brightest {report.bright_grey:.0f} of {report.full_grey:.0f}"
    rows += [
        ("exposure", f"{1e-6 * sight.frame.exposure_ns:.3g} ms; {light}"),
        ("... for the least noise", f"{_number(1e3 * sight.advised_exposure_s, '.3g')} ms"),
        ("grey levels", f"|{sparkline(report.histogram)}|"),
        ("saturated", f"{report.saturated_share:.2%} of the pixels"),
        ("should see the LCD", f"{report.seen_share:.0%} of the view, by the rig file"),
        ("usable of that", f"{report.usable_share:.1%} ({report.dark_share:.1%} dark)"),
    ]
    if math.isfinite(sight.flicker_share):
        lamps = f"; lamps at {sight.mains_hz:.0f} Hz" if math.isfinite(sight.mains_hz) else ""
        rows.append(("flicker", f"{sight.flicker_share:.2%} from frame to frame{lamps}"))
    if (seen := sight.seen) is not None:
        stray = f"stray light {_number(seen.stray_share, '.1%')}"
        rows.append(("LCD", f"visible in {seen.seen_share:.0%} of the image; {_lie(seen)}; {stray}"))
    if (place := sight.place) is not None:
        size = (
            f"{place.wider:+z.1%} wide, {place.higher:+z.1%} high, turned by {place.turn_deg:+z.1f} degrees"
        )
        where = f"{place.right_px:+z.1f} px right, {place.down_px:+z.1f} down"
        rows.append(("picture, by the rig file", f"{size}, {where}"))
    lines = [Text(f"-> {line}", style="yellow" if sight.advice else "green") for line in sight.lines]
    return Group(pair_table(rows), *lines)


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
        "mains_hz": sight.mains_hz,
        "advised_exposure_s": sight.advised_exposure_s,
        "picture": None if sight.place is None else asdict(sight.place),
        "lcd": None if sight.seen is None else asdict(sight.seen),
        "advice": sight.lines,
    }


@contextmanager
def focus_view(console: Console, keys: str = "") -> Iterator[Callable[[Sight], None]]:
    """Show sights as they come: a table that renews itself on a terminal, else a line every second.

    keys: what they do, shown below the table; "" for none. Gives what is called with the newest sight.
    """
    if console.is_terminal:
        with Live(console=console, refresh_per_second=_UPDATES_HZ) as live:
            yield lambda sight: live.update(Group(sight_table(sight), Text(keys, style="dim")))
        return
    last_s = -math.inf

    def print_line(sight: Sight) -> None:
        nonlocal last_s
        if sight.time_s - last_s >= _LINE_EVERY_S:
            last_s = sight.time_s
            console.print(sight_line(sight), soft_wrap=True, highlight=False, markup=False)

    yield print_line


def _number(value: float, pattern: str) -> str:
    return format(value, pattern) if math.isfinite(value) else "-"
