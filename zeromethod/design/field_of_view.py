"""What the camera sees of the mirror and the LCD, and where its other rays end."""

from __future__ import annotations

from typing import Any

import numpy as np

from zeromethod.design.lever import mirror_mm_per_px
from zeromethod.design.sampled_view import SampledView, median_over
from zeromethod.optics import Lost


def field_of_view(view: SampledView) -> dict[str, Any]:
    """Ranges over the nodes that see the LCD, shares of all nodes, medians of what a pixel covers."""
    seen, trace, rig = view.seen, view.trace, view.rig
    x, y, q = view.x_mm[seen], view.y_mm[seen], trace.q[seen]
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
        "mirror_mm_per_px": median_over(mirror_mm_per_px(view), seen),
        "lcd_columns": [float(q[:, 0].min()), float(q[:, 0].max())],
        "lcd_rows": [float(q[:, 1].min()), float(q[:, 1].max())],
        "lcd_px_per_camera_px": median_over(across, seen),
        "sees_lcd_share": float(seen.mean()),
        "lost_share": lost,
    }
