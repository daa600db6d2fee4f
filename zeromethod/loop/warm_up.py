"""Made-up frames sent round a circle, so that no real frame waits for code to be compiled or loaded."""

from __future__ import annotations

import numpy as np

from zeromethod.devices.protocols import Frame
from zeromethod.loop.circle import Circle
from zeromethod.pattern import Target
from zeromethod.rig.model import CameraSpec

_FRAMES = 8
"""Enough for a motion to be accepted and predicted."""

_STEP_PX = 2
"""Camera px per frame that the made-up picture moves by: pictures mix, nodes move, nothing saturates."""


def warm_up(circle: Circle, target: Target, camera: CameraSpec) -> None:
    """Send made-up frames round a circle of its own, which is of no use afterwards.

    They show the target drifting along u while every exposure spans two presentations, so that all steps of
    the circle run, those of a moving mirror too.
    """
    u, v = np.meshgrid(np.arange(camera.columns), np.arange(camera.rows))
    grey = np.rint(0.8 * (2**camera.bits - 1) * target.light(u, v))
    image = grey.astype(np.uint8 if camera.bits == 8 else np.uint16)
    frame_ns, exposure_ns = round(1e9 / camera.rate_hz), round(1e9 * camera.exposure_s)
    for number in range(_FRAMES):
        time_ns = number * frame_ns
        circle.presented(time_ns - exposure_ns // 4, circle.controller.commanded, source_ns=circle.source_ns)
        drifting = np.ascontiguousarray(np.roll(image, _STEP_PX * number, axis=1))
        circle.take(Frame(drifting, time_ns, exposure_ns, number))
