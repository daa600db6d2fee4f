"""What a calibration is to measure, and everything that the bench gave."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zeromethod.calibration import Direct, Intrinsics, MirrorEdge
from zeromethod.calibration.fingerprint import Fingerprint
from zeromethod.calibration.panel_timing import StepTiming
from zeromethod.calibration.shortfall import Shortfall
from zeromethod.commissioning.calibration.presses import DEFAULT_FRAMES, DEFAULT_PATIENCE_S, PressWarps
from zeromethod.commissioning.calibration.projector import Projection
from zeromethod.commissioning.calibration.rest import RestFrames
from zeromethod.commissioning.calibration.settling import Settling
from zeromethod.commissioning.delay import DelayResult
from zeromethod.commissioning.light_result import LightResult
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig

REST_FRAMES = 4
"""Camera frames averaged for every picture of the rest map."""

DELAY_S = 3.0

Known = Direct | MirrorEdge | Intrinsics
"""What a person measures or sees in addition."""


@dataclass(frozen=True)
class Plan:
    """What to measure.

    press_depths_mm: of the presses that will come, in order; press_sigma_mm: how well each is known. ball_mm:
    radius of a ball that is pressed in after them, and its sigma. known: what was measured by hand, seen of
    the mirror's edges, or found of the camera by itself. edges: whether those that are not known are looked
    for in the pictures. light, delay: whether these steps are taken.
    rest_frames, press_frames: camera frames averaged for each picture and press. delay_s: how long the delay
    is measured. patience_s: longest wait for a press.
    """

    press_depths_mm: tuple[float, ...] = ()
    press_sigma_mm: float = 1e-3
    known: tuple[Known, ...] = ()
    light: bool = True
    delay: bool = True
    rest_frames: int = REST_FRAMES
    press_frames: int = DEFAULT_FRAMES
    delay_s: float = DELAY_S
    patience_s: float = DEFAULT_PATIENCE_S
    ball_mm: tuple[float, float] | None = None
    edges: bool = True

    def __post_init__(self) -> None:
        """Refuse numbers that cannot be, with InputError."""
        for depth in self.press_depths_mm:
            if not (np.isfinite(depth) and depth > 0):
                raise InputError(f"--press-depths: {depth}: numbers of mm above 0")
        if not (np.isfinite(self.press_sigma_mm) and self.press_sigma_mm > 0):
            raise InputError(f"--depth-sigma: {self.press_sigma_mm}: a number of mm above 0")
        if self.ball_mm is not None and not all(np.isfinite(one) and one > 0 for one in self.ball_mm):
            radius, sigma = self.ball_mm
            raise InputError(f"--press-ball: {radius:g}:{sigma:g}: radius and sigma in mm, above 0")

    @property
    def presses(self) -> int:
        """How many presses are asked for, the ball among them."""
        return len(self.press_depths_mm) + (self.ball_mm is not None)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Everything that a bench gave, enough to evaluate it again without the bench.

    rig: as the rig file says, with the devices used. values: of the rig file that were measured directly
    (response, noise, timing), by dotted key. light, delay, panel, presses, projection: None where they were
    left out or failed; shortfalls: what was not measured, or not well enough, and what holds in its place.
    seconds: that each step took, of the machine's time. failure: why not all presses were taken, for a
    person; the plan then holds those that were. interrupted: by Ctrl-C.
    """

    rig: Rig
    plan: Plan
    fingerprint: Fingerprint
    settling: Settling
    rest: RestFrames
    light: LightResult | None = None
    delay: DelayResult | None = None
    panel: StepTiming | None = None
    presses: PressWarps | None = None
    projection: Projection | None = None
    shortfalls: tuple[Shortfall, ...] = ()
    values: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    failure: str | None = None
    interrupted: bool = False
