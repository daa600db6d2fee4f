"""Reading the coded strips of a frame: the share of its light with each bit set.

With a and b the light of a bit's cells and of their complement, (a - b) / (a + b) is 1, -1, or in between
where pictures with either value shared the exposure. Stray light lowers all of these alike; the frame itself
shows by how much: at most three of five bits change within three pictures, the strongest two are unmixed.

Strips that cannot be trusted are skipped: clipped cells, too little contrast, uneven cells (a press moved
them, or something lies on the mirror).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from zeromethod.arrays import Float, Image, Ints
from zeromethod.pattern.strips import BITS, UNITS_PER_BIT, Strip, Strips
from zeromethod.rig.model import Noise, Rig
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag

LEAST_CONTRAST = 0.3
"""Least contrast of the unmixed bits; stray light three times the pattern's leaves a quarter."""

LEAST_GREY = 6.0
"""Grey levels between white and black below which nothing is read."""

GREY_ABOVE = 0.05
"""Distance of a level from 0 and 1 above which two pictures are mixed in it."""

UNEVEN = 0.1
"""Largest deviation of a cell's quarters from its mean, in units of white minus black."""

CLIPPED_SHARE = 0.99
"""Share of the largest grey level from which a cell counts as clipped."""


def find_strips(rig: Rig, rest: Rest) -> Strips | None:
    """Strips that the rig asks for; None without, and where the panel is not visible along the edges."""
    if not rig.coded:
        return None
    no_ray = (rest.flags & np.uint16(Flag.NO_RAY)) != 0
    return Strips.of(rest.grid, rest.q, no_ray, rest.display_size)


@dataclass(frozen=True)
class StripReading:
    """Reading of one strip. levels: (5,) share of the exposure's light with each bit set, 0..1 but for noise.

    sigma: standard deviation of a level. panel_rows: (5,) LCD row of each bit at rest.
    """

    levels: Float
    sigma: float
    panel_rows: Float

    @property
    def code(self) -> int | None:
        """Code where one picture alone was lit; None where bits are grey or the check fails."""
        bits = np.rint(self.levels).astype(int)
        if np.abs(self.levels - bits).max() > GREY_ABOVE:
            return None
        code = 0
        for bit in bits[BITS - 2 :: -1]:
            code = code << 1 | (bit ^ (code & 1))
        return code if (code & 1) == bits[-1] else None


@numba.njit(cache=True)
def _quarters(image: Image, windows: Ints, along_u: bool, quarters: Float) -> None:
    """Mean grey (bits, 3, 4) of the quarters of every cell's window: start, stop along, then across."""
    for k in range(windows.shape[0]):
        for c in range(windows.shape[1]):
            a0, a2, b0, b2 = windows[k, c]
            a1, b1 = (a0 + a2) // 2, (b0 + b2) // 2
            for part in range(4):
                f0, f1 = (a0, a1) if part % 2 == 0 else (a1, a2)
                g0, g1 = (b0, b1) if part < 2 else (b1, b2)
                total = 0.0
                if along_u:
                    for j in range(g0, g1):
                        for i in range(f0, f1):
                            total += image[j, i]
                else:
                    for j in range(f0, f1):
                        for i in range(g0, g1):
                            total += image[j, i]
                quarters[k, c, part] = total / ((f1 - f0) * (g1 - g0))


@numba.njit(cache=True)
def _levels(quarters: Float, black: float, levels: Float) -> tuple[float, float]:
    """Fill levels (bits,); (contrast of the unmixed bits, 0 if unreadable; rms unevenness / contrast)."""
    bits = quarters.shape[0]
    most = second = white = 0.0
    for k in range(bits):
        # two outer cells of half the width of the inner pair's window
        outer = inner = 0.0
        for part in range(4):
            outer += 0.125 * (quarters[k, 0, part] + quarters[k, 2, part])
            inner += 0.25 * quarters[k, 1, part]
        both = outer + inner - 2.0 * black
        if both <= 0.0:
            return 0.0, 0.0
        levels[k] = (outer - inner) / both
        white += both / bits
        size = abs(levels[k])
        if size > most:
            most, second = size, most
        elif size > second:
            second = size
    contrast = 0.5 * (most + second)
    swing = contrast * white
    if contrast < LEAST_CONTRAST or swing < LEAST_GREY:
        return 0.0, 0.0
    square = 0.0
    for k in range(bits):
        for c in range(3):
            mean = 0.0
            for part in range(4):
                mean += 0.25 * quarters[k, c, part]
            for part in range(4):
                off = (quarters[k, c, part] - mean) / swing
                if abs(off) > UNEVEN:
                    return 0.0, 0.0
                square += off * off / (12 * bits)
        levels[k] = 0.5 + 0.5 * levels[k] / contrast
    return contrast, np.sqrt(square)


def _windows(strip: Strip) -> Ints:
    """(bits, 3, 4): start, stop along, start, stop across of every cell's inner half, camera px."""
    bit = UNITS_PER_BIT * np.arange(BITS)[:, None]
    starts = strip.start_px + strip.unit_px * (bit + np.array([0.25, 1.5, 3.25])) + 0.5
    stops = strip.start_px + strip.unit_px * (bit + np.array([0.75, 2.5, 3.75])) + 0.5
    # whole pixels inside
    along = np.stack([np.ceil(starts), np.maximum(np.floor(stops), np.ceil(starts) + 2)], axis=-1)
    return np.concatenate([along, np.broadcast_to(strip.read_px, along.shape)], axis=-1).astype(np.int64)


class StripReader:
    """Reader of the strips of a rig's frames. noise: the camera's, for its black level. bits: its bit depth.

    The constructor compiles.
    """

    def __init__(self, strips: Strips, image_shape: tuple[int, int], noise: Noise, bits: int) -> None:
        self._along_u = strips.along_u
        self._strips = tuple((_windows(strip), strip.panel_rows) for strip in (strips.first, strips.last))
        self._black = noise.black_grey
        self._clipped = CLIPPED_SHARE * (2**bits - 1)
        self._quarters = np.zeros((BITS, 3, 4))
        self.read(np.zeros(image_shape, np.uint8 if bits == 8 else np.uint16))

    def read(self, image: Image) -> tuple[StripReading, ...]:
        """Readings of one image (rows, cols): of both strips, one, or none."""
        readings = []
        for windows, rows in self._strips:
            _quarters(image, windows, self._along_u, self._quarters)
            if self._quarters.max() >= self._clipped:
                continue
            levels = np.empty(BITS)
            contrast, uneven = _levels(self._quarters, self._black, levels)
            if contrast:
                # a level averages eight quarters of outer cells and four of inner cells
                readings.append(StripReading(levels, uneven / np.sqrt(4), rows))
        return tuple(readings)
