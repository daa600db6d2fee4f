"""What caliper values leave open of depth and place on a bench whose geometry was never calibrated."""

from __future__ import annotations

import numpy as np

from zeromethod.calibration.depth_modes import depth_error
from zeromethod.calibration.fitting import Fit
from zeromethod.calibration.parameters import Priors
from zeromethod.calibration.presses import RestReading
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest_map import RestMap

_NODES = 32
"""Along the camera's shorter side, about: the derivatives bend over centimetres."""

WHOLE = 1.0
"""Relative error of depth without a measured rest: a wrong geometry's rest reads as a dent of its own."""


def nominal_geometry(rig: Rig) -> GeometrySpec:
    """What the priors make of depth and place; without a measured rest (`camera.rest_map`) depth is unknown.

    Raises MeasurementError where too little of the mirror is seen.
    """
    camera = rig.camera
    spacing = max(min(camera.columns, camera.rows) // _NODES, rig.target.period_px // 2)
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
