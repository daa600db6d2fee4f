"""Cameras, streams and files through OpenCV: an index, a URL or a path."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zeromethod.arrays import Image
from zeromethod.clock import HostClock
from zeromethod.devices.protocols import CameraLost, Frame, gives_buffers
from zeromethod.drivers.device_clock import DeviceClock, MidExposure
from zeromethod.drivers.grabbing import POLL_S, GrabbedCamera, Source
from zeromethod.drivers.not_opened import reason
from zeromethod.errors import InputError

# Read each time a stream is opened. The decoder hands every frame over as it comes instead of looking ahead,
# which loses the first frame.
_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
_NO_DELAY = "fflags;nobuffer|flags;low_delay|probesize;32|analyzeduration;0"

# Read once, when OpenCV first opens a stream: failures are exceptions, not lines on the terminal.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

_FOURCC = {"Mono8": "GREY", "Mono10": "Y10 ", "Mono12": "Y12 ", "Mono16": "Y16 "}
_RAW = (*_FOURCC.values(), "YUYV")
"""Formats of a local camera whose first channel is the grey level, as it is."""

_MANUAL_EXPOSURE = 1.0
_EXPOSURE_UNIT_S = 1e-4
"""Video4Linux's."""

_EXPOSURE_TOLERANCE = 0.1
"""Share by which the exposure that a camera takes may differ from the one asked for: webcams have steps."""


class OpenCVCamera(GrabbedCamera):
    """A `Camera` that OpenCV reads, in the host's time.

    source: index of a local camera (`/dev/video0` is 0), a URL (`tcp://`, `http://`, `rtsp://`, `udp://`: any
    stream that FFmpeg knows) or the path of a video file. columns, rows, bits: of its frames. exposure_s:
    set on a local camera, taken as known of a stream. gain: in the camera's own units. pixel_format: of a
    local camera, Mono8 to Mono16 or four letters of Video4Linux. region_px: (x, y, width, height) cut out of
    what it sends. latency_s: from the end of an exposure until the frame is received.

    Colours are read as their brightness. OpenCV scales a stream that changes its size while it runs to the
    size that it began with. A file plays at its own rate from the moment it is opened, and is
    lost at its end. A silent stream times out; it is lost when its connection ends, and after
    `lost_after_s` of silence.
    """

    def __init__(
        self,
        columns: int,
        rows: int,
        bits: int,
        rate_hz: float,
        exposure_s: float,
        source: int | str = 0,
        gain: float | None = None,
        pixel_format: str | None = None,
        region_px: Sequence[int] | None = None,
        trigger: str = "free",
        latency_s: float = 0.0,
        open_timeout_s: float = 5.0,
        lost_after_s: float = 10.0,
    ) -> None:
        """Open it and wait for its first frame; InputError (one line) for what it does not allow."""
        if trigger != "free":
            raise InputError(f'camera.trigger: "{trigger}": allowed: "free" (OpenCV cannot trigger)')
        name = shown(source)
        local = isinstance(source, int)
        if not local:
            for key, value in (("gain", gain), ("pixel_format", pixel_format)):
                if value is not None:
                    raise InputError(f"camera.{key}: {value!r}: a stream or file has none")

        def opened() -> Source:
            timeouts = _timeouts(open_timeout_s, lost_after_s)
            if isinstance(source, int):
                size = None if region_px else (columns, rows)
                capture = _open_local(source, timeouts, size, pixel_format)
                _set_up(capture, rate_hz, exposure_s, gain)
            else:
                capture = _open_named(source, timeouts)
            times = MidExposure(exposure_s, latency_s, DeviceClock() if local else None)
            is_file = not local and "://" not in str(source)
            try:
                own_hz = rate_hz if is_file else None
                return _Capture(capture, name, bits, region_px, times, own_hz, local=local)
            except BaseException:
                capture.release()
                raise

        super().__init__(name, opened, open_timeout_s + 1.0)


def shown(source: int | str) -> str:
    """Name of a source in messages: a URL without its password."""
    return f"camera {source}" if isinstance(source, int) else re.sub(r"//[^@/]*@", "//", source)


