"""What is wrong with a bench, each in one line that says what would help."""

from __future__ import annotations

import math
from typing import Any

from zeromethod.design.sampled_view import SampledView
from zeromethod.design.vary import smallest_total_angle

_LITTLE_MARGIN_DEG = 1.0
_GRID_BIAS_PX = 0.01
_FEW_SEEN = 0.9


def design_warnings(view: SampledView, figures: dict[str, Any]) -> list[str]:
    """Warnings on the figures of `design_figures`, the gravest first."""
    return [*_total_reflection(view, figures["tir"]), *_others(view, figures)]


def _total_reflection(view: SampledView, tir: dict[str, Any]) -> list[str]:
    prism, critical = view.rig.prism, tir["critical_deg"]
    if tir["below_share"] == 0.0 and tir["centre_margin_deg"] > 0.0:
        least = tir["least_margin_deg"]
        if least > _LITTLE_MARGIN_DEG:
            return []
        slope_mrad = 1e3 * math.tan(math.radians(least))
        return [
            f"the least margin is {least:.2f} deg: a slope of {slope_mrad:.0f} mrad ends total reflection"
        ]
    angle = smallest_total_angle(view.rig)
    cure = (
        f"with both faces at {angle:.1f} deg the whole view is beyond it"
        if angle is not None
        else "no angle of the faces brings the whole view beyond it"
    )
    if tir["centre_margin_deg"] <= 0.0:
        return [
            f"a prism of {prism.pattern_angle_deg:g} deg with index {prism.index:g} is below the critical "
            f"angle: the centre ray meets the mirror at {tir['centre_incidence_deg']:.2f} deg, total "
            f"reflection begins at {critical:.2f} deg; reflectance is {tir['centre_reflectance']:.2f} and "
            f"swings with slope; {cure}"
        ]
    return [
        f"{tir['below_share']:.0%} of the view are below the critical angle of {critical:.2f} deg, by up to "
        f"{-tir['least_margin_deg']:.2f} deg: dim, and swinging with slope; {cure}"
    ]


def _others(view: SampledView, figures: dict[str, Any]) -> list[str]:
    found = []
    share = figures["view"]["sees_lcd_share"]
    if share < _FEW_SEEN:
        lost = figures["view"]["lost_share"]
        why = max(lost, key=lost.__getitem__).replace("_", " ")
        found.append(f"only {share:.0%} of the view see the LCD; most of the others: {why}")
    bias = figures["noise"]["grid_bias_px"]
    if bias > _GRID_BIAS_PX:
        found.append(
            f"the LCD's own pixels may bias readings by up to {bias:.2f} camera px, which averaging keeps: "
            f"blur the lens to 0.7 camera px (psf_px is {view.rig.camera.psf_px:g})"
        )
    return found
