"""Delay from a frame to the frame that shows the answer to it, step by step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from zeromethod.design.sampled_view import SampledView
from zeromethod.rig.model import CameraSpec, Rig

ASSUMED_COMPUTING_S = 0.008
"""Reading a frame, drawing and posting the next picture, where no other time is given."""


@dataclass(frozen=True)
class Delay:
    """One step of the way round. mean_s; worst_s: the longest that an unlucky moment makes it."""

    name: str
    mean_s: float
    worst_s: float


def delay_budget(view: SampledView, computing_s: float) -> list[Delay]:
    """Steps from the middle of one exposure to that of the exposure that shows the answer, in order.

    Display and camera run on their own clocks: whoever waits for either waits half a period on average, a
    whole one at worst. A pixel's light rises exponentially; its delay is the time constant.
    """
    rig, display = view.rig, view.rig.display
    refresh_s, frame_s = 1 / display.refresh_hz, 1 / rig.camera.rate_hz
    scanout_s = refresh_s if display.scanout_s is None else display.scanout_s
    share = np.clip(view.trace.q[view.on_lcd][:, 1], 0, display.rows - 1) / (display.rows - 1)
    share = 1 - share if display.scan == "up" else share
    rise_s = display.rise_s / math.log(9)
    camera_s = camera_latency_s(rig)
    return [
        Delay("half the exposure", rig.camera.exposure_s / 2, rig.camera.exposure_s / 2),
        Delay("readout and transfer", camera_s, camera_s),
        Delay("computing and drawing", computing_s, computing_s),
        Delay("waiting for the refresh", refresh_s / 2, refresh_s),
        Delay("latency of the display", display.latency_s, display.latency_s),
        Delay(
            "scan-out to the rows in view", scanout_s * float(share.mean()), scanout_s * float(share.max())
        ),
        Delay("rise of the pixels", rise_s, rise_s),
        Delay("waiting for the exposure", frame_s / 2, frame_s),
    ]


def camera_latency_s(rig: Rig) -> float:
    """From the end of an exposure to the frame in hand, s: as the rig has it, else as it is simulated."""
    camera: CameraSpec = rig.camera
    if camera.driver == "simulated" and "latency_s" not in camera.model_fields_set:
        return rig.simulation.camera_latency_s
    return camera.latency_s


def total_s(budget: list[Delay]) -> Delay:
    """All steps together."""
    return Delay("all", sum(step.mean_s for step in budget), sum(step.worst_s for step in budget))
