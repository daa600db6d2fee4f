"""What to do about what a frame shows, in words: the first thing first."""

from __future__ import annotations

import math

import numpy as np

from zeromethod.commissioning.focus import FocusReport
from zeromethod.commissioning.light_advice import (
    DARK_SHARE,
    SATURATED_SHARE,
    advised_exposure_s,
    exposure_lines,
    flicker_lines,
    light_share,
    no_light,
    stray_lines,
)
from zeromethod.commissioning.orientation import Alignment, Orientation
from zeromethod.rig.model import Rig

NO_TARGET_SCORE = 0.12
SHARP_SCORE = 0.8
"""At 16 px per period a blur of 1.7 px."""
UNEVEN = 0.15
UNSEEN_SHARE = 0.05
PART_SHARE = 0.5
"""Share of the image that should see the LCD at least."""
USABLE_SHARE = 0.9
WRONG_SIZE, WRONG_TURN_DEG, WRONG_PLACE_PERIODS = 0.02, 1.0, 0.25
"""Beyond these the rig file does not describe the bench well enough to start from."""
OTHER_SIZE = 0.1
"""The picture's period is another then, and the focus score says nothing."""
FINE_SIZE, FINE_PERIODS = 0.03, 0.4
"""Within these, by the plain pictures, the target itself shows size and place more finely."""

GOOD = "good: focus, light and view are as they should be"


def advice(
    report: FocusReport,
    rig: Rig,
    seen: Orientation | None = None,
    flicker_share: float = math.nan,
    *,
    exposure_s: float | None = None,
    wanted_s: float | None = None,
    hz: float = math.nan,
) -> tuple[str, ...]:
    """Advice, one line each; none when there is nothing to do.

    seen: from plain pictures, where they could be shown. flicker_share: standard deviation of the light from
    frame to frame over its mean; hz: its frequency, where it is the mains'. exposure_s: the frame's, else the
    rig's; wanted_s: the advised one, else that of this frame.
    """
    exposure_s = rig.camera.exposure_s if exposure_s is None else exposure_s
    if wanted_s is None:
        wanted_s = advised_exposure_s(report, rig, exposure_s, light_share(report, rig))
    said = exposure_lines(report, rig, exposure_s, wanted_s)
    dim = no_light(report, rig)
    blinded = report.saturated_share > SATURATED_SHARE
    if seen is not None and seen.seen_share < UNSEEN_SHARE:
        said.append(
            "the LCD is not seen: is it lit, on the right monitor, and seen by the camera in the mirror?"
        )
        return tuple(said)
    period_px = rig.target.period_px
    place = placed(report, seen, period_px)
    aimed = place is None or not any(_wrong(place, period_px))
    # geometry first: what lies elsewhere than the rig file says looks dusty, hidden or cut off
    if report.seen_share < PART_SHARE:
        said.append(
            f"by the rig file only {report.seen_share:.0%} of the image sees the LCD: compare its lengths "
            "and angles with the bench (`zeromethod design` draws it), move the camera, or take a longer lens"
        )
    if seen is not None:
        said += _lie(seen)
    if place is not None:
        said += _place(place, period_px)
    elif seen is None and report.alignment is None and report.on_target > NO_TARGET_SCORE and not blinded:
        said.append("the picture lies far from where the rig file expects it: compare pose and focal_px")
    far = place is not None and max(abs(place.wider), abs(place.higher)) > OTHER_SIZE
    if not blinded and not far:  # what is clipped, or of another period, looks blurred
        said += _sharpness(report, lcd_seen=seen is not None)
    said += stray_lines(seen)
    if not dim:
        said += flicker_lines(flicker_share, hz)
    if aimed and not blinded and light_share(report, rig) >= DARK_SHARE:
        said += _usable(report)
    return tuple(said)


def placed(report: FocusReport, seen: Orientation | None, period_px: int) -> Alignment | None:
    """Where the picture lies: by the target where that is near enough, else by the plain pictures.

    None where it is not known, or the picture is mirrored or turned by quarters.
    """
    if seen is None:
        return report.alignment
    coarse, fine = seen.place, report.alignment
    if coarse is None or fine is None:
        return coarse
    near = max(abs(coarse.wider), abs(coarse.higher)) < FINE_SIZE
    near &= max(abs(coarse.right_px), abs(coarse.down_px)) < FINE_PERIODS * period_px
    return fine if near else coarse


def misplaced(seen: Orientation, rig: Rig) -> bool:
    """Whether the LCD should be looked for again: it is not seen as it should be."""
    place = seen.place
    return place is None or not seen.upright or any(_wrong(place, rig.target.period_px))


def _sharpness(report: FocusReport, lcd_seen: bool) -> list[str]:
    if lcd_seen and not report.score > NO_TARGET_SCORE:
        return [
            "far out of focus: the LCD is seen, its pattern is not: close the aperture and focus on the "
            "LCD's image behind the mirror"
        ]
    if not lcd_seen and not report.on_target > NO_TARGET_SCORE:
        return [
            "no target is seen: is it on the LCD, does the camera look at it by the mirror? "
            "Else far out of focus: close the aperture and focus on the LCD's image"
        ]
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
    turn = (
        "",
        "turned by 90 degrees clockwise",
        "turned by 180 degrees",
        "turned by 90 degrees anticlockwise",
    )
    how = " and ".join(
        word for word in ("mirrored" if seen.mirrored else "", turn[seen.quarter_turns]) if word
    )
    if how:
        said.append(
            f"the picture is seen {how}: set display.mirrored, display.turn_deg or camera.roll_deg "
            "in the rig file to how the bench is built"
        )
    return said


def _usable(report: FocusReport) -> list[str]:
    if not report.score > NO_TARGET_SCORE or report.usable_share >= USABLE_SHARE:
        return []
    dark = f", {report.dark_share:.0%} dark" if report.dark_share > 0.01 else ""
    return [
        f"only {report.usable_share:.0%} of the view that should see the LCD is usable{dark}: clean the "
        "faces, take what touches off the mirror, compare the pose with the rig file"
    ]


def _wrong(place: Alignment, period_px: int) -> tuple[bool, bool, bool]:
    """Whether size, turn and place differ too much from what the rig file predicts."""
    away_px = max(abs(place.right_px), abs(place.down_px))
    return (
        max(abs(place.wider), abs(place.higher)) > WRONG_SIZE,
        abs(place.turn_deg) > WRONG_TURN_DEG,
        away_px > WRONG_PLACE_PERIODS * period_px,
    )


def _place(place: Alignment, period_px: int) -> list[str]:
    said = []
    size, turn, away = _wrong(place, period_px)
    if size:
        said.append(
            f"the picture is {place.wider:+z.1%} wide and {place.higher:+z.1%} high against the rig file: "
            "move the camera, or set its pose and focal_px"
        )
    if turn:
        clockwise = "clockwise" if place.turn_deg > 0 else "anticlockwise"
        said.append(
            f"the picture is turned by {abs(place.turn_deg):.1f} degrees {clockwise}: turn camera or LCD, "
            "or set camera.roll_deg"
        )
    if away:
        along = f"{abs(place.right_px):.0f} px {'right' if place.right_px > 0 else 'left'}"
        across = f"{abs(place.down_px):.0f} px {'below' if place.down_px > 0 else 'above'}"
        where = [word for word in (along, across) if not word.startswith("0 ")]
        said.append(
            f"the picture lies {' and '.join(where)} of where the rig file expects it: move camera or LCD, "
            "or set display.centre_mm, camera.centre_px or the pose"
        )
    return said
