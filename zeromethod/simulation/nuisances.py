"""What a bench suffers besides presses: mains light, a drifting backlight, dirt, warmth.

Light is changed between the renderer, which it is all the same to, and the camera's chip; warmth changes the
rig that the renderer draws.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from zeromethod.arrays import Float, Single
from zeromethod.rig.model import Rig

INDEX_PER_K = -4.0e-4
"""Silicone rubber's index. Source: Schneider et al. 2009, J. Micromech. Microeng. 19 085034 (Sylgard 184)."""
LENGTH_PER_K = 3.0e-4
"""Its length, as it expands freely. Source: the same, and data sheets of silicones."""
KELVIN_STEP = 0.02
"""Warmth goes on in such steps: the rays are laid out again for each. One moves the image by some 0.01 px
of the camera."""

_STREAM = 11
_SPECK_PX, _SPECK_LIGHT = (2.0, 7.0), 0.2
_SCRATCH_PX, _SCRATCH_LIGHT = (0.5, 1.2), 0.5
_BUBBLE_PX = (3.0, 9.0)
_SOFT_PX = 0.7
"""Standard deviation of dirt's borders in the image."""
_VIEW_PX = 1280
"""Columns of the camera that sizes of dirt are for; in one with fewer pixels it is as much smaller."""


class Dirt(NamedTuple):
    """(rows, cols): share of a pixel's light that passes, and what it gets of the view's mean instead."""

    passes: Single
    astray: Single


def swing(hz: float, from_ns: int, to_ns: int) -> float:
    """Mean over an exposure of 1 + cos(2 pi hz t): a light that goes to nothing and back, 1 on average."""
    turn = 2 * math.pi * hz
    middle_s, half_s = 0.5e-9 * (from_ns + to_ns), 0.5e-9 * (to_ns - from_ns)
    kept = math.sin(turn * half_s) / (turn * half_s) if half_s > 0 else 1.0
    return 1 + kept * math.cos(turn * middle_s)


class Nuisances:
    """The nuisances of a rig's simulated bench."""

    def __init__(self, rig: Rig) -> None:
        self._spec = rig.simulation.nuisances
        self._rig = rig

    def backlight(self, from_ns: int, to_ns: int) -> float:
        """Light of the LCD in an exposure over that at time 0."""
        minutes = 0.5e-9 * (from_ns + to_ns) / 60
        return max(1 + self._spec.backlight_per_minute * minutes, 0.0)

    def mains(self, from_ns: int, to_ns: int) -> float:
        """Light of lamps on the mains in an exposure: that of full ones on average, and none in between."""
        return self._spec.mains * swing(self._spec.mains_hz, from_ns, to_ns)

    def kelvin(self, time_ns: int) -> float:
        """How much warmer the rubber is than the rig file has it, in whole steps."""
        warmed = self._spec.kelvin_per_minute * 1e-9 * time_ns / 60
        return KELVIN_STEP * math.floor(warmed / KELVIN_STEP + 0.5)

    def on(self, light: Single, from_ns: int, to_ns: int) -> Single:
        """The light (rows, cols) of an exposure with dirt and mains light; the same array with neither.

        Lamps shine past the dirt: what they add is scattered between it and the camera.
        """
        if self.dirt is not None:
            light = light * self.dirt.passes + np.float32(light.mean()) * self.dirt.astray
        if self._spec.mains:
            light = light + np.float32(self.mains(from_ns, to_ns))
        return light

    @cached_property
    def dirt(self) -> Dirt | None:
        """Dust and scratches on the camera face and bubbles in the rubber; None for none of them."""
        spec, camera = self._spec, self._rig.camera
        if not (spec.dust or spec.scratches or spec.bubbles):
            return None
        passes, astray = np.ones((2, camera.rows, camera.columns), np.float32)
        astray[:] = 0
        draw = np.random.default_rng((self._rig.simulation.seed, _STREAM))
        scale = camera.columns / _VIEW_PX
        for _ in range(spec.dust):
            u, v, radius = draw.uniform((0, 0, _SPECK_PX[0]), (camera.columns, camera.rows, _SPECK_PX[1]))
            _cover(passes, _disc(passes, u, v, scale * radius), _SPECK_LIGHT)
        for _ in range(spec.scratches):
            ends = draw.uniform(0, 1, (2, 2)) * (camera.columns, camera.rows)
            _cover(passes, _line(passes, ends, scale * draw.uniform(*_SCRATCH_PX)), _SCRATCH_LIGHT)
        for _ in range(spec.bubbles):
            u, v, radius = draw.uniform((0, 0, _BUBBLE_PX[0]), (camera.columns, camera.rows, _BUBBLE_PX[1]))
            # rays that meet air beyond the critical angle go astray for good, others pass far off their way
            _cover(passes, _disc(passes, u, v, scale * radius), 0.0)
            inner = _disc(passes, u, v, scale * radius / self._rig.prism.index)
            np.maximum(astray, inner, out=astray)
        return Dirt(passes, astray)


def warmed_rig(rig: Rig, kelvin: float) -> Rig:
    """The bench with rubber that much warmer: its index lower, its faces longer, about the edge P0."""
    prism, longer = rig.prism, 1 + LENGTH_PER_K * kelvin
    lengths = {
        name: getattr(prism, name) * longer
        for name in ("pattern_length_mm", "mirror_length_mm", "width_mm")
        if getattr(prism, name) is not None
    }
    index = prism.index + INDEX_PER_K * kelvin
    return rig.model_copy(update={"prism": prism.model_copy(update={"index": index, **lengths})})


def _cover(passes: Single, share: Single, light: float) -> None:
    """Let `light` of what passes through where `share` is 1."""
    passes *= 1 - (1 - np.float32(light)) * share


def _disc(like: Single, u: float, v: float, radius: float) -> Single:
    rows, cols = np.ogrid[: like.shape[0], : like.shape[1]]
    return _soft(np.hypot(cols - u, rows - v) - radius)


def _line(like: Single, ends: Float, half_width: float) -> Single:
    """A segment between two points (2, 2), (u, v)."""
    rows, cols = np.ogrid[: like.shape[0], : like.shape[1]]
    (u, v), way = ends[0], ends[1] - ends[0]
    length = max(float(np.hypot(*way)), 1e-9)
    along = np.clip(((cols - u) * way[0] + (rows - v) * way[1]) / length**2, 0, 1)
    return _soft(np.hypot(cols - u - along * way[0], rows - v - along * way[1]) - half_width)


def _soft(outside_px: Float) -> Single:
    """1 inside, 0 outside a border, blurred; by distances from it, > 0 outside."""
    return np.asarray(ndtr(-outside_px / _SOFT_PX), np.float32)
