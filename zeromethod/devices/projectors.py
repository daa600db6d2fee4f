"""What a projector must do, and how those of a rig are opened."""

from __future__ import annotations

import importlib
from contextlib import ExitStack
from typing import Protocol, cast

from zeromethod.arrays import Bytes
from zeromethod.devices.protocols import Display
from zeromethod.errors import InputError
from zeromethod.rig.model import SIMULATED, ProjectorSpec


class Projector(Protocol):
    """Shows pictures, and never waits for the one before."""

    trouble: str
    """Why nothing is projected any more; "" while something is."""

    def show(self, picture: Bytes) -> None:
        """Show grey codes (rows, cols) from the next refresh on."""

    def poll(self) -> None:
        """Do what must be done now and then; called once per step."""

    def close(self) -> None:
        """Let go of it; safe to call twice."""


def open_projectors(spec: ProjectorSpec, display: Display, stack: ExitStack) -> list[Projector]:
    """The projectors that show a rig's picture, closed with `stack`.

    A simulated one is seen by the simulated camera of `display`, and may have a monitor besides. Raises
    InputError where one cannot be opened.
    """
    found: list[Projector] = []
    if spec.driver == SIMULATED:
        simulated = getattr(display, "projector", None)
        if simulated is None:
            raise InputError("projector.driver: 'simulated': this display has no simulated projector")
        found.append(simulated)
    if spec.monitor is not None:
        window = importlib.import_module("zeromethod.drivers.projector_window")
        found.append(cast(Projector, window.ProjectorWindow(spec.monitor, spec.refresh_hz)))
        stack.callback(found[-1].close)
    return found
