"""The newest of a run as viewers are shown it: picture, maps, outlines, values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.loop.step import Step
from zeromethod.operating.readings import Readings, number
from zeromethod.page.fine_maps import FineMaps
from zeromethod.page.message import Content, unix_ms
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Surface
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

NOT_READ, MEASURED, CUT_OFF, CARRIED_IN, DARK = range(5)
"""Kinds of node: without depth; measured; tied to the others over a gap only; inside a contact, not measured;
without light."""


@dataclass(frozen=True)
class RunContent:
    """Composes contents of the newest step, and of the newest one that was read. stages: see `Content`.

    fine: of the newest fine surface. projected: the projector's picture.
    """

    readings: Readings
    newest: Step | None
    read: Step | None
    stages: dict[str, float]
    bits: int
    lattice: dict[str, Any]
    fine: FineMaps | None = None
    projected: Bytes | None = None

    def compose(self, parts: frozenset[str]) -> Content:
        """Content with these parts; without an image or a surface, its values alone."""
        arrays: dict[str, dict[str, Any]] = {}
        meta: dict[str, dict[str, Any]] = {}
        step, read = self.newest, self.read
        stages = self.stages | {"composed": unix_ms()} if self.stages else {}
        if step is not None:
            if "camera" in parts and step.image is not None:
                arrays["camera"] = {"image": step.image}
                meta["camera"] = {"step": step.number, "time_s": step.time_s, "bits": self.bits}
            if "residual" in parts and step.residual is not None:
                arrays["residual"], meta["residual"] = residual_maps(
                    step.residual, step.measured, step.number
                )
                meta["residual"]["lattice"] = self.lattice
            if "lcd" in parts:
                arrays["lcd"] = {"q": np.ascontiguousarray(step.commanded.q, np.float32)}
                meta["lcd"] = {"step": step.number}
            if "projected" in parts and self.projected is not None:
                arrays["projected"], meta["projected"] = {"image": self.projected}, {"step": step.number}
        if read is not None and read.surface is not None and "surface" in parts:
            arrays["surface"], meta["surface"] = surface_maps(read.surface)
            meta["surface"] |= {
                "lattice": self.lattice,
                "time_s": self.readings.values["peak_time_s"],
                "outlines": [
                    {"id": one.id, "px": np.round(one.outline_px, 1).tolist()} for one in read.contacts
                ],
                "peak_node": _peak_node(read.surface, read.peak),
            }
        if self.fine is not None and "fine" in parts:
            arrays["fine"], meta["fine"] = self.fine.part
        return Content(self.readings.values, self.readings.take_rows(), stages, arrays, meta)


def lattice_of(grid: NodeGrid) -> dict[str, Any]:
    """Where the nodes are in the camera's picture, px: the first one, their spacing, the picture's size."""
    rows, columns = grid.image_shape
    return {
        "first": [float(grid.u_px[0]), float(grid.v_px[0])],
        "spacing": grid.spacing_px,
        "image": [columns, rows],
    }


def residual_maps(
    residual: Residual, measured: Warp | None, step: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Length of the residual per node, camera px; NaN where nothing is read, and at a saw's seams."""
    length = np.hypot(residual.d[..., 0], residual.d[..., 1]).astype(np.float32)
    seam = np.zeros(length.shape, np.bool_) if measured is None else measured.flags & Flag.SEAM != 0
    said = {"step": step} | ({"seams": True} if seam.any() else {})
    return {"length": np.where(residual.valid & ~seam, length, np.nan)}, said


def surface_maps(surface: Surface) -> tuple[dict[str, Any], dict[str, Any]]:
    """Depth and its sigma, mm, slope, rad, and place, mm, per node, and what kind of node it is."""
    depth, kind = surface.depth_mm.copy(), np.where(surface.valid, MEASURED, NOT_READ).astype(np.uint8)
    sigma = surface.sigma_depth_mm.copy()
    kind[surface.contact & ~surface.valid & surface.on_mirror] = DARK
    for part, name in ((surface.cut_off, CUT_OFF), (surface.inside, CARRIED_IN)):
        if part is not None:
            own = part.valid & ~surface.valid
            depth[own], sigma[own], kind[own] = part.depth_mm[own], part.sigma_depth_mm[own], name
    unknown = (kind == DARK) | (kind == NOT_READ)
    depth[unknown] = sigma[unknown] = np.nan
    maps = {"depth": depth, "sigma": sigma, "slope": surface.slope, "x": surface.x_mm, "y": surface.y_mm}
    arrays = {key: np.ascontiguousarray(values, np.float32) for key, values in maps.items()}
    return arrays | {"kind": kind}, {}


def _peak_node(surface: Surface, peak: Any) -> list[float] | None:
    """(column, row) of the node nearest to the peak."""
    if peak is None or number(peak.x_mm) is None:
        return None
    away = (surface.x_mm - peak.x_mm) ** 2 + (surface.y_mm - peak.y_mm) ** 2
    row, column = np.unravel_index(int(np.nanargmin(away)), away.shape)
    return [int(column), int(row)]
