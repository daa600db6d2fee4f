"""A camera that looks at an LCD through a smooth planted map: every frame is a formula plus noise."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from zeromethod.decoding.fringes import FringeSequence

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

PANEL = (1920, 1080)


def smooth_map(shape: tuple[int, int]) -> Float:
    """(rows, cols, 2): a view of 1280 x 1024 px on a 1920 x 1080 LCD, about px by px, turned and bent."""
    rows, cols = shape
    v, u = np.mgrid[:rows, :cols].astype(float)
    u, v = 1280 * u / cols, 1024 * v / rows
    column = 300 + 0.95 * u + 0.03 * v + 1.5e-4 * (u - 500) * (v - 400) + 6 * np.sin(u / 170)
    row = 60 + 0.92 * v - 0.02 * u + 1e-4 * (u - 640) ** 2 + 4 * np.cos(v / 140)
    return np.stack([column, row], axis=-1)


@dataclass
class Bench:
    """Light at pixel p: reflectance x (LCD light at map(p) + ghost x LCD light at map(p) + ghost_offset).

    Grey = black + peak x light, variance read^2 + signal / electrons per grey, rounded, clipped to `bits`.
    shade(frame number) multiplies the light: a hand. gamma: the LCD is driven by the fringes' light as if it
    were its code. blur_px: of the lens, LCD px.
    """

    shape: tuple[int, int] = (128, 160)
    gamma: float = 1.0
    read: float = 2.0
    electrons: float = 150.0
    black: float = 4.0
    peak: float = 200.0
    bits: int = 8
    blur_px: float = 1.5
    ambient: float = 0.02
    ghost: Float | float = 0.0
    ghost_offset: tuple[Float | float, Float | float] = (37.0, -23.0)
    reflectance: Float | float = 1.0
    shade: Callable[[int], Float | float] = lambda number: 1.0
    mirror: Mask | None = None
    seed: int = 1
    lcd: Float = field(init=False)

    def __post_init__(self) -> None:
        self.lcd = smooth_map(self.shape)

    def _light(self, x: Float, period: float, shift: float) -> Float:
        """LCD light at x through the lens; the blur damps each harmonic of the response by its own factor."""
        k = 2 * np.pi / period
        if self.gamma == 1.0:
            return 0.5 + 0.45 * np.exp(-0.5 * (k * self.blur_px) ** 2) * np.cos(k * x - shift)
        t = 2 * np.pi * np.arange(64) / 64
        waves = np.fft.rfft((0.5 + 0.45 * np.cos(t)) ** self.gamma) / 64
        out = np.full_like(x, waves[0].real)
        for h in range(1, 12):
            damp = np.exp(-0.5 * (h * k * self.blur_px) ** 2)
            out += 2 * waves[h].real * damp * np.cos(h * (k * x - shift))
        return out

    def frames(self, sequence: FringeSequence) -> list[NDArray[np.uint16] | NDArray[np.uint8]]:
        rng = np.random.default_rng(self.seed)
        out = []
        for fringes in sequence.sets():
            axis = 0 if fringes.axis == "columns" else 1
            period = sequence.periods_px[fringes.period]
            for shift in sequence.shifts_rad:
                x = self.lcd[..., axis]
                light = self._light(x, period, shift)
                if np.any(self.ghost):
                    light = light + self.ghost * self._light(x + self.ghost_offset[axis], period, shift)
                light = self.ambient + self.reflectance * light * self.shade(len(out))
                if self.mirror is not None:
                    light = np.where(self.mirror, light, self.ambient + 0.2)
                signal = self.peak * light
                noise = np.sqrt(self.read**2 + signal / self.electrons) * rng.normal(size=self.shape)
                grey = np.clip(np.rint(self.black + signal + noise), 0, 2**self.bits - 1)
                out.append(grey.astype(np.uint8 if self.bits == 8 else np.uint16))
        return out