@contextmanager
def _low_delay() -> Iterator[None]:
    """Have streams opened without delay, unless the user's environment says how to open them."""
    if _OPTIONS in os.environ:
        yield
        return
    os.environ[_OPTIONS] = _NO_DELAY
    try:
        yield
    finally:
        os.environ.pop(_OPTIONS, None)


def _quietly_opened(source: int | str, backend: int, params: list[int]) -> cv2.VideoCapture:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        capture = cv2.VideoCapture(source, backend, params)
    except cv2.error as error:
        raise InputError(f"camera.source: {shown(source)}: {' '.join(str(error).split())}") from error
    if not capture.isOpened():
        raise InputError(f"camera.source: {shown(source)}: cannot be opened: {reason(source)}")
    return capture


def _timeouts(open_s: float, read_s: float) -> list[int]:
    opening, reading = (round(1e3 * time_s) for time_s in (open_s, read_s))
    return [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, opening, cv2.CAP_PROP_READ_TIMEOUT_MSEC, reading]


def _open_named(source: str, timeouts: list[int]) -> cv2.VideoCapture:
    raw = [cv2.CAP_PROP_CONVERT_RGB, 0]  # grey levels as they were sent, 16 bits included
    if "://" in source:
        with _low_delay():
            return _quietly_opened(source, cv2.CAP_FFMPEG, timeouts + raw)
    if not Path(source).is_file():
        raise InputError(f"camera.source: {source!r}: no such file")
    return _quietly_opened(source, cv2.CAP_FFMPEG, raw)


def _open_local(
    index: int, timeouts: list[int], size: tuple[int, int] | None, pixel_format: str | None
) -> cv2.VideoCapture:
    """size: (columns, rows) of its frames; None: as they are, a region is cut out of them."""
    capture = _quietly_opened(index, cv2.CAP_V4L2, timeouts)
    letters = _FOURCC.get(pixel_format, pixel_format) if pixel_format else None
    if letters:
        code = cv2.VideoWriter.fourcc(*letters) if len(letters) == 4 else 0
        capture.set(cv2.CAP_PROP_FOURCC, code)
        if round(capture.get(cv2.CAP_PROP_FOURCC)) != code:
            capture.release()
            allowed = f"what the camera has of {', '.join(_FOURCC)}, or four letters of Video4Linux"
            raise InputError(f'camera.pixel_format: "{pixel_format}": allowed: {allowed}')
    if size:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if letters in _RAW:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return capture


def _set_up(capture: cv2.VideoCapture, rate_hz: float, exposure_s: float, gain: float | None) -> None:
    """Set a local camera; one without a settable rate or exposure keeps its own."""
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    capture.set(cv2.CAP_PROP_FPS, rate_hz)
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE)
    _, problem = _set_exposure(capture, exposure_s)
    if gain is not None and not capture.set(cv2.CAP_PROP_GAIN, gain):
        problem = f"camera.gain: {gain:g}: the camera does not take it"
    if problem:
        capture.release()
        raise InputError(problem)


def _set_exposure(capture: cv2.VideoCapture, exposure_s: float) -> tuple[float, str]:
    """Set a local camera's exposure, s: what it took, and what is wrong with that, "" for nothing."""
    if not capture.set(cv2.CAP_PROP_EXPOSURE, round(exposure_s / _EXPOSURE_UNIT_S)):
        return exposure_s, ""
    taken_s = float(capture.get(cv2.CAP_PROP_EXPOSURE)) * _EXPOSURE_UNIT_S
    if abs(taken_s - exposure_s) <= max(_EXPOSURE_TOLERANCE * exposure_s, _EXPOSURE_UNIT_S):
        return taken_s, ""
    return taken_s, f"camera.exposure_s: {exposure_s:g}: the camera makes {taken_s:g} of it"


def _grey(image: Image) -> Image:
    """(rows, cols) brightness of what OpenCV decoded."""
    if image.ndim == 2:
        return image
    if image.shape[2] <= 2:  # brightness comes first, then colour
        return np.ascontiguousarray(image[..., 0])
    code = cv2.COLOR_BGRA2GRAY if image.shape[2] == 4 else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(image, code))


