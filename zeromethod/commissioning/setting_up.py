"""Frame after frame of an open bench while a person sets it up: the target at rest, and what comes of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zeromethod.commissioning.advice import GOOD, advice, misplaced, placed
from zeromethod.commissioning.focus import FocusMeter, FocusReport
from zeromethod.commissioning.light_advice import FLICKER_SHARE, advised_exposure_s, light_share, mains_hz
from zeromethod.commissioning.orientation import Alignment, Orientation, PlainPictures
from zeromethod.commissioning.patterns import TimedPatterns
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraLost, DisplayLost, Frame
from zeromethod.errors import MeasurementError
from zeromethod.loop.drawing import Drawer
from zeromethod.rig.model import Rig

SETTLE_S = 0.2
"""Allowed, beyond what the rig states, from a picture's presentation to the frames that see it alone."""

LOOK_AGAIN_S = 5.0
"""How often the LCD is looked for again while it is not seen as it should be."""

PLAIN_FRAMES = 6
"""Frames that make the image of a plain picture: lamps on the mains would pass for places, frame by frame."""

FLICKER_FRAMES = 16
BRIGHT_FRAMES = 600
"""Of so many frames the brightest counts: clouds go."""


class FlickerMeter:
    """How the light changes from frame to frame, less a steady drift."""

    def __init__(self, black_grey: float) -> None:
        self._black = black_grey
        self._frames: deque[tuple[float, float, float]] = deque(maxlen=FLICKER_FRAMES)

    def note(self, mean_grey: float, time_s: float = 0.0, bright: float = 0.0) -> float:
        """Take in a frame; the light's standard deviation over its mean, NaN before half of them are there.

        mean_grey: of the frame. time_s: its mid-exposure. bright: its brightest light, in any unit.
        """
        self._frames.append((mean_grey - self._black, time_s, bright))
        light = np.array(self._frames)[:, 0]
        if len(light) < FLICKER_FRAMES // 2 or light.mean() <= 0:
            return math.nan
        order = np.arange(len(light))
        rest = light - np.polyval(np.polyfit(order, light, 1), order)
        return float(rest.std(ddof=2) / light.mean())

    @property
    def brightest(self) -> float:
        """Of the last frames."""
        return max((bright for *_, bright in self._frames), default=0.0)

    @property
    def mains_hz(self) -> float:
        """Frequency of lamps on the mains, Hz, where they explain it; NaN else."""
        if len(self._frames) < FLICKER_FRAMES // 2:
            return math.nan
        light, times_s, _ = np.array(self._frames).T
        return mains_hz(times_s, light)

    def forget(self) -> None:
        """Start again."""
        self._frames.clear()


@dataclass(frozen=True)
class Sight:
    """One frame and what it says. time_s: from the first one. place: of the picture, where it is known.

    mains_hz: of lamps whose flicker is seen, however weak, NaN for none. advised_exposure_s: for the least
    sigma of depth.
    """

    time_s: float
    frame: Frame
    report: FocusReport
    seen: Orientation | None
    flicker_share: float
    place: Alignment | None
    advice: tuple[str, ...]
    mains_hz: float = math.nan
    advised_exposure_s: float = math.nan

    @property
    def lines(self) -> tuple[str, ...]:
        """The advice, or that there is nothing to do."""
        return self.advice or (GOOD,)


class SettingUp:
    """Shows the target at rest on the bench's display, if that shows anything, and judges frames.

    Parameters
    ----------
    rig : Rig
        The bench.
    devices : Devices
        Its opened devices.
    with_lcd : bool
        Whether the display is the bench's; plain pictures then show first whether, and which
        way round, the camera sees it.
    """

    def __init__(self, rig: Rig, devices: Devices, with_lcd: bool) -> None:
        self._devices = devices
        self._meter = FocusMeter(rig)
        self._rig = self._meter.rig
        self._patterns = TimedPatterns(self._rig, devices, SETTLE_S)
        self._flicker = FlickerMeter(rig.camera.noise.black_grey)
        self._bright: deque[float] = deque(maxlen=BRIGHT_FRAMES)
        self._plain = PlainPictures(self._meter.rest) if with_lcd else None
        self._drawer = (
            Drawer(self._rig, devices.display, devices.clock, self._meter.rest) if with_lcd else None
        )

    def sights(self, seconds: float | None = None) -> Iterator[Sight]:
        """Judge frames, one after the other.

        Parameters
        ----------
        seconds : float, optional
            Of the run's clock; without, until it is stopped.

        Yields
        ------
        Sight
            One frame and what it says.

        Raises
        ------
        MeasurementError
            When a device is lost or gives nothing.
        """
        clock = self._devices.clock
        try:
            seen = self._look_for_lcd()
            start_ns = looked_ns = clock.now_ns()
            while seconds is None or clock.now_ns() - start_ns < 1e9 * seconds:
                wrong = seen is not None and misplaced(seen, self._rig)
                if wrong and clock.now_ns() > looked_ns + 1e9 * LOOK_AGAIN_S:
                    seen = self._look_for_lcd()
                    looked_ns = clock.now_ns()
                frame = self._patterns.read()
                yield self._sight(frame, seen, 1e-9 * (clock.now_ns() - start_ns))
        except CameraLost as error:
            raise MeasurementError(f"the camera is lost: {error}") from error
        except DisplayLost as error:
            raise MeasurementError(f"the display is lost: {error}") from error

    def _sight(self, frame: Frame, seen: Orientation | None, time_s: float) -> Sight:
        """One frame judged."""
        rig, flicker = self._rig, self._flicker
        stray_grey = 0.0 if seen is None or math.isnan(seen.stray_grey) else seen.stray_grey
        report = self._meter.look(frame.image, stray_grey)
        self._bright.append(light_share(report, rig, stray_grey))
        share = flicker.note(report.mean_grey, 1e-9 * frame.time_ns)
        seen_hz = flicker.mains_hz
        hz = seen_hz if share > FLICKER_SHARE else math.nan  # weaker is no reason for another exposure
        exposure_s = 1e-9 * frame.exposure_ns
        wanted_s = advised_exposure_s(report, rig, exposure_s, max(self._bright), hz)
        said = advice(report, rig, seen, share, exposure_s=exposure_s, wanted_s=wanted_s, hz=hz)
        place = placed(report, seen, rig.target.period_px)
        advised_s = min(wanted_s, 1 / rig.camera.rate_hz)
        return Sight(time_s, frame, report, seen, share, place, said, seen_hz, advised_s)

    def _look_for_lcd(self) -> Orientation | None:
        """Show plain pictures, then the target at rest; None without the LCD."""
        if self._drawer is None or self._plain is None:
            return None
        camera, patterns = self._rig.camera, self._patterns
        images = [
            np.mean([frame.image for frame in patterns.frames(codes, PLAIN_FRAMES)], axis=0)
            for codes in self._plain.pictures
        ]
        patterns.after(self._drawer.draw(self._meter.rest.q), 1)
        self._flicker.forget()
        self._bright.clear()
        return self._plain.judge(images, camera.noise.black_grey, float(2**camera.bits - 1))
