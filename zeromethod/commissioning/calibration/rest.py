"""The rest map, live: fringes shown one after the other, every one averaged over frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Image, Mask, Single
from zeromethod.commissioning.patterns import SettledPatterns, TimedPatterns, uniform_pattern
from zeromethod.decoding.fringes import SHIFTS, FringeSequence, equal_shifts
from zeromethod.decoding.masks import POOL_PX
from zeromethod.decoding.measuring import RestMeasurement, measure_rest
from zeromethod.decoding.near_reflection import USUAL_SHARE
from zeromethod.decoding.periods import SHORTEST_PX, choose_periods
from zeromethod.optics import Optics
from zeromethod.pattern import Response
from zeromethod.rig.model import Rig
from zeromethod.warp.rest_map import Reason, plain_name

SHORTEST_CAMERA_PX = 8
"""Shortest period as the camera sees it: a lens blur of 0.7 px then leaves 86 % of its contrast."""


LEAD_FRAMES = 8
"""Frames of black before the first picture: more than any computer is late by."""

MOST_FRAMES = 60
"""Frames that may pass until a picture has settled."""


@dataclass(frozen=True, eq=False)
class RestFrames:
    """What was captured of a fringe sequence.

    sums: (pictures, rows, cols) grey levels summed over `frames` frames each: exact, and enough to decode
    again.
    """

    sequence: FringeSequence
    sums: Image
    frames: int

    def means(self) -> Iterator[Single]:
        """Mean image (rows, cols) of every picture, in order."""
        for one in self.sums:
            yield one.astype(np.float32) / np.float32(self.frames)


def sequence_for(rig: Rig) -> FringeSequence:
    """Fringes for this panel, as fine as this camera resolves them."""
    display = rig.display
    periods = choose_periods(max(display.columns, display.rows), shortest_px=_shortest_px(rig))
    return FringeSequence(periods, equal_shifts(SHIFTS))


def _shortest_px(rig: Rig) -> int:
    camera = rig.camera
    u, v = np.meshgrid(np.linspace(0, camera.columns - 2, 9), np.linspace(0, camera.rows - 2, 9))
    optics = Optics(rig)
    here = optics.rest_map(u, v)
    across = np.linalg.norm(optics.rest_map(u + 1, v) - here, axis=-1)
    down = np.linalg.norm(optics.rest_map(u, v + 1) - here, axis=-1)
    lcd_px = max(float(np.nanmedian(across)), float(np.nanmedian(down)))
    return max(SHORTEST_PX, int(np.ceil(SHORTEST_CAMERA_PX * lcd_px)))


def capture(
    rig: Rig,
    patterns: TimedPatterns,
    sequence: FringeSequence,
    frames: int,
    on_picture: Callable[[], object] = lambda: None,
    variance_grey2: float = 0.0,
) -> RestFrames:
    """Show every picture of the sequence, drawn through the inverse of the rig's response.

    variance_grey2: of one reading; 0: time stamps alone say what a frame saw, see `SettledPatterns`.

    Raises MeasurementError for a picture that does not settle.
    """
    display, camera = rig.display, rig.camera
    response = Response.from_rig(rig.display)
    settled = SettledPatterns(patterns, 2.0 * variance_grey2, MOST_FRAMES)
    # From a picture that surely settled, each next one is known to have come when the view has changed.
    settled.frames(uniform_pattern(rig, 0), LEAD_FRAMES)
    kind = np.uint16 if frames * (2**camera.bits - 1) < 2**16 else np.uint32
    sums = np.zeros((sequence.frames, camera.rows, camera.columns), kind)
    for number, light in enumerate(sequence.pictures(display.columns, display.rows)):
        for frame in settled.frames(response.picture(light), frames):
            sums[number] += frame.image
        on_picture()
    return RestFrames(sequence, sums, frames)


def decode(rig: Rig, recorded: RestFrames) -> RestMeasurement:
    """Rest map of what was captured; the noise is found in the pictures' own scatter."""
    return measure_rest(
        recorded.means(),
        recorded.sequence,
        size_px=(rig.display.columns, rig.display.rows),
        # a mean this near to the ceiling holds frames that were cut off by it
        ceiling_grey=2**rig.camera.bits - 2.0,
    )


