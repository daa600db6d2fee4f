"""Where a saw's teeth stand in the image: columns at which the rest map jumps from one tooth to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.measurements import PixelsOnLine
from zeromethod.calibration.rays import tooth_phase
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

_SIGMA_NODES = 1.5
"""Of a seam's column: a node and more, as a window blends both sides."""
_SIDE, _LEFT_OUT = 4, 1
"""Nodes of a row by which a jump is found on either side, and left out between them."""
_BANDS = 3
_JUMP_SIGMAS = 5.0
_APART = 0.6
"""Of a tooth, between two seams."""


@dataclass(frozen=True, eq=False)
class ToothSeams(PixelsOnLine):
    """Pixels (m, 2) that lie on seams. The numbers are distances from the nearest seam, camera px along u."""

    pixel: Float
    sigma_px: float
    blind_to: ClassVar[frozenset[str]] = frozenset()
    name: ClassVar[str] = "seams"

    @classmethod
    def of(cls, rig: Rig, grid: NodeGrid, rest: Warp) -> Self | None:
        """Those at which a warp measured at rest jumps; None of a prism, or where it nowhere does."""
        if rig.prism.teeth is None:
            return None
        u, v = (one[grid.inner] for one in grid.mesh())
        q = np.where(rest.valid[grid.inner][..., None], rest.q[grid.inner], np.nan)
        found = []
        for rows in np.array_split(np.arange(len(v)), _BANDS):
            middle = float(v[rows].mean())
            pitch_px = float(tooth_phase(rig, np.array([u.mean()]), np.array([middle]))[1][0])
            columns = u[0, 0] + grid.spacing_px * _jumps(
                _filled(q[rows]), _APART * pitch_px / grid.spacing_px
            )
            found += [(column, middle) for column in columns]
        return cls(np.array(found), _SIGMA_NODES * grid.spacing_px) if found else None

    def predict(self, rig: Rig) -> Float:
        """(m,) camera px from the nearest seam."""
        return tooth_phase(rig, *self.pixel.T)[0]


def _filled(q: Float) -> Float:
    """LCD px (rows, cols, 2) with what a row lacks, as at a seam, on a line between its neighbours."""
    filled, column = q.copy(), np.arange(q.shape[1])
    for row in filled:
        known = np.isfinite(row[:, 0])
        if known.sum() > len(known) // 2:
            for axis in range(2):
                row[:, axis] = np.interp(column, column[known], row[known, axis], np.nan, np.nan)
    return filled


def _jumps(q: Float, apart: float) -> Float:
    """Places, in columns, at which q (rows, cols, 2) jumps: the largest first, none within `apart` of one."""
    n, skip = _SIDE, _LEFT_OUT
    reach = n + skip
    # straight lines by n nodes on either side, continued to the middle between columns
    t = np.arange(n) + skip + 0.5
    ahead = 1.0 / n - (t - t.mean()) * t.mean() / ((t - t.mean()) ** 2).sum()
    weights = np.concatenate([-ahead[::-1], np.zeros(2 * skip), ahead])
    places = np.arange(reach, q.shape[1] - reach + 1)
    with np.errstate(invalid="ignore"):
        jump = np.stack(
            [np.einsum("k,rkc->rc", weights, q[:, c - reach : c + reach]) for c in places], axis=1
        )
        known = np.isfinite(jump[..., 0]).sum(axis=0) > len(q) // 2
    if not known.any():
        return np.empty(0)
    middle = np.nanmedian(np.where(known[:, None], jump, np.nan)[:, known], axis=0)
    spread = 1.4826 * np.nanmedian(np.abs(jump[:, known] - middle), axis=(0, 1)) / np.sqrt(len(q))
    size = np.zeros(len(places))
    size[known] = np.max(np.abs(middle - np.median(middle, axis=0)) / spread, axis=-1)
    found: list[float] = []
    while size.max() > _JUMP_SIGMAS:
        away = np.abs(places - places[size.argmax()])
        # a jump is as large wherever it lies between both sides
        peak = np.where(away <= reach, size - 0.5 * size.max(), 0.0).clip(0.0)
        found.append(float((peak @ places) / peak.sum()) - 0.5)
        size[away < apart] = 0.0
    return np.array(found)
