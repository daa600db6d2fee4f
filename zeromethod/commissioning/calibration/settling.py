"""How long a picture takes to settle, found before anything is known of the delay."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.commissioning.patterns import TimedPatterns, apart, thinned, uniform_pattern
from zeromethod.devices.opening import Devices
from zeromethod.errors import MeasurementError
from zeromethod.rig.model import Rig

LOOK_S, LOOK_FRAMES = 0.5, 8
"""How long a change of the picture is followed: the longer of both."""

TOGGLES = 4
SETTLED_SHARE = 0.01
"""Of the change from black to white, within which the light has settled."""

UNSTEADY_SHARE = 0.1
"""Of the change, by which the light may still scatter when it should have settled."""

MARGIN_REFRESHES = 2.0
"""Added to the longest settling seen, for those that were not."""

LEAST_SWING = 0.02
"""White less black, of full scale, below which the camera does not see the LCD."""


@dataclass(frozen=True)
class Settling:
    """What changes of the whole picture showed.

    hold_s: from presentation to the start of exposures that surely see the new picture alone, by the camera's
    stamps. black_grey, white_grey: mean over the view. saturated_share: of pixels, by the white LCD.
    variance_grey2: of one reading of the white LCD, flicker and all, from frame to frame.
    """

    hold_s: float
    black_grey: float
    white_grey: float
    saturated_share: float
    variance_grey2: float


def settle(rig: Rig, devices: Devices) -> Settling:
    """Switch the LCD between black and white and watch the whole view's light.

    Raises MeasurementError where the camera does not see the LCD, or the light does not settle.
    """
    pictures, display = TimedPatterns(rig, devices, 0.0), rig.display
    look_s = max(LOOK_S, LOOK_FRAMES / rig.camera.rate_hz)
    full = 2**rig.camera.bits - 1
    series, saturated, variances = [], 0.0, []
    for toggle in range(TOGGLES + 1):
        white = toggle % 2 == 1
        picture = uniform_pattern(rig, 255 * white)
        levels, over = [], 0.0
        images: deque[Single] = deque(maxlen=2)
        for since_s, frame in pictures.following(picture, look_s, LOOK_FRAMES - 1):
            start_s = since_s - 0.5e-9 * frame.exposure_ns
            images.append(thinned(frame.image))
            levels.append((start_s, float(images[-1].mean())))
            over = float(np.mean(images[-1] >= full))
        if len(levels) < 3:
            raise MeasurementError(
                f"the camera gave {len(levels)} frames in {look_s:.1f} s: too few to go by"
            )
        if white:
            saturated = max(saturated, over)
            variances.append(0.5 * apart(images[1], images[0]))
        if toggle:  # what was there before the first picture is not known
            series.append(np.array(levels))
    ends = np.array([np.median(one[2 * len(one) // 3 :, 1]) for one in series])
    black, bright = float(ends[1::2].mean()), float(ends[::2].mean())
    swing = bright - black
    if swing < LEAST_SWING * full:
        raise MeasurementError(
            f"the camera does not see the LCD: white gives {bright:.1f} grey levels, black {black:.1f}: see "
            "to aim, focus and exposure (zeromethod devices --focus)"
        )
    settled = max(_settled(one, swing) for one in series)
    if not np.isfinite(settled):
        raise MeasurementError(
            f"the LCD's light does not settle within {look_s:.1f} s of a change: switch off dynamic "
            "contrast and dimming, and automatic exposure of the camera"
        )
    hold_s = settled + MARGIN_REFRESHES / display.refresh_hz
    return Settling(hold_s, black, bright, saturated, min(variances))


def _settled(levels: Float, swing: float) -> float:
    """Start of the first exposure from which on the level stays, s; infinite where it never does."""
    start_s, grey = levels.T
    tail = grey[2 * len(grey) // 3 :]
    scatter = 4.0 * float(tail.std())
    if scatter > UNSTEADY_SHARE * swing:
        return float("inf")
    late = np.flatnonzero(np.abs(grey - np.median(tail)) > max(SETTLED_SHARE * swing, scatter))
    first = int(late[-1]) + 1 if len(late) else 0
    return max(float(start_s[first]), 0.0) if first < len(grey) - len(tail) // 2 else float("inf")
