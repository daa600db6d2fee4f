"""The state of contact of a texture at one instant."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, fields
from typing import Any

NAN = float("nan")


class Motion(enum.StrEnum):
    """How the texture moves along the mirror."""

    UNKNOWN = "unknown"
    STICK = "stick"
    SLIP = "slip"


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactStatus:
    """What a texture does on the mirror, from one frame and those shortly before; NaN: not known.

    contact_id: number of its contact. looked_mm2: area looked at, between its outermost spots, without the
    contact's rim. share: of that area, in contact. spots_per_cm2, spot_mm2: density and mean area of the
    spots in contact; their sigmas take the spots for a sample of the texture. spot_life_s: mean time that a
    spot stays in contact. speed_mm_s, direction_deg (from x towards y, -180 to 180): of sliding. pitch_mm:
    distance from ridge to ridge, or row to row. ridge_deg: direction across them, from x towards y, 0 to 180.
    sigma_...: standard deviations. motion: stick or slip; lasts_s: for how long. event: "stick" or "slip" in
    the frame in which that is first reported, else "". aliased: the movement may be wrong by whole pitches:
    it is more than half a pitch per frame or per exposure, or other movements are as likely. force_n: of the
    contact. reason: why values are missing.
    """

    contact_id: int
    looked_mm2: float = NAN
    share: float = NAN
    sigma_share: float = NAN
    spots_per_cm2: float = NAN
    sigma_spots_per_cm2: float = NAN
    spot_mm2: float = NAN
    sigma_spot_mm2: float = NAN
    spot_life_s: float = NAN
    sigma_spot_life_s: float = NAN
    speed_mm_s: float = NAN
    sigma_speed_mm_s: float = NAN
    direction_deg: float = NAN
    sigma_direction_deg: float = NAN
    pitch_mm: float = NAN
    sigma_pitch_mm: float = NAN
    ridge_deg: float = NAN
    sigma_ridge_deg: float = NAN
    force_n: float = NAN
    sigma_force_n: float = NAN
    motion: Motion = Motion.UNKNOWN
    lasts_s: float = NAN
    event: str = ""
    aliased: bool = False
    reason: str = ""

    @classmethod
    def of_row(cls, row: Any) -> ContactStatus:
        """From a row of a recording's table."""
        values = {one.name: row[one.name].item() for one in fields(cls)}
        text = {name: one.decode() for name, one in values.items() if isinstance(one, bytes)}
        return cls(**{**values, **text, "motion": Motion(text["motion"])})

    @property
    def words(self) -> str:
        """For the operator."""
        if math.isnan(self.share):
            return self.reason
        moving = f", {self.speed_mm_s:.1f} mm/s" if self.motion is Motion.SLIP else ""
        return (
            f"{self.motion}{moving}{', aliased' if self.aliased else ''}, {100 * self.share:.0f} % in contact"
        )
