"""A run followed to its end: keys and calls, the line in the terminal, the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from zeromethod.cli.keys import HELP, Keys
from zeromethod.devices.opening import Devices
from zeromethod.operating.auto_exposure import AutoExposure
from zeromethod.operating.readings import Readings
from zeromethod.operating.run_controls import RunControls
from zeromethod.page.process import PageProcess
from zeromethod.page.run_feed import RunFeed
from zeromethod.session.outputs import Record
from zeromethod.session.session import Session
from zeromethod.view.live import LiveStatus


def follow(
    session: Session,
    devices: Devices,
    length: tuple[int | None, float | None],
    page: PageProcess | None,
    *,
    calibration: str = "",
    auto_exposure: bool = False,
    folder: Path,
    recorder: Callable[[Path], Record],
) -> None:
    """Run to the end. length: frames and seconds, as of `Session.run`. calibration: in words.

    auto_exposure: whether the camera's exposure follows the light.
    folder, recorder: where recordings that are begun during the run go, and what makes them.
    """
    total, unit = session.length(*length)
    run = RunControls(session, devices, folder, recorder)
    readings = Readings(session, calibration)
    feed = None if page is None else RunFeed(page, session, readings, devices.clock)
    exposure = AutoExposure(session.rig, run.controls) if auto_exposure else None
    if page is not None:
        page.attach(run.controls)
    with Keys() as keys, LiveStatus(Console(stderr=True), total, unit, HELP if keys.active else "") as live:
        session.loop.on_wait = keys.for_session(session, run.controls)
        for count, step in enumerate(session.run(*length), start=1):
            run.see(step)
            said = readings.see(step)
            if exposure is not None:
                exposure.see(step)
            if page is not None and feed is not None:
                feed.see(step, said)
                live.say(*page.notes())
            live.update(step, count, readings.values)
        run.controls.close()
    if exposure is not None:
        session.result.exposure = exposure.figures
