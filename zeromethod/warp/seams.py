"""Seams between a saw's teeth: where the camera sees them, and how they move as the mirror tilts.

The mirror goes on over a seam, the optics under it do not: on one side of it rays are longer in the rubber
than on the other, and a band of the mirror between is not seen at all.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.optics import Lost, Optics
from zeromethod.optics.bench import sensitivity_of_rays
from zeromethod.optics.saw_rays import seams
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.runs import runs

_SLACK_PX = 2.0
"""By how much seams may be off where the rig file has them: 0.05 mm of rubber make 1.8 px."""
_FAR_PX = 1e9
_LET_IN_PX = 6.0
"""How much further a seam that moved may come into the window: about a twentieth of its weight, and noise
at rest moves none."""


def gaps(valid: Mask, seams: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Runs of nodes of a row without a value that have a seam among them.

    valid, seams: (rows, cols), seams by number, 0 for none. Result: (n,) row, first column, that after the
    last, and seam of each; the one of the largest number where there are several.
    """
    row, first, end = runs(~valid)
    starts = row * valid.shape[1]
    within = np.stack([starts + first, starts + end], axis=-1).ravel()
    seam = np.maximum.reduceat(np.append(seams.ravel(), 0), within)[::2]
    has = seam > 0
    return row[has], first[has], end[has], seam[has]


class SeamMap:
    """Seams of a rig's saw, as the measurable nodes of a grid see them.

    x_mm: (rows, cols) where the nodes look on the mirror at rest. slope_per_px: (rows, cols, 2, 2) rad along
    x and y that move a node's LCD position by a px along columns, and rows.
    """

    def __init__(self, optics: Optics, grid: NodeGrid) -> None:
        # a node without a ray of its own stands where it does in the image
        lattice = np.meshgrid(grid.u_px, grid.v_px)
        pixels = (np.where(np.isnan(a), b, a) for a, b in zip(grid.mesh(), lattice, strict=True))
        u, v = (each[grid.inner] for each in pixels)
        first, last = int(u.min()) - grid.period_px, int(u.max()) + grid.period_px + 1
        across = np.arange(first, last + 1, dtype=np.float64)
        lost, *teeth = seams(optics, *np.meshgrid(across, np.median(v, axis=1)))
        changes = (np.diff(tooth, axis=1, append=tooth[:, -1:]) != 0 for tooth in teeth)
        entry, leaving = (_distances((lost == Lost.SEAM) | change) for change in changes)
        columns = np.rint(u - first).astype(np.intp)
        self._before_px, self._after_px = (np.take_along_axis(one, columns, 1) for one in leaving)
        self._entry_px = np.minimum(*(np.take_along_axis(one, columns, 1) for one in entry))
        self._reach_px = grid.period_px + _SLACK_PX
        at_rest = optics.trace(u, v, optics.rest)
        self.x_mm = at_rest.point[..., 0]
        step_mm = np.gradient(self.x_mm, axis=1)
        self._step_mm = np.nan_to_num(step_mm)
        # by how much a seam of the faces towards the LCD moves to where u grows, per rad, at a valley and at
        # a tip: a slope turns the ray by twice as much, and it leaves the further off the longer it stays in
        # the rubber
        per_px = float(np.nanmedian(step_mm)) / grid.spacing_px
        per_mm = 2.0 / (float(np.nanmedian(at_rest.cos_incidence)) ** 2 * per_px)
        spec = optics.rig.prism.teeth
        assert spec is not None
        self._moves_px = spec.base_mm * per_mm, optics.prism.thickness_mm * per_mm
        origin, direction = optics.rubber_rays(u, v)
        sensitivity = sensitivity_of_rays(optics, origin, direction)
        regular = np.asarray(np.isfinite(sensitivity)).all(axis=(-2, -1), keepdims=True)
        self.slope_per_px: Float = np.linalg.inv(np.where(regular, sensitivity, np.eye(2)))
        # a deeper mirror is met earlier and left earlier: rays are shorter in the rubber, both ways
        self._deeper_px = 2.0 * float(np.nanmedian(direction[..., 0] / direction[..., 2])) / per_px

    @classmethod
    def of(cls, optics: Optics, grid: NodeGrid) -> SeamMap | None:
        """Those of a rig; None of a prism."""
        return None if optics.rig.prism.teeth is None else cls(optics, grid)

    def touched(self, slope_x: Float, depth_mm: Float | float = 0.0, less_px: float = 0.0) -> Mask:
        """Nodes (rows, cols) whose window touches a seam of a mirror that slopes so along x, rad, so deep.

        less_px: by how much less than the window reaches, and what seams may be off.
        """
        valley, tip = (per_rad * slope_x + self._deeper_px * depth_mm for per_rad in self._moves_px)
        after_px = self._after_px + np.minimum(valley, tip)
        before_px = self._before_px - np.maximum(valley, tip)
        nearest = np.minimum(self._entry_px, np.minimum(before_px, after_px))
        return np.asarray(nearest < self._reach_px - less_px)

    def moved(self, away: Float) -> Mask:
        """Nodes (rows, cols) that see a seam well inside their window, by where they look from rest.

        away: (rows, cols, 2) LCD px. The mirror is taken to be as deep as its slopes add up to along rows, 0
        on average at their ends.
        """
        slope_x = np.einsum("...k,...k->...", self.slope_per_px[..., 0, :], away)
        depth_mm = np.cumsum(slope_x * self._step_mm, axis=1)
        depth_mm -= depth_mm[:, [0, -1]].mean(axis=1, keepdims=True)
        return self.touched(slope_x, depth_mm, _LET_IN_PX)


def _distances(marked: Mask) -> tuple[Float, Float]:
    """Px from each column (rows, cols) to the nearest marked one at or before it, and at or after it."""
    column = np.broadcast_to(np.arange(marked.shape[1], dtype=np.float64), marked.shape)
    before = np.maximum.accumulate(np.where(marked, column, -_FAR_PX), axis=1)
    after = np.minimum.accumulate(np.where(marked, column, _FAR_PX)[:, ::-1], axis=1)[:, ::-1]
    return column - before, after - column
