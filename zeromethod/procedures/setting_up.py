"""Frame after frame of an open bench while a person sets it up: the target at rest, and what comes of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.control.presenter import Presenter
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraLost, CameraTimeout, DisplayLost, Frame
from zeromethod.errors import MeasurementError
from zeromethod.procedures.advice import UNSEEN_SHARE, advice
from zeromethod.procedures.focus import FocusMeter, FocusReport
from zeromethod.procedures.orientation import Orientation, orientation, plain_pictures
from zeromethod.rig.model import Rig

SETTLE_S = 0.2
"""Allowed, beyond what the rig states, from a picture's presentation to the frames that see it alone."""

LOOK_AGAIN_S = 5.0
"""How often the LCD is looked for again while it is not seen as it should be."""

FLICKER_FRAMES = 16
TIMEOUTS_TO_FAIL = 3


class Flicker:
    """Standard deviation of the light over its mean, from frame to frame, less a steady drift."""

    def __init__(self, black_grey: float) -> None:
        self._black = black_grey
        self._greys: deque[float] = deque(maxlen=FLICKER_FRAMES)

    def note(self, mean_grey: float) -> float:
        """Take in a frame's mean grey; the share, NaN before half of the frames are there."""
        self._greys.append(mean_grey - self._black)
        light = np.array(self._greys)
        if len(light) < FLICKER_FRAMES // 2 or light.mean() <= 0:
            return math.nan
        order = np.arange(len(light))
        rest = light - np.polyval(np.polyfit(order, light, 1), order)
        return float(rest.std(ddof=2) / light.mean())

    def forget(self) -> None:
        """Start anew."""
        self._greys.clear()


@dataclass(frozen=True)
class Sight:
    """One frame and what it says. time_s: from the first one."""

    time_s: float
    frame: Frame
    report: FocusReport
    seen: Orientation | None
    flicker_share: float
    advice: tuple[str, ...]


class SettingUp:
    """Shows the target at rest on the bench's display, if that shows anything, and judges frames.

    with_lcd: whether the display is the bench's; plain pictures then tell first whether, and which way round,
    the camera sees it.
    """

    def __init__(self, rig: Rig, devices: Devices, with_lcd: bool) -> None:
        self._devices = devices
        self._meter = FocusMeter(rig)
        self._rig = self._meter.rig
        self._flicker = Flicker(rig.camera.noise.black_grey)
        self._presenter = Presenter(self._rig, devices.display, self._meter.rest) if with_lcd else None

    def sights(self, seconds: float | None = None) -> Iterator[Sight]:
        """Judge frames for `seconds` of the run's clock, None = until told to stop.

        Raises MeasurementError when a device is lost or gives nothing.
        """
        clock = self._devices.clock
        start_ns = clock.now_ns()
        seen, looked_ns = None, None
        try:
            while seconds is None or clock.now_ns() - start_ns < 1e9 * seconds:
                wrong = seen is not None and _wrong(seen)
                again = looked_ns is None or (wrong and clock.now_ns() > looked_ns + 1e9 * LOOK_AGAIN_S)
                if self._presenter is not None and again:
                    seen = self._look_for_lcd()
                    looked_ns = clock.now_ns()
                poll = getattr(self._devices.display, "poll", None)
                if poll is not None:
                    poll()
                frame = self._read()
                report = self._meter.look(frame.image)
                flicker = self._flicker.note(report.mean_grey)
                said = advice(report, self._rig.camera, seen, flicker)
                yield Sight(1e-9 * (clock.now_ns() - start_ns), frame, report, seen, flicker, said)
        except CameraLost as error:
            raise MeasurementError(f"the camera is lost: {error}") from error
        except DisplayLost as error:
            raise MeasurementError(f"the display is lost: {error}") from error

    def _look_for_lcd(self) -> Orientation:
        """Show plain pictures, then the target at rest."""
        assert self._presenter is not None
        rest, camera = self._meter.rest, self._rig.camera
        images = [self._seen_after(self._devices.display.show(codes)) for codes in plain_pictures(rest)]
        self._seen_after(self._presenter.present(rest.q))
        self._flicker.forget()
        return orientation(images, camera.noise.black_grey, float(2**camera.bits - 1))

    def _seen_after(self, presented_ns: int) -> NDArray[Any]:
        """Image of the first frame that surely saw nothing older than what was presented then."""
        display = self._rig.display
        scanout_s = 1 / display.refresh_hz if display.scanout_s is None else display.scanout_s
        lit_ns = presented_ns + round(1e9 * (display.latency_s + scanout_s + 2 * display.rise_s + SETTLE_S))
        self._devices.clock.sleep_until_ns(lit_ns)
        while True:
            frame = self._read()
            if frame.time_ns - frame.exposure_ns // 2 >= lit_ns:
                return frame.image

    def _read(self) -> Frame:
        for _ in range(TIMEOUTS_TO_FAIL):
            try:
                return self._devices.camera.read(self._rig.control.timeout_s)
            except CameraTimeout:
                continue
        waited_s = TIMEOUTS_TO_FAIL * self._rig.control.timeout_s
        raise MeasurementError(f"the camera gave no frame for {waited_s:g} s")


def _wrong(seen: Orientation) -> bool:
    return seen.seen_share < UNSEEN_SHARE or seen.mirrored or bool(seen.quarter_turns)
