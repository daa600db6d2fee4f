"""What image correlation gives: displacement per point, with what is not known about it."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Bytes, Float, Mask


class PointFlag(enum.IntFlag):
    """Reasons against a point, as bits; 0 means valid."""

    OUTSIDE = 1  # its pixels, or where they have gone, are not in the image
    TEXTURE = 2  # too little texture for its noise: displacement not determined
    MISMATCH = 4  # the two images do not look alike there
    UNSETTLED = 8  # the iteration still moved, or left the reach of its start
    ORDER = 16  # not joined to the main part without a jump: may be off by a period of the texture


@dataclass(frozen=True, slots=True)
class Displacement:
    """Displacement of `image` against `reference` on a lattice of points.

    u, v: (rows, cols) reference column and row of the points, px, pixel centres at integers. du, dv: (rows,
    cols) px, along columns and rows; also given, as a smooth guess, where not valid. sigma_u, sigma_v: (rows,
    cols) px, standard deviations of du and dv; NaN where nothing was measured. doubts: (rows, cols) uint8 of
    `PointFlag` bits. noise_grey: standard deviation of the grey difference of two matched pixels, median over
    the valid points (both images' noise together). match: (rows, cols) local correlation coefficient after
    the match. noise_area_px2: (rows, cols) px^2, the area over which errors go together: noise of an average
    over many points falls with the number of such areas, not of points.

    Convention: reference(u, v) = image(u + du, v + dv).
    """

    u: Float
    v: Float
    du: Float
    dv: Float
    sigma_u: Float
    sigma_v: Float
    doubts: Bytes
    match: Float
    noise_area_px2: Float
    noise_grey: float

    @property
    def valid(self) -> Mask:
        """(rows, cols) points that may be trusted."""
        return np.equal(self.doubts, 0)

    @property
    def sigma(self) -> Float:
        """(rows, cols) px: root mean square of the two components' standard deviations."""
        return np.asarray(np.sqrt(0.5 * (self.sigma_u**2 + self.sigma_v**2)))

    def place(self, u: Float, v: Float) -> tuple[Float, Float]:
        """(column, row) among the points of reference pixels (u, v), any shape."""
        spacing = self.u[0, 1] - self.u[0, 0]
        return (u - self.u[0, 0]) / spacing, (v - self.v[0, 0]) / spacing

    @property
    def field(self) -> Float:
        """(rows, cols, 2) px: (du, dv)."""
        return np.stack([self.du, self.dv], axis=-1)
