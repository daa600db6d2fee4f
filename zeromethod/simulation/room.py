"""What the watch camera sees behind all objects: a room so far away that only the ray's direction counts."""

from __future__ import annotations

import math

import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.rig.model import Rig

_STREAM = 8
_WAVES = 12
MEAN, TEXTURE = 0.62, 0.06
_SHADOW_S, _DARKEST = 6.0, 0.6
"""How long a shadow takes across the view, on average, and the most light that one takes away."""


class Room:
    """Light of the room by direction and time, by the seed alone.

    Its light swings slowly and, now and then, at once (`nuisances.room_light`); soft-edged shadows wander
    over it (`nuisances.room_shadows` of them at a time).
    """

    def __init__(self, rig: Rig) -> None:
        nuisances = rig.simulation.nuisances
        self._seed, self._swing, self._shadows = (
            rig.simulation.seed, nuisances.room_light, nuisances.room_shadows,
        )  # fmt: skip
        rng = np.random.default_rng([self._seed, _STREAM])
        self._waves = rng.normal(0.0, 7.0, (_WAVES, 2))
        self._phases = rng.uniform(0.0, 2 * np.pi, _WAVES)
        self._texture: tuple[int, Single, tuple[Single, Single]] | None = None

    def level(self, time_s: float) -> float:
        """The room's light over its mean."""
        if not self._swing:
            return 1.0
        jump = np.random.default_rng([self._seed, _STREAM, 1, int(time_s // 20.0)]).uniform(-1.0, 1.0)
        slow = np.sin(2 * np.pi * time_s / 31.0) + 0.5 * np.sin(2 * np.pi * time_s / 7.3 + 1.0)
        return float(1.0 + self._swing * (0.5 * jump + 0.33 * slow))

    def light(self, direction: Float, time_s: float) -> Single:
        """(rows, cols) light that comes along rays `direction` (rows, cols, 3) in the air."""
        if self._texture is None or self._texture[0] != id(direction):
            with np.errstate(invalid="ignore"):
                x, y = ((direction[..., k] / direction[..., 2]).astype(np.float32) for k in (0, 1))
            waves = (np.sin(a * x + b * y + p) for (a, b), p in zip(self._waves, self._phases, strict=True))
            texture = MEAN + TEXTURE * sum(waves, np.zeros_like(x)) / math.sqrt(_WAVES / 2)
            self._texture = id(direction), texture.astype(np.float32), (x, y)
        _, found, (x, y) = self._texture
        light = found * np.float32(self.level(time_s))
        for k in range(self._shadows):
            light = light * self._shadow(k, x, y, time_s)
        return light

    def _shadow(self, k: int, x: Single, y: Single, time_s: float) -> Single:
        """Share of the light that shadow number k leaves."""
        period_s = _SHADOW_S * (1.0 + 0.37 * k)
        turn, share = divmod(time_s / period_s + 0.61 * k, 1.0)
        rng = np.random.default_rng([self._seed, _STREAM, 2, k, int(turn)])
        least, most = [0, -0.5, 0.02, 0.05, 0.1, 0.5], [6.3, 0.5, 0.2, 0.6, _DARKEST, 3.0]
        # plain numbers keep the arrays in single precision
        angle, off, width, length, dark, speed = rng.uniform(least, most).tolist()
        c, s = math.cos(angle), math.sin(angle)
        along, across = c * x + s * y - speed * (2.4 * share - 1.2), c * y - s * x - off
        with np.errstate(invalid="ignore", over="ignore"):
            left: Single = 1.0 - dark * np.exp(-((along / width) ** 2) - (across / length) ** 2)
        return left