class _Capture:
    """The opened capture as a `Source`. rate_hz: a file's, where it does not say; None = live."""

    on_demand = False

    def __init__(
        self,
        capture: cv2.VideoCapture,
        name: str,
        bits: int,
        region_px: Sequence[int] | None,
        times: MidExposure,
        rate_hz: float | None,
        *,
        local: bool,
    ) -> None:
        self._capture = capture
        self._local = local
        self._name = name
        self._times = times
        self._clock = HostClock()
        self._numbers = 0
        self._region = region_px
        self._whole: tuple[tuple[int, ...], np.dtype[Any]] | None = None
        self._period_ns: float | None = None
        if rate_hz is not None:
            own_hz = capture.get(cv2.CAP_PROP_FPS)
            self._period_ns = 1e9 / (own_hz if 0 < own_hz < 10_000 else rate_hz)
        try:
            self._next: tuple[Image, int, int] | None = self._decoded()
        except CameraLost as error:
            raise InputError(f"camera.source: {name}: opened, but gave no frame: {error}") from error
        image = self._next[0]
        self._start_ns = self._next[1]
        self.shape: tuple[int, int] = image.shape[0], image.shape[1]
        self.bits = 8 if image.dtype == np.uint8 else max(bits, 9)
        if self.bits > 8 and int(image.max()) >> self.bits:
            top = int(image.max())
            raise InputError(f"camera.bits: {bits}: the frames reach {top}: {top.bit_length()} bits")

    @gives_buffers
    def grab(self) -> Frame | None:
        """Next frame, at its time when it comes from a file."""
        image, received_ns, ticks = self._next or self._decoded()
        if self._period_ns is not None:
            due_ns = self._start_ns + round(self._numbers * self._period_ns)
            if due_ns - self._clock.now_ns() > 1e9 * POLL_S:
                self._next = image, received_ns, ticks
                time.sleep(POLL_S)
                return None
            self._clock.sleep_until_ns(due_ns)
            received_ns = due_ns
        self._next = None
        middle_ns = self._times.of(received_ns, ticks)
        self._numbers += 1
        return Frame(image, middle_ns, self._times.exposure_ns, self._numbers - 1)

    @property
    def exposure_settable(self) -> bool:
        """Whether it is a local camera: streams and files come as they are."""
        return self._local

    def set_exposure(self, exposure_s: float) -> float:
        """Expose later frames for so long, s; what the camera took. Raises InputError."""
        taken_s, problem = _set_exposure(self._capture, exposure_s)
        if problem:
            raise InputError(problem)
        self._times.set_exposure(taken_s)
        return taken_s

    def close(self) -> None:
        """Release the capture."""
        self._capture.release()

    def _decoded(self) -> tuple[Image, int, int]:
        """Next image, time of receipt, and the driver's time stamp in ns, 0 where it has none."""
        asked_ns = self._clock.now_ns()
        good, image = self._capture.read()
        received_ns = self._clock.now_ns()
        if not good or image is None:
            if self._period_ns is not None:
                raise CameraLost(f"{self._name}: end of file")
            waited_s = 1e-9 * (received_ns - asked_ns)
            silent = f"silent for {waited_s:.0f} s" if waited_s > 1 else "it has ended"
            raise CameraLost(f"{self._name}: {silent}")
        kind = image.shape, image.dtype
        if self._whole not in (None, kind):
            raise CameraLost(f"{self._name}: its frames are now {kind[0]} {kind[1]}")
        self._whole = kind
        ticks = round(1e6 * self._capture.get(cv2.CAP_PROP_POS_MSEC))
        return self._cut(_grey(image)), received_ns, ticks

    def _cut(self, image: Image) -> Image:
        if self._region is None:
            return image
        x, y, columns, rows = self._region
        if x + columns > image.shape[1] or y + rows > image.shape[0]:
            size = f"{image.shape[1]} x {image.shape[0]} px"
            raise InputError(f"camera.region_px: {list(self._region)}: the frames are {size}")
        return np.ascontiguousarray(image[y : y + rows, x : x + columns])
