"""Closed-loop deflectometry: null a deforming mirror's reflection, read its shape off the warp.

    import zeromethod as zm

    rig = zm.load_rig("simulated")
    with zm.open_devices(rig) as devices:
        loop = zm.Loop(rig, devices.camera, devices.display, devices.clock)
        reader = zm.SurfaceReader(rig, loop.optics, loop.grid)
        for step in loop.run(seconds=1.0):
            if step.measured is not None:
                surface = reader.read(step.measured)

Names are loaded on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from zeromethod.devices.opening import Devices, open_devices
    from zeromethod.errors import InputError, MeasurementError
    from zeromethod.loop.loop import Loop
    from zeromethod.loop.state import State
    from zeromethod.loop.step import Step
    from zeromethod.optics import Optics
    from zeromethod.rig.binning import binned
    from zeromethod.rig.load import load_rig
    from zeromethod.rig.model import Rig
    from zeromethod.session.result import RunResult
    from zeromethod.session.session import Session, run
    from zeromethod.session.summary import summarise
    from zeromethod.surface import Surface, SurfaceReader, peak
    from zeromethod.thread_limits import limit_threads
    from zeromethod.warp.grid import NodeGrid
    from zeromethod.warp.warp import Warp

_NAMES = {
    "devices.opening": ("Devices", "open_devices"),
    "errors": ("InputError", "MeasurementError"),
    "loop.loop": ("Loop",),
    "loop.state": ("State",),
    "loop.step": ("Step",),
    "optics": ("Optics",),
    "rig.binning": ("binned",),
    "rig.load": ("load_rig",),
    "rig.model": ("Rig",),
    "session": ("RunResult", "Session", "run", "summarise"),
    "surface": ("Surface", "SurfaceReader", "peak"),
    "thread_limits": ("limit_threads",),
    "warp.grid": ("NodeGrid",),
    "warp.warp": ("Warp",),
}
_HOME = {name: f"zeromethod.{module}" for module, names in _NAMES.items() for name in names}

__version__ = version("zeromethod")

__all__ = [
    "Devices",
    "InputError",
    "Loop",
    "MeasurementError",
    "NodeGrid",
    "Optics",
    "Rig",
    "RunResult",
    "Session",
    "State",
    "Step",
    "Surface",
    "SurfaceReader",
    "Warp",
    "__version__",
    "binned",
    "limit_threads",
    "load_rig",
    "open_devices",
    "peak",
    "run",
    "summarise",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'zeromethod' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
