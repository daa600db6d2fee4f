"""A cloth on the mirror: it touches at the points of its weave, and closer where something presses it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from math import pi, sqrt

import numpy as np

from zeromethod.arrays import Float
from zeromethod.rig.model import ClothSpec, Rig

TILE = 64
"""Points along and across after which the irregularity of the weave begins again."""
BORDER = 0.25
"""Width of a point's soft border over the weave: about a pixel of the camera, on which it is not averaged."""
_STREAM = 12
_MOST = 2.5
"""Standard deviations at which irregularity is cut: no point reaches out of its own square of the weave."""


@dataclass(frozen=True, eq=False)
class Cloth:
    """The cloth of a rig; compared as an object, of which there is one per cloth.

    weave: (TILE, TILE, 3) of each point: off its place along and across, over the weave; how much larger its
    radius is at rest, relative.
    """

    spec: ClothSpec
    weave: Float = field(repr=False)

    @property
    def radii(self) -> tuple[float, float]:
        """Radius of a point over the weave, at rest and pressed."""
        softness = BORDER**2 / 12  # what a soft border adds to the radius squared of an area
        rest, pressed = (
            sqrt(max(share / pi - softness, 0)) for share in (self.spec.touching, self.spec.pressed)
        )
        return rest, pressed

    @property
    def turn(self) -> tuple[float, float]:
        """(cos, sin) of the weave's angle."""
        angle = np.radians(self.spec.angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))

    def share(self, x: Float, y: Float, gap_mm: Float) -> Float:
        """Share of light that threads take at world points, mm; `gap_mm`: to what presses, or inf."""
        c, s = self.turn
        along, across = (c * x + s * y) / self.spec.weave_mm, (c * y - s * x) / self.spec.weave_mm
        col, row = np.floor(along + 0.5), np.floor(across + 0.5)
        known = np.isfinite(along + across)
        at = tuple(np.where(known, n, 0).astype(np.intp) % TILE for n in (row, col))
        own = self.weave[at]
        squeezed = np.exp(-np.asarray(gap_mm) / self.spec.give_mm)
        rest, pressed = self.radii
        radius = rest * (1 + own[..., 2]) * (1 - squeezed) + pressed * squeezed
        off = 1 - squeezed
        away = np.hypot(along - col - off * own[..., 0], across - row - off * own[..., 1])
        return np.where(known, np.clip((radius - away) / BORDER + 0.5, 0.0, 1.0), 0.0)


def cloth_of(rig: Rig) -> Cloth | None:
    """The cloth of a rig's simulated bench, the same object for the same cloth."""
    return None if rig.cloth is None else _woven(rig.cloth, rig.simulation.seed)


@lru_cache(8)
def _woven(spec: ClothSpec, seed: int) -> Cloth:
    draw = np.random.default_rng((seed, _STREAM)).standard_normal((TILE, TILE, 3))
    # as textures have it, so that every renderer weaves the same
    return Cloth(spec, (spec.irregular * np.clip(draw, -_MOST, _MOST)).astype(np.float32).astype(np.float64))
