"""Camera and display as the loop sees them: the whole contract, failures included.

Any object with these members is a device; nothing has to be subclassed. All times are
nanoseconds on the run's clock (`zeromethod.clock`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from zeromethod.arrays import Bytes, Image

if TYPE_CHECKING:
    import moderngl


class CameraTimeout(Exception):
    """No frame came in time; `read` may be called again."""


class CameraLost(Exception):
    """The camera is gone; reopen it or stop."""


class DisplayLost(Exception):
    """The display or its window is gone."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One exposure.

    image: (rows, cols) uint8 or uint16, LSB-aligned grey levels.
    time_ns: middle of the exposure. exposure_ns: its length.
    number: the device's own count. dropped: frames lost since the one returned before.
    """

    image: Image
    time_ns: int
    exposure_ns: int
    number: int
    dropped: int = 0


@runtime_checkable
class Camera(Protocol):
    """A source of frames. In the host's time it is opened, read and closed in threads of their own."""

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of every frame."""

    @property
    def bits(self) -> int:
        """Significant bits per pixel: 8 to 16."""

    def read(self, timeout_s: float) -> Frame:
        """Newest frame not yet returned, waiting for one up to `timeout_s`.

        Never a stale frame, never a wrong shape; raises CameraTimeout or CameraLost.
        """

    def close(self) -> None:
        """Release the device; safe to call twice."""


@runtime_checkable
class Display(Protocol):
    """A panel that shows pictures.

    It may also have `poll()`, called often in the main thread, where it is then closed too (may raise
    DisplayLost); `asleep`, whether it shows nothing now; `warnings`, lines that the operator should know;
    `dropped_refreshes`, how many it missed. Without `poll` it may be closed in another thread.
    """

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of the panel, px."""

    @property
    def refresh_hz(self) -> float:
        """Refresh rate, Hz."""

    def show(self, image: Bytes) -> int:
        """Show (rows, cols) grey codes; return the presentation time in ns when the swap is done.

        Raises DisplayLost.
        """

    def close(self) -> None:
        """Release the device; safe to call twice."""


@runtime_checkable
class DrawingDisplay(Display, Protocol):
    """A display that lets the pattern be drawn in place, without a trip through the CPU."""

    @property
    def context(self) -> moderngl.Context:
        """The GL context that owns the display's framebuffer."""

    def draw(self, render: Callable[[moderngl.Framebuffer], None]) -> int:
        """Call `render` with the framebuffer to fill (red channel = grey code / 255), then swap.

        LCD row 0 is the framebuffer's top line, as in a window (y = 1 in clip space).

        Returns the presentation time in ns; raises DisplayLost.
        """
