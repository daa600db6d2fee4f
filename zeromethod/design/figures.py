"""All figures of a bench as plain numbers: what the table prints and the summary contains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from zeromethod.design.carrier import carrier_figures
from zeromethod.design.delay_budget import delay_budget, total_s
from zeromethod.design.lever import (
    camera_px_per_mrad,
    depth_nm_per_px,
    gaussian_fold_mm,
    largest_curvature_per_mm,
    lcd_px_per_mrad,
    mirror_mm_per_px,
)
from zeromethod.design.motion import motion_figures
from zeromethod.design.noise_floor import noise_floor, slope_sigma_urad
from zeromethod.design.press_limits import PressKind, press_limit
from zeromethod.design.resolution import footprint_mm, resolution
from zeromethod.design.sampled_view import SampledView, median_over
from zeromethod.design.seams import seam_figures
from zeromethod.design.tir import (
    SLOPES_MRAD,
    critical_deg,
    incidence_deg,
    margin_deg,
    margins_by_slope_deg,
    slope_to_loss_mrad,
)
from zeromethod.optics import Lost

Figures = dict[str, Any]

HEADLINE_SIGMA_MM = 2.0


def design_figures(
    view: SampledView,
    kinds: Sequence[PressKind],
    pupil_mm: float,
    computing_s: float,
    on_press: Callable[[], object] = lambda: None,
) -> Figures:
    """Everything but stability. `on_press` is called after each press, len(kinds) x regions times."""
    budget = delay_budget(view, computing_s)
    total = total_s(budget)
    noise = noise_floor(view)
    return {
        "rig": view.rig.name,
        "tir": _tir(view),
        "regions": _regions(view),
        "presses": _presses(view, kinds, on_press),
        "resolution": resolution(view, pupil_mm),
        "noise": noise,
        "carrier": carrier_figures(view, noise["depth_rms_nm"]),
        "delay": {
            "steps": [asdict(step) for step in budget],
            "mean_s": total.mean_s,
            "worst_s": total.worst_s,
            "mean_frames": total.mean_s * view.rig.camera.rate_hz,
            "worst_frames": total.worst_s * view.rig.camera.rate_hz,
            "computing_s": computing_s,
        },
        "view": field_of_view(view),
        "seams": seam_figures(view),
        "motion": motion_figures(view),
    }


def headline(view: SampledView, pupil_mm: float) -> dict[str, float]:
    """The few figures that a curve is drawn of: of the whole view, or medians of its central region."""
    margin, mask = margin_deg(view), view.central.mask
    return {
        "tir_margin_deg": float(np.median(margin[mask])),
        "tir_least_margin_deg": float(np.nanmin(margin)),
        "lcd_px_per_mrad": median_over(lcd_px_per_mrad(view), mask)[0],
        "camera_px_per_mrad": median_over(camera_px_per_mrad(view), mask)[0],
        "depth_nm_per_px": median_over(depth_nm_per_px(view), mask)[0],
        "gaussian_fold_mm": float(np.nanmedian(gaussian_fold_mm(view, HEADLINE_SIGMA_MM)[mask])),
        "footprint_mm": median_over(footprint_mm(view, pupil_mm), mask)[0],
        "slope_sigma_urad": median_over(slope_sigma_urad(view), mask)[0],
        "mirror_seen_mm": float(np.ptp(view.x_mm[view.on_lcd])),
        "sees_lcd_share": float(view.on_lcd.mean()),
    }


def _tir(view: SampledView) -> Figures:
    incidence, critical = incidence_deg(view.trace), critical_deg(view.rig)
    on_lcd, centre = view.on_lcd, view.optics.centre()
    at_centre = float(incidence_deg(centre)[0])
    return {
        "critical_deg": critical,
        "centre_incidence_deg": at_centre,
        "centre_margin_deg": at_centre - critical,
        "centre_reflectance": float(centre.reflectance[0]),
        "least_margin_deg": float(incidence[on_lcd].min()) - critical,
        "below_share": float(np.mean(incidence[on_lcd] < critical)),
        "slopes_mrad": list(SLOPES_MRAD),
    }


def _regions(view: SampledView) -> list[Figures]:
    margins, loss = margins_by_slope_deg(view), slope_to_loss_mrad(view)
    lcd, camera, depth = lcd_px_per_mrad(view), camera_px_per_mrad(view), depth_nm_per_px(view)
    curvature = largest_curvature_per_mm(view)
    return [
        {
            "x_mm": region.x_mm,
            "y_mm": region.y_mm,
            "nodes": int(region.mask.sum()),
            "tir_margin_deg": [float(margin[region.mask].min()) for margin in margins],
            "slope_to_loss_mrad": float(loss[region.mask].min()),
            "path_mm": float(np.median(view.trace.path_mm[region.mask])),
            "lcd_px_per_mrad": median_over(lcd, region.mask),
            "camera_px_per_mrad": median_over(camera, region.mask),
            "depth_nm_per_px": median_over(depth, region.mask),
            "curvature_per_mm": float(np.nanmedian(curvature[region.mask])),
        }
        for region in view.regions
    ]


def _presses(view: SampledView, kinds: Sequence[PressKind], on_press: Callable[[], object]) -> list[Figures]:
    def limit_at(kind: PressKind, x_mm: float, y_mm: float) -> Figures:
        limit = press_limit(view, kind, x_mm, y_mm)
        on_press()
        return {"x_mm": x_mm, "y_mm": y_mm, **asdict(limit)}

    places = [(region.x_mm, region.y_mm) for region in view.regions]
    return [{"press": str(kind), "limits": [limit_at(kind, *at) for at in places]} for kind in kinds]


def field_of_view(view: SampledView) -> dict[str, Any]:
    """Ranges over the nodes that see the LCD, shares of all nodes, medians of what a pixel covers."""
    on_lcd, trace, rig = view.on_lcd, view.trace, view.rig
    optics = view.optics
    faces = [optics.prism.pattern_face] if optics.saw is None else optics.saw.pattern
    x, y, q = view.x_mm[on_lcd], view.y_mm[on_lcd], trace.q[on_lcd]
    corners = [(0, 0), (0, -1), (-1, -1), (-1, 0)]
    outline = np.array([(view.x_mm[corner], view.y_mm[corner]) for corner in corners])
    lost = {
        reason.name.lower(): float(np.mean(trace.lost == reason))
        for reason in Lost
        if reason not in (Lost.NONE, Lost.BELOW_TIR) and np.any(trace.lost == reason)
    }
    across = np.linalg.norm(view.lcd_per_camera, axis=-2)
    return {
        "mirror_x_mm": [float(x.min()), float(x.max())],
        "mirror_y_mm": [float(y.min()), float(y.max())],
        "corners_mm": outline.tolist(),
        "mirror_length_mm": view.optics.length_mm,
        "mirror_width_mm": rig.prism.width_mm,
        "teeth": None if rig.prism.teeth is None else rig.prism.teeth.count,
        "thickness_mm": -min(float(face.end_mm[2]) for face in faces),
        "mirror_mm_per_px": median_over(mirror_mm_per_px(view), on_lcd),
        "lcd_columns": [float(q[:, 0].min()), float(q[:, 0].max())],
        "lcd_rows": [float(q[:, 1].min()), float(q[:, 1].max())],
        "lcd_px_per_camera_px": median_over(across, on_lcd),
        "sees_lcd_share": float(on_lcd.mean()),
        "lost_share": lost,
    }
