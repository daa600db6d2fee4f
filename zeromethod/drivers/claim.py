"""One program at a time on a monitor: a second pattern over the first would blind its loop."""

from __future__ import annotations

import contextlib
import os
import socket
import sys


class Claim:
    """Holds a name of this machine until `release`, or until the program ends, however that comes about.

    Elsewhere than on Linux it holds nothing.
    """

    def __init__(self, name: str) -> None:
        """Raises FileExistsError when another holder is alive."""
        self._held = socket.socket(socket.AF_UNIX) if sys.platform == "linux" else None
        if self._held is None:
            return
        try:
            # an abstract socket: no file is left behind
            self._held.bind(f"\0zeromethod {name}")
        except OSError as error:
            self._held.close()
            raise FileExistsError(f"{name}: in use by another process") from error

    def release(self) -> None:
        """Let others have it; safe to call twice."""
        if self._held is not None:
            with contextlib.suppress(OSError):
                self._held.close()


def claim_monitor(index: int) -> Claim:
    """Claim a monitor of the present desktop. Raises FileExistsError."""
    desktop = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY", "")
    return Claim(f"monitor {index} of {desktop}")
