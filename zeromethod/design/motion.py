"""Which rigid motions of camera, LCD and prism a bench can notice, and what would show the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from zeromethod.bench_motion.marks import apart_px, mark_places
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.design.sampled_view import SampledView
from zeromethod.surface.reader import SurfaceReader
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

_SHOWS = 0.05
"""Share of a motion that no press can imitate, from which the motion shows under one."""

_SIGMA_LCD_PX = 0.01

Figures = dict[str, Any]


def motion_figures(view: SampledView) -> Figures:
    """Groups of motions that look alike, with the share of each that no press imitates.

    modes: patterns that motion makes. groups: {"motions", "share_under_press"}, the share 1 where all of it
    shows under any press. beyond_px: camera px from the view's border to the mirror's edges, below 0 inside.
    marks: of the rig, watched. mark_room_px: camera px from each border of the image in which a mark's middle
    may lie, above 0 where there is room.
    """
    modes = BenchModes.of(view.optics, view.grid)
    rest = Rest.of(view.rig, view.optics)
    warp = Warp(rest.q, np.full_like(rest.q, _SIGMA_LCD_PX), rest.flags, 0)
    curl = SurfaceReader(view.rig, view.optics, rest.grid).read(warp).curl
    seen = np.zeros((modes.count, 1)) if curl is None else curl.seen
    groups: dict[str, float] = {}
    for motion in modes.motions:
        size = float(np.linalg.norm(motion))
        if size > 1e-6 * float(np.abs(modes.motions).max()):
            groups.setdefault(modes.group(motion), float(np.linalg.norm(seen.T @ motion)) / size)
    return {
        "modes": modes.count,
        "groups": [{"motions": name, "share_under_press": share} for name, share in groups.items()],
        "shows_from_share": _SHOWS,
        "beyond_px": _edges_beyond_px(view),
        "marks": len(mark_places(view.rig, rest.grid, rest.visible)),
        "mark_room_px": _mark_room_px(rest),
    }


def _mark_room_px(rest: Rest) -> dict[str, float]:
    """How far from each border the middle of a mark may lie; below what its window needs there is none."""
    (u, v), (rows, columns) = (one[rest.visible] for one in rest.grid.mesh()), rest.grid.image_shape
    apart = apart_px(rest.grid)
    sides = {"left": u.min(), "right": columns - 1 - u.max(), "top": v.min(), "bottom": rows - 1 - v.max()}
    return {side: float(px) - apart for side, px in sides.items()}


def _edges_beyond_px(view: SampledView) -> dict[str, float]:
    """Camera px beyond the image's border, along u, at which P0 and R0 lie; straight on from the border."""
    known = np.isfinite(view.x_mm).any(axis=0)
    x_mm, u_px = np.nanmedian(view.x_mm[:, known], axis=0), view.u_px[0, known]
    last_px = view.rig.camera.columns - 1.0
    found = {}
    for name, edge_mm in (("P0", 0.0), ("R0", view.optics.length_mm)):
        near = 0 if abs(x_mm[0] - edge_mm) < abs(x_mm[-1] - edge_mm) else -1
        other = 1 if near == 0 else -2
        per_px = (x_mm[near] - x_mm[other]) / (u_px[near] - u_px[other])
        at_px = u_px[near] + (edge_mm - x_mm[near]) / per_px
        found[name] = float(-at_px if near == 0 else at_px - last_px)
    return found
