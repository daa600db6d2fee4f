"""The surfaces of a recording, as they were read: at the nodes, and on every pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zeromethod.fine.lattice import PixelLattice
from zeromethod.fine.surface import FineSurface
from zeromethod.recording.damage import unknown_surface
from zeromethod.recording.rows import FINE_PIXELS
from zeromethod.recording.step_index import StepIndex
from zeromethod.surface import Anchor, Surface

if TYPE_CHECKING:
    from zeromethod.recording.recording import Recording


def node_surface(recording: Recording, index: StepIndex, group: str, step: int) -> Surface | None:
    """Surface at the nodes, of the group "surface" or "fine_nodes"; None where a step has none.

    One without a valid node where it is damaged.
    """
    names = ("depth_mm", "slope", "x_mm", "y_mm", "sigma_depth_mm", "sigma_slope")
    found = index.arrays(group, step, *names, "valid", "contact", "anchor", "table")
    if found is None:
        if index.at(group, step) is None:
            return None
        return unknown_surface(recording.grid.shape, recording.row(step))
    *floats, valid, contact, mask, about = found
    values = {name: one.astype(np.float64) for name, one in zip(names, floats, strict=True)}
    sigma_mm, tail_mm = float(about["anchor_sigma_mm"]), float(about["anchor_tail_mm"])
    mode = recording.tables.anchor(group, int(about["anchor"]))
    # recordings of 0.2 have none
    learned_ns = int(about["anchor_learned_ns"]) if "anchor_learned_ns" in about.dtype.names else 0
    anchor = Anchor(mode, mask, sigma_mm, tail_mm, learned_ns)
    at_ns, count = int(about["time_ns"]), int(about["iterations"])
    place = values["x_mm"], values["y_mm"]
    _, values["sigma_x_mm"], values["sigma_y_mm"] = recording.rig.geometry.sigmas(*place)
    return Surface(**values, valid=valid, contact=contact, anchor=anchor, time_ns=at_ns, iterations=count)


def fine_surface(
    recording: Recording, index: StepIndex, lattice: PixelLattice, step: int
) -> FineSurface | None:
    """Surface of every pixel; None where a step has none, or where it is damaged."""
    names = (*FINE_PIXELS, "x_mm", "y_mm", "share")
    found = index.arrays("fine", step, *names, "table")
    nodes = node_surface(recording, index, "fine_nodes", step)
    if found is None or nodes is None:
        return None
    *maps, about = found
    values = dict(zip(names, maps, strict=True))
    for name in ("x_mm", "y_mm"):
        values[name] = lattice.to_pixels_exact(values[name].astype(np.float64)).astype(np.float32)
    values["share"] = np.clip(lattice.to_pixels(values["share"].astype(np.float64)), 0.0, 1.0)
    return FineSurface(
        **values,
        valid=np.isfinite(values["depth_mm"]),
        first_px=(int(about["first_row"]), int(about["first_col"])),
        time_ns=nodes.time_ns,
        frames=int(about["frames"]),
        coarse=nodes,
        footprint_divided=bool(about["footprint_divided"]),
        spacing_px=recording.grid.spacing_px,
    )
