"""Seams of a saw: how much of the mirror they hide, and how many nodes they take."""

from __future__ import annotations

import numpy as np

from zeromethod.design.sampled_view import SampledView
from zeromethod.optics import Lost
from zeromethod.warp.seams import SeamMap

_LEAST_MM = 0.05
"""Gap between points of neighbouring pixels' rays that counts as a seam."""
_PER_PX = 8


def seam_figures(view: SampledView) -> dict[str, float] | None:
    """Pitch of the teeth, mirror that the widest seam hides, shares of view and nodes; None of a prism."""
    seams, rig = SeamMap.of(view.optics, view.grid), view.rig
    if seams is None or rig.prism.teeth is None:
        return None
    u = np.arange(_PER_PX * rig.camera.columns) / _PER_PX
    trace = view.optics.trace(u, np.full_like(u, (rig.camera.rows - 1) / 2), view.optics.rest)
    x_mm = np.sort(trace.point[trace.lost != Lost.SEAM, 0])
    apart = np.diff(x_mm[np.isfinite(x_mm)])
    hidden = apart[apart > _LEAST_MM]
    return {
        "pitch_mm": view.optics.length_mm / rig.prism.teeth.count,
        "band_mm": float(hidden.max(initial=0.0)),
        "hidden_share": float(hidden.sum() / np.ptp(x_mm)),
        "nodes_share": float(seams.touched(np.zeros(seams.x_mm.shape)).mean()),
    }
