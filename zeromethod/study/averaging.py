"""The procedure "averaging": what the mean of so many frames of a mirror at rest leaves of the noise."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import MeasurementError
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED
from zeromethod.optics import Optics
from zeromethod.study.closed_loop import opened
from zeromethod.study.task import Figures, Procedure, Task
from zeromethod.surface import SurfaceReader
from zeromethod.warp.mean import RunningMean

SETTLING_FRAMES = 8
"""Nulled frames that pass before any is averaged."""

_PATIENCE_FRAMES = 60


def average(task: Task) -> Figures:
    """Depth of the mean of `averaged_frames` measured warps, while the loop holds the null.

    Raises MeasurementError where the loop does not null so many frames.
    """
    wanted = int(task.settings["averaged_frames"])
    mean, filtered, settled = RunningMean(), None, 0
    with opened(task) as devices:
        optics = Optics(task.rig)
        loop = Loop(task.rig, devices.camera, devices.display, devices.clock, optics=optics)
        reader = SurfaceReader(task.rig, optics, loop.grid)
        for step in loop.run(frames=wanted + SETTLING_FRAMES + _PATIENCE_FRAMES):
            if step.measured is None or step.state not in NULLED:
                continue
            settled += 1
            if settled <= SETTLING_FRAMES:
                continue
            mean.add(step.measured)
            filtered = step.filtered
            if mean.frames == wanted:
                break
    if mean.frames < wanted or filtered is None:
        raise MeasurementError(f"only {mean.frames} of {wanted} frames were nulled")
    surface = reader.read(mean.warp)
    by_filter = reader.read(filtered)
    if not surface.valid.any():
        raise MeasurementError("nothing of the mirror could be read")
    return {
        "depth_rms_nm": 1e6 * _rms(surface.depth_mm[surface.valid]),
        "stated_depth_rms_nm": 1e6 * _rms(surface.sigma_depth_mm[surface.valid]),
        "slope_rms_urad": 1e6 * _rms(surface.slope[surface.valid]),
        "filtered_depth_rms_nm": 1e6 * _rms(by_filter.depth_mm[by_filter.valid]),
        "averaged_s": wanted / task.rig.camera.rate_hz,
    }


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


AVERAGING = Procedure(
    average,
    {
        "depth_rms_nm": "depth read of a mirror at rest, rms over nodes, nm",
        "stated_depth_rms_nm": "standard deviation stated for it, rms over nodes, nm",
        "slope_rms_urad": "slope read of a mirror at rest, rms over nodes, microradian",
        "filtered_depth_rms_nm": "depth rms of the controller's own filter at the end, nm",
        "averaged_s": "time that so many frames take, s",
    },
    {"averaged_frames": 1},
)
