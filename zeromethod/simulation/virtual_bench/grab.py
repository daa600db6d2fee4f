"""The pixels of a monitor that another program draws on."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.drivers.monitors import Monitor, by_index, listed, monitors
from zeromethod.errors import InputError, MeasurementError

_GREEN = 1
"""Of blue, green, red and unused: a pattern is grey, all three are alike."""


def find_monitor(index: int, size: tuple[int, int]) -> Monitor:
    """Monitor of that index, as `run --display` counts them, which must be set to size (columns, rows).

    To be called in the main thread. Raises InputError (one line): no screen, no such monitor (with the list),
    one that is set to another size, or mss is not installed.
    """
    if find_spec("mss") is None:
        raise InputError("--monitor: mss is missing: pip install 'zeromethod[virtual]'")
    known = monitors()
    found = by_index(known, index, "--monitor")
    if (found.columns, found.rows) != size:
        raise InputError(
            f"--monitor: {index}: set to {found.columns} x {found.rows}; the rig's display is "
            f"{size[0]} x {size[1]} px; monitors: {listed(known)}"
        )
    return found


class MonitorGrabber:
    """Takes one monitor's picture at a time. To be made, used and closed in one thread."""

    def __init__(self, monitor: Monitor) -> None:
        """Connect to the screen; MeasurementError when it is gone."""
        from mss import MSS, ScreenShotError  # noqa: PLC0415 - an extra

        self._gone: type[Exception] = ScreenShotError
        self._region = {
            "left": monitor.x,
            "top": monitor.y,
            "width": monitor.columns,
            "height": monitor.rows,
        }
        try:
            self._screen: Any = MSS()
        except ScreenShotError as error:
            raise self._lost(error) from error

    def grab(self) -> Bytes:
        """Grey codes (rows, cols) that the monitor shows now; MeasurementError when it is gone."""
        try:
            shot = self._screen.grab(self._region)
        except self._gone as error:
            raise self._lost(error) from error
        pixels = np.frombuffer(shot.raw, np.uint8).reshape(shot.height, shot.width, 4)
        return np.ascontiguousarray(pixels[..., _GREEN])

    def close(self) -> None:
        """Leave the screen."""
        self._screen.close()

    @staticmethod
    def _lost(error: Exception) -> MeasurementError:
        return MeasurementError(f"the monitor cannot be grabbed any more: {' '.join(str(error).split())}")
