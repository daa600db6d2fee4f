"""What to do about what a frame shows, in words: the first thing first."""

from __future__ import annotations

import math

import numpy as np

from zeromethod.procedures.focus import FocusReport
from zeromethod.procedures.orientation import Orientation
from zeromethod.rig.model import CameraSpec

SATURATED_SHARE = 0.002
AIMED_SHARE, DARK_SHARE = 0.8, 0.35
"""Share of full scale that the brightest grey should reach, and below which the picture is too dark."""

NO_TARGET_SCORE = 0.12
SHARP_SCORE = 0.8
"""At 16 px per period a blur of 1.7 px."""
UNEVEN = 0.15
UNSEEN_SHARE = 0.05
USABLE_SHARE = 0.9
STRAY_SHARE = 0.1
FLICKER_SHARE = 0.01
WRONG_SIZE, WRONG_TURN_DEG = 0.02, 1.0
"""Beyond these the rig file does not describe the bench well enough to start from."""

GOOD = "good: focus, light and view are as they should be"


def advice(
    report: FocusReport, camera: CameraSpec, seen: Orientation | None = None, flicker_share: float = math.nan
) -> tuple[str, ...]:
    """Advice, one line each; `GOOD` alone when there is nothing to do.

    seen: from plain pictures, where they could be shown. flicker_share: standard deviation of the light from
    frame to frame over its mean.
    """
    said = _light(report, camera)
    unseen = seen is not None and seen.seen_share < UNSEEN_SHARE
    if unseen:
        said.append(
            "the LCD is not seen: is it lit, on the right monitor, and seen by the camera in the mirror?"
        )
    elif not report.score > NO_TARGET_SCORE:
        said.append(
            "no target is seen: is it on the LCD, does the camera look at it by the mirror? "
            "Else far out of focus: close the aperture and focus on the LCD's image"
        )
    else:
        said += _sharpness(report)
    if seen is not None and not unseen:
        said += _lie(seen)
    if flicker_share > FLICKER_SHARE:
        said.append(
            f"the light flickers by {flicker_share:.1%} from frame to frame: set the LCD to full brightness "
            "(no dimming by pulses), or expose for whole periods of it"
        )
    said += _view(report)
    return tuple(said) or (GOOD,)


def _light(report: FocusReport, camera: CameraSpec) -> list[str]:
    black = camera.noise.black_grey
    light = report.bright_grey - black
    exposure_ms = 1e3 * camera.exposure_s
    if report.saturated_share > SATURATED_SHARE:
        return [
            f"saturated ({report.saturated_share:.1%} of the pixels): shorten the exposure "
            f"(now {exposure_ms:.3g} ms) or lower the gain until none is"
        ]
    if light >= DARK_SHARE * (report.full_grey - black):
        return []
    if light <= 0.02 * report.full_grey:
        return ["no light: lens cap, aperture, LCD's backlight, exposure"]
    wanted_s = camera.exposure_s * AIMED_SHARE * (report.full_grey - black) / light
    if wanted_s <= 1 / camera.rate_hz:
        return [f"too dark: raise the exposure from {exposure_ms:.3g} to about {1e3 * wanted_s:.2g} ms"]
    return [
        f"too dark: {1e3 * wanted_s:.2g} ms would be wanted, a frame lasts {1e3 / camera.rate_hz:.3g} ms: "
        "open the aperture, raise the gain, or take fewer frames per second"
    ]


def _sharpness(report: FocusReport) -> list[str]:
    if report.score < SHARP_SCORE:
        return [
            f"out of focus (blur of about {report.blur_px:.1f} px): focus on the LCD's image behind the "
            "mirror, not on the mirror"
        ]
    if np.nanmax(report.modulation) - np.nanmin(report.modulation) > UNEVEN:
        return ["sharp in places only: close the aperture, or turn the camera to face the LCD's image"]
    return []


def _lie(seen: Orientation) -> list[str]:
    said = []
    turn = f"turned by {90 * seen.quarter_turns} degrees clockwise" if seen.quarter_turns else ""
    if seen.mirrored or turn:
        how = " and ".join(word for word in ("mirrored" if seen.mirrored else "", turn) if word)
        said.append(
            f"the picture is seen {how}: set display.mirrored, display.turn_deg or camera.roll_deg "
            "in the rig file to how the bench stands"
        )
    if seen.stray_share > STRAY_SHARE:
        said.append(f"stray light, {seen.stray_share:.0%} of the LCD's: darken the room, shade the prism")
    return said


def _view(report: FocusReport) -> list[str]:
    said = []
    if report.score > NO_TARGET_SCORE and report.usable_share < USABLE_SHARE:
        dark = f", {report.dark_share:.0%} dark" if report.dark_share > 0.01 else ""
        said.append(
            f"only {report.usable_share:.0%} of the view that should see the LCD is usable{dark}: clean the "
            "faces, take what touches off the mirror, compare the pose with the rig file"
        )
    picture = report.alignment
    if picture is None:
        return said
    if max(abs(picture.wider), abs(picture.higher)) > WRONG_SIZE:
        said.append(
            f"the picture is {picture.wider:+.1%} wide and {picture.higher:+.1%} high against the rig file: "
            "move the camera, or set its pose and focal_px"
        )
    if abs(picture.turn_deg) > WRONG_TURN_DEG:
        clockwise = "clockwise" if picture.turn_deg > 0 else "anticlockwise"
        said.append(
            f"the picture is turned by {abs(picture.turn_deg):.1f} degrees {clockwise}: turn camera or LCD, "
            "or set camera.roll_deg"
        )
    return said
