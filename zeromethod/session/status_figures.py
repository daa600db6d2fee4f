"""The contact status of a run: medians of its figures, and when it stuck and slipped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from zeromethod.rubbing import ContactStatus, Motion

_OF_SLIP = ("speed_mm_s", "sigma_speed_mm_s", "direction_deg", "sigma_direction_deg")
_NOT_MEASURED = ("contact_id", "lasts_s")


def status_figures(found: Sequence[tuple[float, ContactStatus]]) -> dict[str, Any] | None:
    """Medians over frames (time_s, status); of speed and direction over those that slip and are not aliased.

    A figure that was never known is None; `reason` says why the last frame lacked what it lacked. events:
    (time_s, "stick" or "slip"). aliased: share of the frames that slip. None where no texture touched.
    """
    if not found:
        return None
    known = [status for _, status in found]
    slips = [one for one in known if one.motion is Motion.SLIP]
    figures: dict[str, Any] = {"frames": len(known)}
    for name, value in asdict(known[-1]).items():
        if isinstance(value, float) and name not in _NOT_MEASURED:
            of = [one for one in slips if not one.aliased] if name in _OF_SLIP else known
            values = np.array([getattr(one, name) for one in of])
            values = values[np.isfinite(values)]
            figures[name] = float(np.median(values)) if values.size else None
    figures["aliased"] = float(np.mean([one.aliased for one in slips])) if slips else None
    figures["events"] = [(time_s, one.event) for time_s, one in found if one.event]
    return figures | {"reason": known[-1].reason}
