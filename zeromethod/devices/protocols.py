"""Cameras and displays as the loop uses them: what they must do, what they may do, and how they fail.

Any object with these members is a device; nothing has to be subclassed. All times are nanoseconds on the
run's clock (`zeromethod.clock`). Optional abilities are asked for in `zeromethod.devices.abilities` only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeVar, runtime_checkable

from zeromethod.arrays import Bytes, Float, Image

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


Read = TypeVar("Read", bound=Callable[..., object])


def gives_buffers(read: Read) -> Read:
    """Mark a driver's `read` (or a source's `grab`): nobody ever writes into the images it gave.

    Such images are not copied. Another `read`, of a subclass or around this one, is not marked by it.

    Parameters
    ----------
    read
        The method.

    Returns
    -------
    callable
        The same method.
    """
    read.__dict__["gives_buffers"] = True
    return read


@runtime_checkable
class Camera(Protocol):
    """A source of frames. In the host's time it is opened, read and closed in threads of their own.

    The image of a frame is copied before `read` is called again, unless `read` is marked `gives_buffers`.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of every frame."""

    @property
    def bits(self) -> int:
        """Significant bits per pixel: 8 to 16."""

    def read(self, timeout_s: float) -> Frame:
        """Newest frame not yet returned; never a stale frame, never a wrong shape.

        Parameters
        ----------
        timeout_s
            How long to wait for one, s.

        Returns
        -------
        Frame
            The newest frame; the ones skipped are counted in `dropped`.

        Raises
        ------
        CameraTimeout
            None came in time.
        CameraLost
            The camera is gone.
        """

    def close(self) -> None:
        """Release the device; safe to call twice."""


@runtime_checkable
class Display(Protocol):
    """A panel that shows pictures. Without `poll` it may be closed in another thread."""

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of the panel, px."""

    @property
    def refresh_hz(self) -> float:
        """Refresh rate, Hz."""

    def show(self, image: Bytes) -> int:
        """Show a picture and wait until the swap is done.

        Parameters
        ----------
        image
            (rows, cols) uint8 grey codes.

        Returns
        -------
        int
            Presentation time: when the swap was done, ns.

        Raises
        ------
        DisplayLost
            The display or its window is gone.
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
        """Draw a picture in place and wait until the swap is done.

        Parameters
        ----------
        render
            Draws into the framebuffer it gets: red channel = grey code / 255, LCD row 0 in the framebuffer's
            top line, as in a window (y = 1 in clip space).

        Returns
        -------
        int
            Presentation time: when the swap was done, ns.

        Raises
        ------
        DisplayLost
            The display or its window is gone.
        """


@runtime_checkable
class PollingDisplay(Protocol):
    """A display with events of its own to handle; it is opened, polled and closed in the main thread."""

    def poll(self) -> None:
        """Handle events; called often.

        Raises
        ------
        DisplayLost
            The display or its window is gone.
        """


@runtime_checkable
class SleepingDisplay(Protocol):
    """A display that reports whether it shows nothing now."""

    @property
    def asleep(self) -> bool:
        """Whether the panel is switched off by power saving; frames are not used meanwhile."""


@runtime_checkable
class WarningDisplay(Protocol):
    """A display that knows what may spoil its picture."""

    @property
    def warnings(self) -> Sequence[str]:
        """Lines that the operator should know, as of now."""


@runtime_checkable
class CountingDisplay(Protocol):
    """A display that counts the refreshes it missed."""

    @property
    def dropped_refreshes(self) -> int:
        """Refreshes missed since it was opened."""


@runtime_checkable
class ExposingCamera(Protocol):
    """A camera whose exposure can be changed while it is read. `exposure_settable` False: not this one."""

    def set_exposure(self, exposure_s: float) -> float:
        """Expose later frames for so long; called in a thread of its own, also while `read` waits.

        Parameters
        ----------
        exposure_s
            Wanted exposure time, s.

        Returns
        -------
        float
            The exposure time that the camera took, s. Later frames state it (`Frame.exposure_ns`).

        Raises
        ------
        InputError
            The camera does not take it; one line, with what it allows.
        """


@runtime_checkable
class IdentifiedCamera(Protocol):
    """A camera that names itself, so that a calibration made with another one is refused."""

    @property
    def serial(self) -> str:
        """Serial number; "" where it is not known."""

    @property
    def model(self) -> str:
        """Maker's name of the model; "" where it is not known."""


@runtime_checkable
class NamedDisplay(Protocol):
    """A display that names its panel, so that a calibration made with another one is refused."""

    @property
    def name(self) -> str:
        """Name of the panel."""


@runtime_checkable
class TrueMirror(Protocol):
    """The mirror at one instant, as a simulated bench knows it."""

    def depth(self, x: Float, y: Float) -> Float:
        """Depth in mm, positive into the rubber, at points of the mirror in mm."""

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        """(dd/dx, dd/dy)."""

    def reflectance_factor(self, x: Float, y: Float) -> Float:
        """1 where nothing touches, less where an object takes the light."""


class TrueContact(NamedTuple):
    """An object that truly touches the mirror: its number in the scenario from 1, centroid, area, force."""

    id: int
    x_mm: float
    y_mm: float
    area_mm2: float
    force_n: float


@runtime_checkable
class TouchedMirror(Protocol):
    """A true mirror that knows what touches it."""

    @property
    def contacts(self) -> Sequence[TrueContact]:
        """What touches."""


@runtime_checkable
class TruthfulCamera(Protocol):
    """A simulated camera that knows the true mirror; only reports use it, never the loop or the reading."""

    def truth(self, time_ns: int) -> TrueMirror:
        """The mirror as it truly is.

        Parameters
        ----------
        time_ns
            Time on the run's clock, ns.

        Returns
        -------
        TrueMirror
            The mirror at that time.
        """


@runtime_checkable
class ScriptPhase(Protocol):
    """A named part of a run: errors against the truth are given for "hold" and "slide"."""

    @property
    def name(self) -> str:
        """What the part is called."""


@runtime_checkable
class Script(Protocol):
    """What will happen in a simulated run: how long it lasts, and its parts."""

    @property
    def duration_s(self) -> float:
        """How long a run lasts when nobody asks for another length, s."""

    @property
    def phases(self) -> Sequence[ScriptPhase]:
        """All parts, in any order."""

    def phase_at(self, time_ns: int) -> str | None:
        """Name of the part that a time (ns) lies in, None outside of all."""


@runtime_checkable
class ScriptedCamera(Protocol):
    """A simulated camera that knows what will happen."""

    @property
    def scenario(self) -> Script:
        """The script of the run."""
