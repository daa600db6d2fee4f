"""Curves of a bench's figures over one number of its rig file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from zeromethod.design.figures import HEADLINE_SIGMA_MM

_PANELS: tuple[tuple[str, str, tuple[tuple[str, str], ...]], ...] = (
    (
        "margin to the critical angle", "deg",
        (("tir_margin_deg", "middle of the view"), ("tir_least_margin_deg", "least of the view")),
    ),
    (
        "lever, slope along x", "px per mrad",
        (("lcd_px_per_mrad", "LCD px"), ("camera_px_per_mrad", "camera px")),
    ),
    ("depth, along x", "nm per camera px", (("depth_nm_per_px", ""),)),
    (f"Gaussian press, sigma {HEADLINE_SIGMA_MM:g} mm: folds at", "mm", (("gaussian_fold_mm", ""),)),
    ("footprint of the lens's pupil, along x", "mm", (("footprint_mm", ""),)),
    ("slope noise of one frame, along x", "urad", (("slope_sigma_urad", ""),)),
    ("mirror seen, along x", "mm", (("mirror_seen_mm", ""),)),
    ("view that sees the LCD", "share", (("sees_lcd_share", ""),)),
)  # fmt: skip


def draw_curves(found: dict[str, Any], label: str, rig: str, path: Path) -> None:
    """Write the curves of `zeromethod.design.curves` as PNG; a red line where total reflection begins."""
    values = np.array(found["values"])
    with mpl.rc_context({"font.size": 8, "axes.titlesize": 9}):
        figure = Figure(figsize=(14, 6.5), layout="constrained")
        for axis, (title, unit, lines) in zip(figure.subplots(2, 4).flat, _PANELS, strict=True):
            for key, name in lines:
                shown = np.array(
                    [np.nan if value is None else value for value in found[key]], dtype=np.float64
                )
                axis.plot(values, shown, ".-", markersize=4, label=name or None)
            if unit == "deg":
                axis.axhline(0.0, color="C3", linewidth=0.8)
            if len(lines) > 1:
                axis.legend()
            axis.set_title(title)
            axis.set_xlabel(label)
            axis.set_ylabel(unit)
            axis.set_xlim(values.min(), values.max())
            axis.grid(alpha=0.3)
        figure.suptitle(f"zeromethod design  rig {rig}, {label}", fontsize=11)
        figure.savefig(path, dpi=110)
