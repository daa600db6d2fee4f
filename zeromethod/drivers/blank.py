"""No display of this computer's: for looking through a camera alone."""

from __future__ import annotations

import time

from zeromethod.arrays import Bytes


class BlankDisplay:
    """A `Display` that shows nothing; columns, rows, refresh_hz as the rig states them."""

    def __init__(self, columns: int, rows: int, refresh_hz: float) -> None:
        self.size = columns, rows
        self.refresh_hz = refresh_hz

    def show(self, image: Bytes) -> int:  # noqa: ARG002 - the protocol's
        """Return the present time, ns."""
        return time.monotonic_ns()

    def close(self) -> None:
        """Nothing to close."""
