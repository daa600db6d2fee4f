"""Why a node's warp may not be trusted."""

from __future__ import annotations

import enum


class Flag(enum.IntFlag):
    """Reasons against a node, as bits; 0 means valid. Stored as uint16 arrays."""

    OUTSIDE = 1  # the sensing window does not fit in the image (the grid's padding)
    MODULATION = 2  # carrier too weak for its noise
    SATURATED = 4  # grey levels at the ceiling
    LIGHT_LOST = 8  # much darker than at rest: TIR fails or something touches
    FOLDED = 16  # several pixels see one LCD point: no picture can null them
    UNDRAWABLE = 32  # the carrier would alias on the LCD grid
    OFF_DISPLAY = 64  # looks past the LCD
    MIXED = 128  # two too different patterns in one exposure
    AMBIGUOUS = 256  # carrier order unknown (no unwrapping path)
    NO_RAY = 512  # at rest the pixel's ray misses the mirror or a face
