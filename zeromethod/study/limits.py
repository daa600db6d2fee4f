"""The procedure "design": the deepest presses that a bench can null, from its rays alone."""

from __future__ import annotations

import numpy as np

from zeromethod.design.lever import gaussian_fold_mm, lcd_px_per_mrad
from zeromethod.design.press_limits import PressKind, press_limit
from zeromethod.design.sampled_view import SampledView, median_over
from zeromethod.design.tir import incidence_deg, margin_deg
from zeromethod.optics import check_geometry
from zeromethod.study.task import Figures, Procedure, Task


def limits(task: Task) -> Figures:
    """Limits of a press of `shape` and `size_mm` in the middle of the view; None: beyond any depth tried."""
    check_geometry(task.rig)
    view = SampledView(task.rig)
    kind = PressKind.parse(f"{task.settings['shape']}:{task.settings['size_mm']}")
    region = view.central
    limit = press_limit(view, kind, region.x_mm, region.y_mm)
    gaussian = kind.shape.value == "gaussian"
    return {
        "path_mm": float(np.median(view.trace.path_mm[region.mask])),
        "fold_mm": limit.fold_mm,
        "nulled_mm": limit.nulled_mm,
        "because": limit.because,
        "total_mm": limit.total_mm,
        "closed_form_mm": _fold_mm(view, kind.size_mm) if gaussian else None,
        "incidence_deg": float(np.median(incidence_deg(view.trace)[region.mask])),
        "tir_least_margin_deg": float(np.nanmin(margin_deg(view))),
        "lcd_px_per_mrad": median_over(lcd_px_per_mrad(view), region.mask)[0],
        "sees_lcd_share": float(view.on_lcd.mean()),
    }


def _fold_mm(view: SampledView, sigma_mm: float) -> float:
    return float(np.nanmedian(gaussian_fold_mm(view, sigma_mm)[view.central.mask]))


DESIGN = Procedure(
    limits,
    {
        "path_mm": "from the mirror to the LCD along the ray, optical lever included, mm",
        "fold_mm": "depth at which some node folds, mm",
        "nulled_mm": "deepest press that a picture nulls whole, mm",
        "because": "what ends it",
        "total_mm": "depth up to which reflection is total everywhere, mm",
        "closed_form_mm": "fold limit of a Gaussian by its curvature alone, mm",
        "incidence_deg": "angle of incidence at the mirror, middle of the view, deg",
        "tir_least_margin_deg": "least margin to the critical angle in the view, deg",
        "lcd_px_per_mrad": "lever along x, LCD px per mrad of slope",
        "sees_lcd_share": "share of the nodes that see the LCD",
    },
    {"shape": "gaussian", "size_mm": 2.0},
)