NOTABLE_SHARE = 0.002
"""Of the camera's pixels, from which what is left out for a reason is worth a word."""

LIKELY_REFLECTION = 0.3
"""Light of a second reflection, of the main one's, which no face of a prism makes."""

EVEN_REFLECTION = 1.5
"""Upper over lower quartile of a second reflection's light, which a face makes alike over the view."""

TIP_PX = 3 * POOL_PX
"""Most pixels of a row that see two teeth at a tip: a few, more as they are found over `POOL_PX`."""

_REFLECTION = (
    "see a second reflection of about {reflection:.0%} of the main one's light: shield or blacken the "
    "face that makes it, or turn the LCD a little (if another map shows none, something moved or pressed)"
)
_TWO_TEETH = (
    "rest map: two teeth: {share:.1%} of the camera's pixels see two teeth, at a tip: nothing need be done; "
    "they are left out"
)
_MOVED = (
    "saw the periods in different places, as where something pressed or moved while the fringes were shown: "
    "take it again (if it stays, a second reflection)"
)
_ADVICE = {
    Reason.SECOND_REFLECTION: _REFLECTION,
    Reason.DISTURBED: (
        "changed while the fringes were shown: a hand in the light, a moved part or another lamp: take it "
        "again"
    ),
    Reason.WRONG_ORDER: (
        "lie whole fringe periods off their neighbours: a step or crease in the mirror, or much noise"
    ),
    Reason.AMBIGUOUS_ORDER: (
        "could lie whole fringe periods off: more light, or more frames per picture (--frames)"
    ),
    Reason.SATURATED: "are too bright for the camera: shorten the exposure",
    Reason.OFF_DISPLAY: "look past the LCD's edge: move the LCD, or aim the camera",
    Reason.INCONSISTENT: ("see the periods disagree, each by itself: glitches of the camera, or much noise"),
}


def _has_moved(found: RestMeasurement, there: Mask) -> bool:
    """Whether the periods disagree rather because the mirror moved between them than by a reflection.

    A face reflects a small share of the light, alike over the view.
    """
    low, middle, high = np.quantile(found.reflection[there], (0.25, 0.5, 0.75))
    return bool(middle > LIKELY_REFLECTION or high > EVEN_REFLECTION * low)


def rest_notes(found: RestMeasurement, *, saw: bool = False) -> tuple[str, ...]:
    """What the person should see to in a rest map, the widest first; empty where all is well.

    Dead pixels are named from the first one on; what shows no fringes is not mirror, and no fault. saw: of
    teeth, whose tips lie across the rows.
    """
    reasons = found.rest_map.reason
    said = []
    for reason in sorted(_ADVICE, key=found.count, reverse=True):
        there = (reasons & int(reason)) != 0
        if saw and reason is Reason.SECOND_REFLECTION:
            wide = cv2.morphologyEx(there.view(np.uint8), cv2.MORPH_OPEN, np.ones((1, TIP_PX + 1), np.uint8))
            at_tips = there & (wide == 0)
            there &= ~at_tips
            if (share := float(at_tips.mean())) > NOTABLE_SHARE:
                said.append(_TWO_TEETH.format(share=share))
        if (share := float(there.mean())) > NOTABLE_SHARE:
            name, advice = plain_name(reason), _ADVICE[reason]
            if reason is Reason.SECOND_REFLECTION and _has_moved(found, there):
                name, advice = "moved", _MOVED
            reflection = float(np.median(found.reflection[there]))
            said.append(
                f"rest map: {name}: {share:.1%} of the camera's pixels "
                f"{advice.format(reflection=reflection)}; they are left out"
            )
    if found.near_px > 0:
        said.append(
            f"rest map: the periods disagree as if a second reflection of a tenth of the light lay "
            f"{found.near_px:.1f} LCD px off the main one (or the lens had coma): places may be off by "
            f"{USUAL_SHARE * found.near_px:.2f} LCD px, alike over wide parts; they are kept"
        )
    if dead := found.count(Reason.DEAD):
        said.append(f"rest map: dead: {dead} pixels of camera or LCD, or dust; they are left out")
    return tuple(said)
