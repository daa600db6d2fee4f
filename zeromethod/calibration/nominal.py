"""What caliper values leave open of depth and place on a bench whose geometry was never calibrated."""

from __future__ import annotations

import numpy as np

from zeromethod.calibration.depth_modes import depth_error
from zeromethod.calibration.fitting import Fit
from zeromethod.calibration.parameters import Priors
from zeromethod.calibration.presses import RestReading
from zeromethod.calibration.rays import tooth_phase
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest_map import RestMap

_NODES = 32
"""Along the camera's shorter side, about: the derivatives bend over centimetres."""
_TOOTH_NODES = 20
"""Along a tooth of a saw, whose seams take some of them."""

WHOLE = 1.0
"""Relative error of depth without a measured rest: a wrong geometry's rest reads as a dent of its own."""


def nominal_geometry(rig: Rig) -> GeometrySpec:
    """What the priors make of depth and place; without a measured rest (`camera.rest_map`) depth is unknown.

    Raises MeasurementError where too little of the mirror is seen.
    """
    camera = rig.camera
    spacing = min(camera.columns, camera.rows) // _NODES
    if rig.prism.teeth is not None:
        _, pitch_px = tooth_phase(rig, *(np.array([n / 2]) for n in (camera.columns, camera.rows)))
        spacing = min(spacing, int(pitch_px[0] / _TOOTH_NODES))
    spacing = max(spacing, rig.target.period_px // 2)
    period = min(2 * spacing, 64)
    coarse = rig.model_copy(
        update={
            "target": rig.target.model_copy(update={"period_px": period}),
            "geometry": GeometrySpec(),
        }
    )
    grid, priors = NodeGrid.of_rig(coarse), Priors.of(coarse)
    none = np.zeros(len(priors.names))
    believed = Fit(priors, none, np.eye(len(none)), (), 1.0, 0, True)
    reading = None
    if camera.rest_map is not None:
        reading = RestReading.of(grid, RestMap.load(camera.rest_map).warp(grid))
    modes = depth_error(believed, grid, reading).modes
    if reading is None:
        for key, value in (("depth", WHOLE), ("x_mm", 0.0), ("y_mm", 0.0)):
            modes[key].append([value, *[0.0] * 5])
    return GeometrySpec(known="nominal", **modes)


def stated(rig: Rig) -> Rig:
    """The rig whose readings state what is open of depth, where no calibration has said so.

    Raises MeasurementError where too little of the mirror is seen.
    """
    if rig.geometry.known != "nominal" or rig.geometry.depth:
        return rig
    return rig.model_copy(update={"geometry": nominal_geometry(rig)})
