"""`zeromethod devices --focus`: setting up by eye, live in the terminal."""

from __future__ import annotations

import threading
from pathlib import Path

from rich.console import Console

from zeromethod.cli.device_options import (
    REAL_CAMERAS,
    BenchOptions,
    given_rig,
    opened_devices,
    say_simulated,
    with_devices,
    without_display,
)
from zeromethod.cli.guide_page import guide_page, show_sight
from zeromethod.cli.keys import Keys
from zeromethod.cli.output import write_summary
from zeromethod.clock import SimulatedClock
from zeromethod.commissioning.setting_up import FLICKER_FRAMES, SettingUp, Sight
from zeromethod.errors import MeasurementError
from zeromethod.operating.guide_tables import FOCUS
from zeromethod.optics import check_geometry
from zeromethod.view.focus import focus_view, sight_figures, sight_table

_KEYS = "q ends"


def watch_focus(
    rig_name: str,
    options: BenchOptions,
    seconds: float | None,
    summary: Path | None,
    view: str | None = None,
) -> None:
    """Show figures until q, Ctrl-C or `seconds`; the last ones as a table and `summary`; see `SettingUp`."""
    rig = with_devices(given_rig(rig_name), options, camera_alone=True).model_copy(
        update={"scenario": "none"}
    )
    with_lcd = rig.camera.driver not in REAL_CAMERAS or rig.display.driver != "simulated"
    if not with_lcd:
        rig = without_display(rig)
    check_geometry(rig)
    say_simulated(rig)
    console = Console()
    last: Sight | None = None
    try:
        stopped = threading.Event()
        with (
            guide_page(view, FOCUS, rig.camera.bits, stopped.set) as feed,
            opened_devices(rig, err=False) as devices,
        ):
            if seconds is None and isinstance(devices.clock, SimulatedClock):
                # nobody turns a lens there: as long as the figures need
                seconds = FLICKER_FRAMES / rig.camera.rate_hz
            with Keys() as keys, focus_view(console, _KEYS if keys.active else "") as show:
                for sight in SettingUp(rig, devices, with_lcd).sights(seconds):
                    last = sight
                    show(sight)
                    if feed is not None:
                        show_sight(feed, sight)
                    if "q" in keys.pressed().lower() or stopped.is_set():
                        break
    finally:
        if last is not None:
            if not console.is_terminal:
                console.print(sight_table(last))
            if summary is not None:
                write_summary(summary, sight_figures(last))
    if last is None:
        raise MeasurementError("focus: no frame came")
