"""A session as one HDF5 file: written by a process next to the loop, readable by any HDF5 program.

    from zeromethod.recording import Recording

Names are loaded on first use: the process that writes needs few.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from zeromethod.recording.file import check_new
    from zeromethod.recording.recorder import Recorder
    from zeromethod.recording.recording import Recording
    from zeromethod.recording.schema import KEEP
    from zeromethod.recording.source import DamagedWarning

_HOME = {
    "KEEP": "schema",
    "DamagedWarning": "source",
    "Recorder": "recorder",
    "Recording": "recording",
    "check_new": "file",
}

__all__ = ["KEEP", "DamagedWarning", "Recorder", "Recording", "check_new"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
