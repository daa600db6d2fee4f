"""Coded pictures: fringes over parts of the LCD, at places of the panel that no warp moves.

light(x) = mean (1 + contrast cos(2 pi x / period - shift)), x the LCD column or row in px, pixel centres at
integers. A burst is all of them: both axes, two periods, four shifts that cancel even harmonics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from zeromethod.arrays import Float

PERIODS_LCD_PX = (20.0, 23.0)
"""Within 65 px of where a place is thought to be, no two places look alike to within 3 px in both."""

SHIFTS = 4
"""Shifts of each fringe, a quarter of a period apart."""
PICTURES = 2 * len(PERIODS_LCD_PX) * SHIFTS

MOST_PARTS = 4
"""Parts of the LCD that may be drawn at once."""


@dataclass(frozen=True, slots=True)
class Coded:
    """One picture of a burst. number: 0 to 15. parts: (n, 4) left, top, right, bottom, LCD px."""

    number: int
    parts: Float

    @property
    def axis(self) -> int:
        """0: the fringes count columns, 1: rows."""
        return self.number // (PICTURES // 2)

    @property
    def period_px(self) -> float:
        """LCD px."""
        return PERIODS_LCD_PX[self.number // SHIFTS % len(PERIODS_LCD_PX)]

    @property
    def shift_rad(self) -> float:
        """Of the fringes, towards growing columns or rows."""
        return 2 * math.pi * (self.number % SHIFTS) / SHIFTS
