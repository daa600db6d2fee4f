"""How the light of an evenly lit LCD falls off over the camera's view.

Lens, viewing angle of the LCD, Fresnel losses and backlight act together here; one picture cannot separate
them, and for the noise that is left in each region it does not matter which it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from zeromethod.arrays import Float, Mask
from zeromethod.errors import MeasurementError

TILES = (4, 4)
"""Regions of the view, along rows and columns."""

LEAST_LIT = 0.5
"""Share of a tile that must be lit for it to count."""

LIT_SHARE = 0.15
"""Of the view's bright end: pixels whose light follows the LCD by less do not look at it by the mirror."""

WEAK_SHARE = 0.3
"""Of the brightest tile's light, below which a tile is worth a word: signal to noise is a third or less."""

_ORDER = 4


def lit_pixels(white: Float, black: Float) -> Mask:
    """Pixels (rows, cols) that follow the LCD, by its white and black pictures."""
    swing = np.asarray(white, dtype=np.float64) - black
    return np.asarray(swing > max(LIT_SHARE * float(np.percentile(swing, 98)), 1e-9))


def tile_means(image: Float, lit: Mask) -> Float:
    """(tile rows, tile cols) mean of the lit pixels of each tile; NaN where too few are lit.

    image: (rows, cols); tiles split it as evenly as whole pixels allow.
    """
    sums, counts, full = map(_sums, (np.where(lit, image, 0.0), lit * 1.0, np.ones(lit.shape)))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(counts >= LEAST_LIT * full, sums / counts, np.nan)


def mean_around(image: Float, lit: Mask, size_px: int) -> Float:
    """(rows, cols) mean of the lit pixels in a square of `size_px` around each."""
    weight = uniform_filter(lit.astype(np.float64), size_px)
    return np.asarray(uniform_filter(np.where(lit, image, 0.0), size_px) / np.maximum(weight, 1e-9))


def _sums(image: Float) -> Float:
    starts = [np.arange(n) * size // n for size, n in zip(image.shape, TILES, strict=True)]
    return np.asarray(np.add.reduceat(np.add.reduceat(image, starts[0], axis=0), starts[1], axis=1))


@dataclass(frozen=True)
class Falloff:
    """Light over the view.

    light: (tile rows, tile cols) of the evenly lit LCD over the lit view's mean; NaN where too little is lit.
    smooth: (rows, cols) polynomial through the lit pixels, over the same mean; NaN elsewhere.
    """

    light: Float
    smooth: Float

    @property
    def darkest(self) -> float:
        """Light of the darkest tile over that of the brightest."""
        return float(np.nanmin(self.light) / np.nanmax(self.light))

    @property
    def weak_tile(self) -> tuple[int, int] | None:
        """(row, column) of the darkest tile, where it is worth a word."""
        if self.darkest >= WEAK_SHARE:
            return None
        row, column = np.unravel_index(np.nanargmin(self.light), self.light.shape)
        return int(row), int(column)


def measure_falloff(white: Float, black: Float, lit: Mask) -> Falloff:
    """Falloff from mean images (rows, cols) of the white and the black LCD.

    Raises MeasurementError where no tile is lit.
    """
    swing = np.where(lit, np.asarray(white, dtype=np.float64) - black, 0.0)
    tiles = tile_means(swing, lit)
    if not np.isfinite(tiles).any():
        raise MeasurementError(
            "falloff: no region of the view follows the LCD: see to focus, aim and exposure"
        )
    mean = float(swing[lit].mean())
    return Falloff(tiles / mean, _smooth(swing / mean, lit))


def _smooth(image: Float, lit: Mask) -> Float:
    """Polynomial of total order `_ORDER` in (row, col) through the lit pixels; NaN elsewhere."""
    axes = [np.linspace(-1.0, 1.0, size) for size in image.shape]
    powers = [(i, j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i)]
    rows, cols = np.nonzero(lit)
    # every pixel adds little to so few terms: some thousands, evenly spread, do
    chosen = slice(None, None, max(1, len(rows) // 20000))

    def terms(row: NDArray[np.intp], col: NDArray[np.intp]) -> Float:
        return np.stack([axes[0][row] ** i * axes[1][col] ** j for i, j in powers], axis=-1)

    fit = np.linalg.lstsq(terms(rows[chosen], cols[chosen]), image[rows[chosen], cols[chosen]], rcond=1e-9)[0]
    smooth = np.full(image.shape, np.nan)
    smooth[rows, cols] = terms(rows, cols) @ fit
    return smooth
