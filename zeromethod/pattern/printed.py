"""The picture that the LCD shows at rest, for a printer: the pattern of a passive bench."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.gl import create_context
from zeromethod.optics import Optics
from zeromethod.pattern.renderer import PatternRenderer
from zeromethod.pattern.response import Response
from zeromethod.pattern.target import Target
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

GAMMA = 2.2
"""Of grey codes on paper: printers take a picture for sRGB, whose curve is near it."""


MARGIN_MM = 12.0
"""Of the sheet around the pattern, for marks."""
FRAME_MM, LINE_MM, LETTER_MM = 1.0, 0.3, 3.0
"""Way from the pattern to the frame to cut along; thickness of lines; height of letters."""
BAR_MM = (100.0, 50.0, 20.0, 10.0)
"""Lengths of the bar by which the print's size is checked: the longest that fits half of the pattern."""


def bar_mm(cols: int, pitch_mm: float) -> float:
    """Length of the bar below a pattern so many pixels wide."""
    return next((length for length in BAR_MM if length <= 0.5 * cols * pitch_mm), BAR_MM[-1])


def printed_sheet(image: Bytes, pitch_mm: float) -> Bytes:
    """The pattern (rows, cols) on white, with a frame, which side is which, and a bar of known length."""
    margin, line, rows, cols = round(MARGIN_MM / pitch_mm), max(round(LINE_MM / pitch_mm), 1), *image.shape
    sheet = np.full((rows + 2 * margin, cols + 2 * margin), 255, np.uint8)
    sheet[margin : margin + rows, margin : margin + cols] = image
    away = round(FRAME_MM / pitch_mm) + line
    cv2.rectangle(sheet, [margin - away] * 2, (margin + cols + away, margin + rows + away), 0, line)
    top, below = margin - 2 * away, margin + rows + 2 * away
    _write(
        sheet,
        "TOP (LCD row 0). Side that faces the prism: this reads left to right",
        (margin, top),
        cols,
        pitch_mm,
    )
    length_mm = bar_mm(cols, pitch_mm)
    end, tall = margin + round(length_mm / pitch_mm), round(LETTER_MM / pitch_mm)
    for x in (margin, end - line):
        cv2.rectangle(sheet, (x, below), (x + line - 1, below + tall), 0, -1)
    cv2.rectangle(sheet, (margin, below + tall // 2), (end - 1, below + tall // 2 + line - 1), 0, -1)
    words = f"{length_mm:g} mm; left edge: LCD column 0"
    _write(sheet, words, (end + 2 * tall, below + tall), margin + cols - end - 2 * tall, pitch_mm)
    return sheet


def _write(sheet: Bytes, words: str, at: tuple[int, int], most: int, pitch_mm: float) -> None:
    """Write words from a place on, their baseline's left end, no wider than so many pixels."""
    font, line = cv2.FONT_HERSHEY_SIMPLEX, max(round(LINE_MM / pitch_mm), 1)
    (width, height), _ = cv2.getTextSize(words, font, 1.0, 1)
    cv2.putText(
        sheet, words, at, font, min(LETTER_MM / pitch_mm / height, most / width), 0, line, cv2.LINE_AA
    )


def printed_pattern(rig: Rig) -> Bytes:
    """Grey codes (rows, cols) of the rig's display while nothing presses.

    Row 0 at the top, as one looks at the side that faces the prism. Raises InputError for a rig that sees no
    display, or where nothing can draw.
    """
    rest = Rest.of(rig, Optics(rig))
    context = create_context()
    with context:
        lattice = rest.grid, rest.q, rest.display_size
        renderer = PatternRenderer(context, *lattice, Target.from_spec(rig.target), Response(GAMMA))
        image = renderer.image(rest.q)
    context.release()
    return image
