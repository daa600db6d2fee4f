"""A whole run in one call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig
from zeromethod.session.outputs import Record, StepPublisher
from zeromethod.session.result import RunResult
from zeromethod.session.session import Session


def run(
    rig: Rig | str | Path,
    *,
    frames: int | None = None,
    seconds: float | None = None,
    on_step: Callable[[Step], None] | None = None,
    publisher: StepPublisher | str | None = None,
    record: Record = None,
) -> RunResult:
    """Open a rig's devices, close the loop for a while, read every frame, close the devices.

    Parameters
    ----------
    rig : Rig, str or Path
        A rig, a rig file, or the name of a packaged rig.
    frames : int, optional
        Number of camera frames.
    seconds : float, optional
        Time of the run's clock; without both, that of `Session.length`.
    on_step : callable, optional
        Called with every step, as `Session.run` yields it.
    publisher : str, optional
        Address at which to publish, as `Session` takes it.
    record : str or Path, optional
        File in which to record, as `Session` takes it.

    Returns
    -------
    RunResult
        Figures of every step; `interrupted` is set where Ctrl-C ended the run early.

    Raises
    ------
    InputError
        For a rig that cannot be used, or devices that cannot be opened.
    """
    with Session(rig, publisher=publisher, record=record) as session:
        for step in session.run(frames, seconds):
            if on_step is not None:
                on_step(step)
        return session.result
