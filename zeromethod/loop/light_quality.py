"""Light that spoils the measurement: off, too much of it, or beating with the exposure."""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.devices.protocols import Frame
from zeromethod.loop.events import Event, Notice
from zeromethod.sensing.residual import Residual
from zeromethod.warp.validity import Flag

SATURATED_ABOVE = 0.05
"""Share of the nodes visible at rest that may be at the camera's ceiling."""

FLICKER_FRAMES = 120
"""Frames in which a beat is looked for: 1.5 Hz at 60 frames per second is the slowest to be found."""

FEWEST_FRAMES = 48
"""Frames from which on it is looked for, as fast ones show sooner."""

EVERY_FRAMES = 12
"""How often it is looked for."""

FLICKER_ABOVE = 0.01
"""Amplitude of a beat over the mean light above which it is reported: a tenth of the light of a dent's
slopes."""

FLICKER_SHARE = 0.7
"""Share of all variance in the light that one frequency must hold: presses are no oscillation."""

LEAST_CYCLES = 3.0
"""Slower changes are drift, or presses."""

OFF_BELOW = 0.25
"""Share of the usual light under which it counts as off."""

LIT_ABOVE, LIT_SHARE = 0.5, 0.02
"""Share of the usual light in more than that share of the view by which the light is on."""

MEMORY = 0.05
"""Share of every good frame in the usual light."""


def mean_of(values: Single, chosen: Mask) -> float:
    """Mean of the chosen values, (rows, cols) both; 0 for none."""
    return float(cv2.mean(values, chosen.view(np.uint8))[0])


class LightWatch:
    """Follows the mean grey of the nodes visible at rest; what presses changes it little and slowly."""

    def __init__(self, seen: Mask, black_grey: float) -> None:
        self._seen, self._any = seen, bool(seen.any())
        self._black = black_grey
        self._usual: float | None = None

    def _partly_lit(self, mean_grey: Single) -> bool:
        """Whether some of the view has its usual light: then something covers the rest."""
        light = mean_grey[self._seen] - self._black
        return float(np.mean(light > LIT_ABOVE * (self._usual or 0.0))) > LIT_SHARE

    def scale(self, ratio: float) -> None:
        """Expect this many times the light, as of another exposure."""
        if self._usual is not None:
            self._usual *= ratio

    def is_off(self, mean_grey: Single) -> bool:
        """Whether a frame with these means per node, (rows, cols) grey, was taken without light."""
        if not self._any:
            return False
        light = mean_of(mean_grey, self._seen) - self._black
        if self._usual is None:
            self._usual = light
        if light > OFF_BELOW * self._usual:
            self._usual += MEMORY * (light - self._usual)
            return False
        return not self._partly_lit(mean_grey)


def beat(times_s: Float, light: Float) -> tuple[float, float]:
    """(frequency in Hz, amplitude over the mean) of an oscillation of the light, (nan, 0) for none.

    times_s, light: (n,) of the frames; some may be missing. Sines are fitted together with a line, so that
    neither gaps nor a drift make one.
    """
    span_s = times_s[-1] - times_s[0]
    mean = float(light.mean())
    frame_s = float(np.median(np.diff(times_s)))
    if not (span_s > 0 and mean > 0 and frame_s > 0):
        return float("nan"), 0.0
    t = (times_s - times_s.mean()) / span_s
    line = np.stack([np.ones_like(t), t], axis=-1)
    rest = light / mean - 1
    rest = rest - line @ np.linalg.lstsq(line, rest, rcond=None)[0]
    whole = float(rest @ rest)
    cycles = np.arange(LEAST_CYCLES, 0.5 * span_s / frame_s + 0.25, 0.25)
    if whole <= 0 or not len(cycles):
        return float("nan"), 0.0
    angles = 2 * np.pi * cycles[:, None] * t
    cos, sin = np.cos(angles), np.sin(angles)
    # normal equations of a cos + b sin; at half the frame rate one of the two may vanish
    cc, ss, cs = (cos * cos).sum(axis=1), (sin * sin).sum(axis=1), (cos * sin).sum(axis=1)
    a, b = cos @ rest, sin @ rest
    area = np.maximum(cc * ss - cs * cs, 1e-3 * len(t) ** 2)
    power = (ss * a * a - 2 * cs * a * b + cc * b * b) / area
    best = int(np.argmax(power))
    size = float((2 * power[best] / len(t)) ** 0.5)
    if power[best] > FLICKER_SHARE * whole and size > FLICKER_ABOVE:
        return float(cycles[best] / span_s), size
    return float("nan"), 0.0


class LightQuality:
    """Looks at the light of every measured frame; reports what is wrong and what would help."""

    def __init__(self, seen: Mask, black_grey: float) -> None:
        self._seen = seen
        self._black = black_grey
        self._times_ns: deque[int] = deque(maxlen=FLICKER_FRAMES)
        self._light: deque[float] = deque(maxlen=FLICKER_FRAMES)
        self._frames = 0
        self._beat = ""

    def look(self, residual: Residual, frame: Frame) -> list[Notice]:
        """Notices for one frame."""
        if not self._seen.any():
            return []
        notices = []
        flags = residual.flags[self._seen]
        saturated = float(np.count_nonzero(flags & np.uint16(Flag.SATURATED))) / flags.size
        if saturated > SATURATED_ABOVE:
            share = f"{100 * saturated:.0f} % of the view is too bright for the camera"
            words = f"{share}: shorten the exposure, or lower the gain"
            notices.append(Notice(Event.SATURATED, words))
        self._times_ns.append(frame.time_ns)
        self._light.append((mean_of(residual.mean, self._seen) - self._black) / frame.exposure_ns)
        self._frames += 1
        if len(self._light) >= FEWEST_FRAMES and self._frames % EVERY_FRAMES == 0:
            times_s = 1e-9 * np.array([time - self._times_ns[0] for time in self._times_ns])
            hz, size = beat(times_s, np.array(self._light))
            self._beat = ""
            if size:
                self._beat = (
                    f"the light swings by {200 * size:.0f} % at {hz:.2g} Hz from frame to frame: the LCD's "
                    "backlight is switched; set it to full brightness, or expose for a multiple of its period"
                )
        if self._beat:
            notices.append(Notice(Event.FLICKER, self._beat))
        return notices
