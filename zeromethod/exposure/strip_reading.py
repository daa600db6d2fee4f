"""Reading the coded strips of a frame: the share of its light with each bit set.

With a and b the light of a bit's cells and of their complement, (a - b) / (a + b) is 1, -1, or in between
where pictures with either value shared the exposure. Stray light lowers all of these alike; the frame itself
shows by how much: at most three of five bits change within three pictures, the strongest two are unmixed.

Strips that cannot be trusted are skipped: clipped cells, too little contrast, uneven cells (a press moved
them, or something lies on the mirror).
"""

from __future__ import annotations

from dataclasses import dataclass

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


def _quarters(image: Image, windows: Ints, along_u: bool) -> Float:
    """Mean grey (bits, 3, 4) of the quarters of every cell's window: start, stop along, then across."""
    first, last = windows[0, 0, 2:]  # the same for all cells
    middle = (first + last) // 2
    lines = image if along_u else image.T
    halves = np.stack([lines[first:middle].sum(axis=0), lines[middle:last].sum(axis=0)]).astype(np.float64)
    running = np.concatenate([np.zeros((2, 1)), np.cumsum(halves, axis=1)], axis=1)
    start, stop = windows[..., 0], windows[..., 1]
    edges = np.stack([start, (start + stop) // 2, stop], axis=-1)
    lengths = np.array([middle - first, last - middle])[:, None, None, None]
    means = np.diff(running[:, edges], axis=-1) / (np.diff(edges, axis=-1) * lengths)
    return np.asarray(np.moveaxis(means, 0, 2).reshape(*start.shape, 4))


def _levels(quarters: Float, black: float) -> tuple[Float, float] | None:
    """(levels (bits,), rms unevenness over swing) of a strip; None where it is unreadable."""
    cells = quarters.mean(axis=-1)
    # two outer cells of half the width of the inner pair's window
    outer, inner = 0.5 * (cells[:, 0] + cells[:, 2]), cells[:, 1]
    both = outer + inner - 2.0 * black
    if both.min() <= 0.0:
        return None
    levels = (outer - inner) / both
    contrast = float(np.sort(np.abs(levels))[-2:].mean())  # of the unmixed bits
    swing = contrast * both.mean()
    if contrast < LEAST_CONTRAST or swing < LEAST_GREY:
        return None
    off = (quarters - cells[..., None]) / swing
    if np.abs(off).max() > UNEVEN:
        return None
    return 0.5 + 0.5 * levels / contrast, float(np.sqrt(np.mean(off * off)))


def _windows(strip: Strip) -> Ints:
    """(bits, 3, 4): start, stop along, start, stop across of every cell's inner half, camera px."""
    bit = UNITS_PER_BIT * np.arange(BITS)[:, None]
    starts = strip.start_px + strip.unit_px * (bit + np.array([0.25, 1.5, 3.25])) + 0.5
    stops = strip.start_px + strip.unit_px * (bit + np.array([0.75, 2.5, 3.75])) + 0.5
    # whole pixels inside
    along = np.stack([np.ceil(starts), np.maximum(np.floor(stops), np.ceil(starts) + 2)], axis=-1)
    return np.concatenate([along, np.broadcast_to(strip.read_px, along.shape)], axis=-1).astype(np.int64)


class StripReader:
    """Reader of the strips of a rig's frames.

    noise: the camera's, for its black level. bits: its bit depth.
    """

    def __init__(self, strips: Strips, noise: Noise, bits: int) -> None:
        self._along_u = strips.along_u
        self._strips = tuple((_windows(strip), strip.panel_rows) for strip in (strips.first, strips.last))
        self._black = noise.black_grey
        self._clipped = CLIPPED_SHARE * (2**bits - 1)

    def read(self, image: Image) -> tuple[StripReading, ...]:
        """Readings of one image (rows, cols): of both strips, one, or none."""
        readings = []
        for windows, rows in self._strips:
            quarters = _quarters(image, windows, self._along_u)
            if quarters.max() >= self._clipped:
                continue
            found = _levels(quarters, self._black)
            if found is not None:
                levels, uneven = found
                # a level averages eight quarters of outer cells and four of inner cells
                readings.append(StripReading(levels, uneven / np.sqrt(4), rows))
        return tuple(readings)
