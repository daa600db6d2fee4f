"""The target: the light that every camera pixel should receive, as a function of camera position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float, Single
from zeromethod.rig.model import TargetSpec

TILE_PERIODS = 32
"""The noise target repeats after this many periods; its texels are one camera px apart."""

SHARP = 1e9
"""LCD px per period that stand for edges without width."""

NOISE_BAND = (0.5, 1.25)
"""Spatial frequencies of the noise target, in cycles per period: none finer than a carrier's 1.25."""


@dataclass(frozen=True)
class Target:
    """Light 0..1 in camera pixels: mean x (1 + contrast x shape(u, v)), |shape| <= 1.

    cosines: (cos(2 pi u/P) + cos(2 pi v/P)) / 2. checker: squares of P/2, a white one centred on the
    origin. lattice: bright lines P/4 wide, P apart, through the origin. noise: tileable band-limited
    random texture, the same for the same seed. The shader `pattern.frag` holds the same formulas.
    """

    kind: Literal["cosines", "checker", "lattice", "noise"] = "cosines"
    period_px: int = 16
    mean: float = 0.5
    contrast: float = 0.9
    seed: int = 0

    @classmethod
    def from_spec(cls, spec: TargetSpec) -> Target:
        """Target of a rig file (which refuses a contrast that would pass full light)."""
        return cls(spec.kind, spec.period_px, spec.mean, spec.contrast)

    @cached_property
    def texture(self) -> Single:
        """(n, n) float32 in -1..1, rows along v: the tile of the noise target, n = 32 periods."""
        n = TILE_PERIODS * self.period_px
        fy, fx = np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None, :]
        cycles = np.hypot(fx, fy) * self.period_px
        low, high = NOISE_BAND
        white = np.fft.rfft2(np.random.default_rng(self.seed).standard_normal((n, n)))
        band = np.fft.irfft2(np.where((cycles >= low) & (cycles <= high), white, 0), s=(n, n))
        return np.asarray(band / np.abs(band).max(), dtype=np.float32)

    def light(self, u: ArrayLike, v: ArrayLike, lcd_px: tuple[float, float] = (SHARP, SHARP)) -> Float:
        """Light at camera position (u, v), px, arrays of one shape.

        lcd_px: LCD px per period along u and along v, as drawn: the edges of checker and lattice then pass
        over one LCD px, as a picture sampled at LCD pixels would place a sharp edge half a pixel wrong.

        Convention: (u, v) = (column, row), pixel centres at integers; a maximum of the periodic kinds
        lies at (0, 0).
        """
        u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        return np.asarray(self.mean * (1 + self.contrast * self._shape(u, v, lcd_px)))

    def _shape(self, u: Float, v: Float, lcd_px: tuple[float, float]) -> Float:
        if self.kind == "noise":
            return self._noise(u, v)
        if self.kind == "cosines":
            carriers = np.cos(2 * np.pi * u / self.period_px) + np.cos(2 * np.pi * v / self.period_px)
            return np.asarray(0.5 * carriers)
        # Distance from the nearest line's or square's middle, periods: 0 .. 0.5.
        du, dv = (np.abs(x / self.period_px - np.rint(x / self.period_px)) for x in (u, v))
        if self.kind == "checker":
            signs = (np.clip(2 * n * (0.25 - x), -1, 1) for x, n in zip((du, dv), lcd_px, strict=True))
            return np.asarray(np.prod(list(signs), axis=0))
        dark = (np.clip(0.5 - n * (0.125 - x), 0, 1) for x, n in zip((du, dv), lcd_px, strict=True))
        return np.asarray(1 - 2 * np.prod(list(dark), axis=0))

    def _noise(self, u: Float, v: Float) -> Float:
        n = self.texture.shape[0]
        i, j = np.floor(u).astype(np.intp), np.floor(v).astype(np.intp)
        s, t = u - i, v - j
        i0, i1, j0, j1 = i % n, (i + 1) % n, j % n, (j + 1) % n
        texture = self.texture.astype(np.float64)
        upper = (1 - s) * texture[j0, i0] + s * texture[j0, i1]
        lower = (1 - s) * texture[j1, i0] + s * texture[j1, i1]
        return np.asarray((1 - t) * upper + t * lower)
