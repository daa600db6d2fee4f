"""The press of the paper's section 5 read as a surface: by all pixels of two images, by the zero method."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Image
from zeromethod.devices.protocols import TrueMirror
from zeromethod.loop.state import NULLED
from zeromethod.optics import Optics
from zeromethod.paper.press import PITCH_MM
from zeromethod.passive import correlate
from zeromethod.passive.passive_warp import measured_warp
from zeromethod.rig.model import Rig
from zeromethod.session.whole_run import run
from zeromethod.surface import Surface, SurfaceReader, peak
from zeromethod.surface.comparison import compare
from zeromethod.warp.grid import NodeGrid

NOTHING = float("nan")
WINDOW_PITCHES = 0.4
"""Gaussian window (standard deviation) of the image correlation: it must cover lines of both directions,
because the inside of a lattice square has no texture.

Chosen with the truth known from 6, 8, 10 and 12 px (0.24 to 0.48 pitches), which read the peak of
`reproduce` 1.2 to 0.4 % low: 10 px. This favours the passive reading; the window that the correlation
chooses by itself, without any truth, is reported as well.
"""


@dataclass(frozen=True, slots=True)
class SurfaceReading:
    """A press read as a surface, compared with the truth.

    peak_mm: deepest point read, its error against the deepest true point; line_rms_um: error along the
    nodes nearest y = 0; view_rms_um: error over all nodes read; points: their number;
    frames: images that the figures are medians of. NaN and a `reason` where nothing was read.
    """

    peak_mm: float = NOTHING
    peak_error_percent: float = NOTHING
    line_rms_um: float = NOTHING
    view_rms_um: float = NOTHING
    points: int = 0
    frames: int = 0
    reason: str = ""


def against_truth(surface: Surface, truth: TrueMirror, optics: Optics, grid: NodeGrid) -> SurfaceReading:
    """Compare one surface with the truth."""
    if not surface.valid.any():
        return SurfaceReading(reason="no point was read")
    errors = compare(surface, truth, optics, grid)
    row = int(np.argmin(np.abs(grid.v_px - optics.rig.camera.centre_px[1])))
    read = surface.valid[row]
    x, y, depth = surface.x_mm[row][read], surface.y_mm[row][read], surface.depth_mm[row][read]
    line_error = depth - truth.depth(x, y)
    return SurfaceReading(
        peak_mm=peak(surface).depth_mm,
        peak_error_percent=errors.depth_peak_error_percent,
        line_rms_um=1e3 * float(np.sqrt(np.mean(line_error**2))) if depth.size else NOTHING,
        view_rms_um=errors.depth_rms_error_um,
        points=int(np.count_nonzero(surface.valid)),
        frames=1,
    )


def read_whole_image(
    rig: Rig, before: Image, after: Image, truth: TrueMirror, *, own_window: bool = False
) -> SurfaceReading:
    """Read the press off two still images by all their pixels: image correlation, rest map, exact rays.

    own_window: the correlation chooses its windows, as `zeromethod measure` does; else `WINDOW_PITCHES`.
    """
    pitch_px = PITCH_MM / (rig.camera.pixel_mm or NOTHING)
    displacement = correlate(before, after, window_px=None if own_window else WINDOW_PITCHES * pitch_px)
    if not displacement.valid.any():
        return SurfaceReading(reason="the two images do not match anywhere")
    optics, grid = Optics(rig), NodeGrid.of_rig(rig)
    warp = measured_warp(displacement, optics, grid)
    if not warp.valid.any():
        return SurfaceReading(reason="no node of the warp was measured")
    return against_truth(SurfaceReader(rig, optics, grid).read(warp), truth, optics, grid)


def read_zero(rig: Rig, truth: TrueMirror, seconds: float) -> SurfaceReading:
    """Close the loop on the simulated bench for `seconds` under `rig.scenario`; read the press while nulled.

    Peak and view: medians over the nulled frames of the hold; line: one of them.
    """
    result = run(rig, seconds=seconds)
    held = [one for one in result.records if one.phase == "hold" and one.state in NULLED and one.truth]
    nulled = result.nulled
    if not held or nulled is None or nulled.surface is None:
        last = result.records[-1].reason if result.records else "no frame"
        return SurfaceReading(reason=f"never nulled while held: {last}")
    grid = NodeGrid.of_rig(rig)
    one = against_truth(nulled.surface, truth, Optics(rig), grid)
    truths = [record.truth for record in held if record.truth is not None]
    return replace(
        one,
        peak_mm=float(np.median([record.depth_peak_mm for record in held])),
        peak_error_percent=float(np.median([each.depth_peak_error_percent for each in truths])),
        view_rms_um=float(np.median([each.depth_rms_error_um for each in truths])),
        frames=len(held),
    )
