"""How well a bench's geometry is known, and what that leaves open of depth and place on the mirror."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from zeromethod.arrays import Float
from zeromethod.rig.refusal import refused
from zeromethod.rig.tables import Positive, Table, Text, Vector2

Coefficients = tuple[float, float, float, float, float, float]


class GeometrySpec(Table):
    """How well the geometry is known, written by `zeromethod calibrate`.

    known: "nominal" by drawings and calipers, "calibrated", or "exact" (a bench that simulates this very rig
    file). date: of the calibration.

    A mode is one way in which all readings of the bench may be off together: a standard normal number, the
    same for every node and frame and independent of the other modes', times `depth` (error of depth, relative
    to depth) and `x_mm`, `y_mm` (errors of the mirror point). Each row holds one mode's coefficients of 1, X,
    Y, X^2, XY, Y^2, where X = (x - centre_mm[0]) / reach_mm[0] on the mirror, Y likewise.
    """

    known: Literal["nominal", "calibrated", "exact"] = "nominal"
    date: Text | None = None
    centre_mm: Vector2 = (0.0, 0.0)
    reach_mm: tuple[Positive, Positive] = (1.0, 1.0)
    depth: tuple[Coefficients, ...] = ()
    x_mm: tuple[Coefficients, ...] = ()
    y_mm: tuple[Coefficients, ...] = ()

    def __repr__(self) -> str:
        return f"GeometrySpec({self.known!r}, {len(self.depth)} modes)"

    @property
    def relative(self) -> bool:
        """Whether depth is relative only: what is left open is stated, but by no calibration."""
        return self.known == "nominal" and bool(self.depth)

    @model_validator(mode="after")
    def _complete(self) -> GeometrySpec:
        for key in ("x_mm", "y_mm"):
            if len(rows := getattr(self, key)) != len(self.depth):
                raise refused(key, len(rows), f"as many rows as geometry.depth has, {len(self.depth)}")
        if self.known == "calibrated" and not self.depth:
            raise refused("depth", [], "at least one mode where known = 'calibrated'")
        if self.known == "exact" and self.depth:
            raise refused("depth", len(self.depth), "no modes where known = 'exact'")
        return self

    def fields(self, x_mm: Float, y_mm: Float) -> Float:
        """Modes (modes, 3, ...) at mirror points: relative error of depth, errors of x and y in mm."""
        table = np.array([self.depth, self.x_mm, self.y_mm], dtype=np.float64).reshape(3, -1, 6)
        terms = powers(x_mm, y_mm, self.centre_mm, self.reach_mm)
        return np.asarray(np.einsum("fmk,...k->mf...", table, terms))

    def sigmas(self, x_mm: Float, y_mm: Float) -> Float:
        """Standard deviations (3, ...) at mirror points: of depth, relative; of x and y, mm."""
        return np.asarray(np.sqrt((self.fields(x_mm, y_mm) ** 2).sum(axis=0)))


def powers(x_mm: Float, y_mm: Float, centre_mm: Vector2, reach_mm: Vector2) -> Float:
    """Terms (..., 6) that a mode's coefficients belong to."""
    x, y = ((np.asarray(a) - c) / r for a, c, r in zip((x_mm, y_mm), centre_mm, reach_mm, strict=True))
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
