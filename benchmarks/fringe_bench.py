"""Fringes of a planted bench: a mirror in a dark image, an LCD of gamma 2.2, a noisy camera of 8 bits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zeromethod.arrays import Float, Image, Mask
from zeromethod.decoding.fringes import FringeSequence, equal_shifts

GAMMA = 2.2
PANEL = (1920, 1080)
BLACK_GREY, WHITE_GREY = 4.0, 220.0
READ_GREY, ELECTRONS_PER_GREY = 1.0, 60.0


@dataclass(frozen=True)
class FringeBench:
    """A curved mirror that covers `lit` of the image, of which one camera px sees about 0.8 LCD px.

    shape: (rows, cols). The rest of the image sees `stray` of the LCD's mean light. blur_px: of the lens, LCD
    px; it dims fine fringes more than coarse ones. flicker: change of the backlight from frame to frame, rms.
    """

    periods_px: tuple[float, ...]
    shifts: int = 4
    shape: tuple[int, int] = (480, 640)
    lit: float = 0.23
    blur_px: float = 3.0
    stray: float = 0.002
    flicker: float = 0.0
    seed: int = 1

    @property
    def sequence(self) -> FringeSequence:
        """What is shown: the periods, the longest first."""
        return FringeSequence(self.periods_px, equal_shifts(self.shifts))

    @cached_property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the mirror, in the middle."""
        side = np.sqrt(self.lit)
        rows, cols = ((round(0.5 * (1 - side) * n), round(0.5 * (1 + side) * n)) for n in self.shape)
        return slice(*rows), slice(*cols)

    @cached_property
    def mirror(self) -> Mask:
        """(rows, cols) that see the LCD."""
        inside = np.zeros(self.shape, np.bool_)
        inside[self.window] = True
        return inside

    @cached_property
    def truth(self) -> Float:
        """(rows, cols, 2) LCD px: turned, with a curvature and a ripple."""
        v, u = (n - 0.5 * size for n, size in zip(np.indices(self.shape), self.shape, strict=True))
        column = 0.5 * PANEL[0] + 0.83 * u + 0.05 * v + 2e-4 * u * v + 4 * np.sin(u / 90)
        row = 0.5 * PANEL[1] - 0.04 * u + 0.79 * v + 3e-4 * u**2 + 3 * np.cos(v / 70)
        return np.stack([column, row], axis=-1)

    def frames(self) -> Image:
        """(frames, rows, cols) of 8 bits, in the sequence's order."""
        rng = np.random.default_rng(self.seed)
        turn = 2 * np.pi * np.arange(64) / 64
        light = np.fft.rfft((0.5 + 0.48 * np.cos(turn)) ** GAMMA).real / 64
        out = []
        for fringes in self.sequence.sets():
            k = 2 * np.pi / self.periods_px[fringes.period]
            x = self.truth[..., int(fringes.axis == "rows")]
            for shift in self.sequence.shifts_rad:
                seen = np.full(self.shape, light[0])
                for h in range(1, 9):
                    damped = 2 * light[h] * np.exp(-0.5 * (h * k * self.blur_px) ** 2)
                    seen += damped * np.cos(h * (k * x - shift))
                seen = np.where(self.mirror, seen, self.stray * light[0])
                signal = (WHITE_GREY - BLACK_GREY) * seen * (1 + self.flicker * rng.normal())
                noise = np.sqrt(READ_GREY**2 + signal / ELECTRONS_PER_GREY) * rng.normal(size=self.shape)
                out.append(np.clip(np.rint(BLACK_GREY + signal + noise), 0, 255).astype(np.uint8))
        return np.array(out)


def linearised(frames: Image) -> Image:
    """Frames as the LCD's grey codes, by the inverse response; dark pixels become mostly noise."""
    light = np.clip((np.arange(256) - BLACK_GREY) / (WHITE_GREY - BLACK_GREY), 0, 1)
    return np.asarray(np.rint(255 * light ** (1 / GAMMA)).astype(np.uint8)[frames])
