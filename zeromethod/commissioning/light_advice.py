"""Exposure, brightness of the LCD and what to shade: from frames of the target, and of a black LCD.

Depth is read with the least sigma where the carrier is as large as the camera takes it: light goes into the
amplitude in full, and into its noise by the root. So the best exposure is the longest at which nothing
saturates, or that a frame has room for. Where the light flickers with the mains, a whole number of its
periods is taken if it is hardly shorter.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from zeromethod.arrays import Float
from zeromethod.commissioning.focus import FocusReport
from zeromethod.commissioning.orientation import Orientation
from zeromethod.rig.model import Rig

SATURATED_SHARE = 0.002
AIMED_SHARE = 0.88
"""Share of full scale that the target's peaks should reach: they then have ten deviations of the packaged
bench's noise to full scale, and flicker and drift some room."""
LAMP_SHARE = 0.8
"""The same where a lamp lights the pattern by way of the mirror, which focuses its light round a press: what
saturates there is masked, which costs less than less light everywhere."""
DARK_SHARE = 0.35
"""Share of full scale of the brightest grey below which the picture is too dark."""
NO_LIGHT_SHARE = 0.01
"""Share of full scale that the mean grey of any picture exceeds."""
GOOD_WITHIN = 1.3
"""Exposures within this factor of the advised one are left as they are."""
STRAY_SHARE = 0.1
FLICKER_SHARE = 0.01
MAINS_HZ = (100.0, 120.0)
MAINS_SHARE = 0.7
"""Share of the light's variance from frame to frame that the mains must explain."""


class GreyLevels(Protocol):
    """What a frame's grey levels are, as of `FocusReport`."""

    @property
    def mean_grey(self) -> float:
        """Of the frame."""

    @property
    def full_grey(self) -> float:
        """At which the camera saturates."""

    @property
    def saturated_share(self) -> float:
        """Of the pixels."""


def mains_hz(times_s: Float, light: Float) -> float:
    """Frequency of the mains' light, Hz, that explains how the light (n,) of frames swings; NaN for none.

    times_s: (n,) of mid-exposure. What the frames see standing still cannot be found, nor does it matter.
    """
    best, hz_found = MAINS_SHARE, math.nan
    t = times_s - times_s.mean()
    line = np.stack([np.ones_like(t), t], axis=-1)

    def left(terms: Float) -> float:
        return float(np.sum((light - terms @ np.linalg.lstsq(terms, light, rcond=None)[0]) ** 2))

    whole = left(line)
    for hz in MAINS_HZ:
        wave = np.stack([np.cos(2 * math.pi * hz * t), np.sin(2 * math.pi * hz * t)], axis=-1)
        share = 1 - left(np.concatenate((line, wave), axis=-1)) / whole if whole > 0 else 0.0
        if share > best:
            best, hz_found = share, hz
    return hz_found


def light_share(report: FocusReport, rig: Rig, stray_grey: float = 0.0) -> float:
    """Brightest light over what the camera can take, as if the picture were in focus.

    stray_grey: grey levels of light that is known not to come from the LCD.
    """
    black = rig.camera.noise.black_grey
    by_mean = (1 + rig.target.contrast) * (report.mean_grey - black - stray_grey) + stray_grey
    return max(report.bright_grey - black, by_mean) / (report.full_grey - black)


def no_light(report: GreyLevels, rig: Rig) -> bool:
    """Whether the picture is as good as black."""
    black = rig.camera.noise.black_grey
    return report.mean_grey - black <= NO_LIGHT_SHARE * (report.full_grey - black)


def advised_exposure_s(
    report: GreyLevels, rig: Rig, exposure_s: float, brightest: float, hz: float = math.nan
) -> float:
    """Exposure at which depth has the least sigma; longer than a frame where more light is wanted.

    exposure_s: of the frame. brightest: `light_share` of the brightest of the last frames. hz: of flicker,
    NaN for none. NaN without light; half of `exposure_s` where the picture saturates.
    """
    if no_light(report, rig):
        return math.nan
    if report.saturated_share > SATURATED_SHARE:
        return 0.5 * exposure_s
    aimed = LAMP_SHARE if rig.light.by_mirror else AIMED_SHARE
    wanted_s = exposure_s * aimed / brightest
    if math.isfinite(hz):
        most_s = min(wanted_s, 1 / rig.camera.rate_hz)
        whole_s = math.floor(most_s * hz * (1 + 1e-6)) / hz
        if whole_s * GOOD_WITHIN >= most_s:
            return whole_s
    return wanted_s


def exposure_lines(report: FocusReport, rig: Rig, exposure_s: float, wanted_s: float) -> list[str]:
    """What to do about the exposure."""
    now_ms, wanted_ms, frame_s = 1e3 * exposure_s, 1e3 * wanted_s, 1 / rig.camera.rate_hz
    if report.saturated_share > SATURATED_SHARE:
        return [
            f"saturated ({report.saturated_share:.1%} of the pixels): shorten the exposure "
            f"(now {now_ms:.3g} ms) or lower the gain until none is"
        ]
    if no_light(report, rig):
        return ["no light: lens cap, aperture, LCD's backlight, exposure"]
    dark = light_share(report, rig) < DARK_SHARE * (LAMP_SHARE if rig.light.by_mirror else 1.0)
    if wanted_s > frame_s and (dark or frame_s > GOOD_WITHIN * exposure_s):
        return [
            f"too dark: {wanted_ms:.0f} ms would be wanted, a frame lasts {1e3 * frame_s:.3g} ms: set the "
            "LCD to full brightness, open the aperture, raise the gain, or take fewer frames per second"
        ]
    if dark:
        return [f"too dark: raise the exposure from {now_ms:.3g} to about {wanted_ms:.2g} ms"]
    if not 1 / GOOD_WITHIN <= min(wanted_s, frame_s) / exposure_s <= GOOD_WITHIN:
        return [f"set the exposure from {now_ms:.3g} to about {wanted_ms:.2g} ms: the least noise of depth"]
    return []


def stray_lines(seen: Orientation | None) -> list[str]:
    """What to shade."""
    if seen is None:
        return []
    said = []
    if (glare := seen.glare) is not None:
        said.append(
            f"with the LCD black a lamp's image is seen, {glare.share:.0%} of the LCD's light, "
            f"{glare.size_px:.0f} px wide about column {glare.u_px:.0f}, row {glare.v_px:.0f}: move or shade "
            "the lamp (a ring light: switch it off)"
        )
    elif seen.stray_share > STRAY_SHARE:
        said.append(
            f"stray light, {seen.stray_share:.0%} of the LCD's: darken the room, shade the prism, or set the "
            "LCD to full brightness"
        )
    return said


def flicker_lines(flicker_share: float, hz: float) -> list[str]:
    """What to do about light that changes from frame to frame."""
    if not flicker_share > FLICKER_SHARE:
        return []
    if math.isfinite(hz):
        periods = ", ".join(f"{1e3 * count / hz:.3g}" for count in (1, 2))
        return [
            f"lamps on the mains flicker by {flicker_share:.1%} from frame to frame ({hz:.0f} Hz): shade the "
            f"prism from them, or expose for whole periods ({periods} ms ...)"
        ]
    return [
        f"the light flickers by {flicker_share:.1%} from frame to frame: set the LCD to full brightness "
        "(no dimming by pulses), or expose for whole periods of it"
    ]
