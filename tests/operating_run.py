"""A run of the simulated bench with its controls and values, as `zeromethod run` puts them together."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from recorded_run import small_rig

from zeromethod import Session, Step, open_devices
from zeromethod.operating.readings import Readings
from zeromethod.operating.run_controls import RunControls


class Operated:
    """A session whose controls are attended to in every step."""

    def __init__(self, session: Session, devices: Any, folder: Path) -> None:
        self.session = session
        self.devices = devices
        self.run = RunControls(session, devices, folder)
        self.readings = Readings(session)
        self.controls = self.run.controls
        session.loop.on_wait = self.controls.attend
        self.said: list[str] = []

    def steps(self, frames: int) -> Iterator[Step]:
        for step in self.session.run(frames=frames):
            self.run.see(step)
            self.said += self.readings.see(step)
            yield step
        self.controls.attend()


@contextmanager
def operated(folder: Path, scenario: str = "hold", **session: Any) -> Iterator[Operated]:
    rig = small_rig(scenario)
    with open_devices(rig) as devices, Session(rig, devices=devices, **session) as made:
        yield Operated(made, devices, folder)
