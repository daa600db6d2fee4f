"""Levels of trust, apart from what finds them: a stored calibration is read without fitting anything."""

from __future__ import annotations

import enum


class Level(enum.StrEnum):
    """How far a calibration can be trusted."""

    GOOD = "good"
    UNCERTAIN = "uncertain"  # true, but says little about depth, or fragile
    BAD = "bad"  # something is wrong
