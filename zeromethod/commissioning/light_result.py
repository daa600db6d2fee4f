"""What was learnt about the light, what to do about it, and what of it a rig file holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from zeromethod.arrays import Bytes, Float, Mask
from zeromethod.calibration.falloff import Falloff
from zeromethod.calibration.panel_faults import FaultCheck
from zeromethod.calibration.photon_transfer import PhotonTransfer
from zeromethod.calibration.response import MeasuredResponse
from zeromethod.calibration.viewing_angle import spread_left


@dataclass(frozen=True)
class LightResult:
    """What was learnt about the light.

    exponent: at the panel's corners, see `calibration.viewing_angle`; None: one response for all of it.
    exponents: the same at the tiles. bad_pixels: (rows, cols) `BadPixel`. findings: every check of the
    display, found or not. lit: (rows, cols) camera pixels that look at the LCD. hold_s: from presentation
    until a picture counts as settled.
    """

    response: MeasuredResponse
    exponent: tuple[tuple[float, float], tuple[float, float]] | None
    exponents: Float | None
    noise: PhotonTransfer
    bad_pixels: Bytes
    falloff: Falloff
    findings: tuple[FaultCheck, ...]
    lit: Mask
    hold_s: float
    notes: tuple[str, ...]

    @property
    def advice(self) -> tuple[str, ...]:
        """What should be seen to, the display's faults first; empty where all is well."""
        said = [finding.words for finding in self.findings if finding.found]
        if (tile := self.falloff.weak_tile) is not None:
            rows, columns = self.falloff.light.shape
            said.append(
                f"region {tile[0] + 1}, {tile[1] + 1} of {rows} x {columns} (row, column) has "
                f"{100 * self.falloff.darkest:.0f} % of the brightest region's light, and so more noise: "
                "turn the LCD's best viewing direction to the prism, or aim the camera so that it looks "
                "along the reflected light"
            )
        if left := spread_left(self.response, self.exponents):
            said.append(
                f"the response differs by up to {100 * left:.1f} % of the white's light over the view beyond "
                "what the drawing can mend: turn the LCD's best viewing direction to the prism, or take an "
                "IPS panel"
            )
        return (*said, *self.notes, *self.response.notes, *self.noise.notes)

    def rig_values(self) -> dict[str, Any]:
        """Keys and values of the rig file that were measured, for `save_values`."""
        values: dict[str, Any] = self.response.rig_values() | self.noise.rig_values()
        if self.exponent is not None:
            values["display.response_exponent"] = [[round(one, 4) for one in row] for row in self.exponent]
        return values
