"""The interactive surface as a rig file describes it: the cloth screen on the mirror, the projector."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from zeromethod.rig.refusal import refused
from zeromethod.rig.tables import Angle, Lag, Luminance, NotNegative, Positive, Rate, Share, Table, Vector2

Pixels = Annotated[int, Field(ge=16, le=8192)]
Corners = tuple[Vector2, Vector2, Vector2, Vector2]


class ClothSpec(Table):
    """A cloth on the mirror of the simulated bench, which it touches at the points of its weave.

    `weave_mm`: from point to point, along `angle_deg` (from x towards y) and across. `touching`, `pressed`:
    share of the area in contact at rest, and under an object that presses; in between it falls with the gap,
    to 1 / e at `give_mm`. `albedo`: share of light that the threads scatter back. `irregular`: standard
    deviation of a point's place over the weave, and of its radius at rest over that.
    """

    weave_mm: Positive = 0.15
    angle_deg: Angle = 17.0
    touching: Annotated[float, Field(gt=0, le=0.3)] = 0.05
    pressed: Annotated[float, Field(gt=0, le=0.75)] = 0.6
    give_mm: Positive = 0.01
    albedo: Share = 0.8
    irregular: Annotated[float, Field(ge=0, le=0.1)] = 0.05

    @model_validator(mode="after")
    def _touches_more_pressed(self) -> ClothSpec:
        if self.pressed < self.touching:
            raise refused("pressed", self.pressed, f"a number from touching, {self.touching:g}, to 0.75")
        return self


class ProjectorSpec(Table):
    """A projector whose picture falls on the cloth.

    `driver` "window": the monitor of index `monitor`; "simulated": that of the bench, which may
    have a monitor, too.
    `corners_mm`: where on the mirror (x, y) the middles of its corner pixels fall: first row first and last
    column, last row first and last column; in between as a plane is projected. `sigma_mm`: standard deviation
    of a place by that map. `refresh_hz`, `latency_s`: its own clock, and from a picture's swap to its light.
    `brightness`: luminance of white on the cloth over that of the white LCD, light = brightness x
    (code / 255)^`gamma`. `full_force_n`: a finger's force that counts as pressure 1. `picture`: "pointers"
    draws what fingers do on black, "white" the same on white, "black" nothing.
    """

    driver: Literal["simulated", "window"] = "simulated"
    monitor: Annotated[int, Field(ge=0, le=63)] | None = None
    columns: Pixels = 640
    rows: Pixels = 400
    refresh_hz: Rate = 60.0
    latency_s: Lag = 0.0
    gamma: Annotated[float, Field(ge=0.2, le=5)] = 2.2
    corners_mm: Corners
    sigma_mm: NotNegative = 1.0
    brightness: Luminance = 1.0
    full_force_n: Positive = 1.0
    picture: Literal["pointers", "white", "black"] = "pointers"

    @model_validator(mode="after")
    def _can_be(self) -> ProjectorSpec:
        if self.driver == "window" and self.monitor is None:
            raise refused(
                "monitor", None, "an index, as `zeromethod devices` lists them, for driver 'window'"
            )
        first, second, third, fourth = (np.array(one) for one in self.corners_mm)
        around = [first, second, fourth, third]
        sides = [b - a for a, b in zip(around, [*around[1:], around[0]], strict=True)]
        turns = [a[0] * b[1] - a[1] * b[0] for a, b in zip(sides, [*sides[1:], sides[0]], strict=True)]
        if not (min(turns) > 0 or max(turns) < 0):
            listed = [list(one) for one in self.corners_mm]
            order = "first row first and last column, last row first and last column"
            raise refused(
                "corners_mm", listed, f"in this order the sides cross or bend inwards; allowed: {order}"
            )
        return self
