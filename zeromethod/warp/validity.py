"""Validity flags of nodes."""

from __future__ import annotations

import enum


class Flag(enum.IntFlag):
    """Reasons why a node is invalid, as bits; 0 means valid. Stored as uint16 arrays."""

    OUTSIDE = 1  # the sensing window does not fit in the image (the grid's padding)
    MODULATION = 2  # carrier too weak for its noise
    SATURATED = 4  # grey levels at the largest
    LIGHT_LOST = 8  # much darker than at rest: total reflection fails, or contact
    FOLDED = 16  # several pixels look at one LCD point: no picture can null them
    UNDRAWABLE = 32  # the carrier would alias on the LCD grid
    OFF_DISPLAY = 64  # looks past the LCD
    MIXED = 128  # too different pictures in one exposure
    AMBIGUOUS = 256  # carrier order unknown (no unwrapping path)
    NO_RAY = 512  # at rest the pixel's ray misses the mirror or a face
    CODED = 2048  # sees the coded pictures of a burst
    BESIDE_DARK = 1024  # failed a moment ago beside a place without light, and may again
    SEAM = 4096  # its window touches a seam between the teeth of a saw
