"""Ray maps fast enough to bend a moving picture: rays on a lattice, cubics between them."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Dented, Optics
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Mirror

SPACING_PX = 8
"""From node to node of the lattice, camera px."""
MARGIN = 3
"""Nodes beyond the first and the last pixel, which the error's estimate reaches out for."""
TOLERANCE = 0.003
"""Error from which a cell is traced ray by ray: LCD px, and hundredths of reflectance."""
ORDER = 16
"""By how much a cubic between nodes is better than one between every other node (fourth order)."""


class LatticeRays:
    """Ray maps of a rig by `zeromethod.optics`, traced on a lattice of camera pixels.

    Between nodes LCD position and reflectance follow the cubic through four nodes on each axis. Cells where
    that would be off by more than `TOLERANCE`, judged by the nodes themselves, or where a ray is lost, are
    traced ray by ray: the border of total reflection, the rim of a ball. Contact is looked up at every
    pixel's own mirror point.
    """

    def __init__(self, rig: Rig) -> None:
        """Lay out the rays. Raises InputError where the rig's rest surface cannot be used."""
        self._optics = Optics(rig)
        self._shape = rig.camera.rows, rig.camera.columns
        rows, cols = (-(-(size - 1) // SPACING_PX) + 1 + 2 * MARGIN for size in self._shape)
        v, u = np.mgrid[0:rows, 0:cols].astype(np.float64)
        self._nodes = self._optics.rubber_rays(SPACING_PX * (u - MARGIN), SPACING_PX * (v - MARGIN))

    def trace(self, mirror: Mirror) -> tuple[Float, Float]:
        """(q (rows, cols, 2) LCD px, NaN where lost; gain (rows, cols), reflectance with contact, 0 lost)."""
        surface = Dented(self._optics.rest, mirror) if mirror.dents else self._optics.rest
        traced = self._optics.trace_rays(*self._nodes, surface)
        place = traced.point[..., :2]
        nodes = np.concatenate([traced.q, traced.reflectance[..., None], place], axis=-1)
        field = np.empty((*self._shape, nodes.shape[-1]))
        _interpolate(nodes, SPACING_PX, MARGIN, field)
        coarse = _coarse_cells(nodes).repeat(SPACING_PX, axis=0).repeat(SPACING_PX, axis=1)
        exact = coarse[: self._shape[0], : self._shape[1]]
        if exact.any():
            v, u = np.nonzero(exact)
            traced = self._optics.trace(u.astype(np.float64), v.astype(np.float64), surface)
            field[exact] = np.concatenate(
                [traced.q, traced.reflectance[:, None], traced.point[:, :2]], axis=-1
            )
        q, gain = field[..., :2], field[..., 2]
        if any(dent.touches for dent in mirror.dents):
            gain = gain * mirror.reflectance_factor(field[..., 3], field[..., 4])
        return q, np.where(np.isnan(q[..., 0]) | np.isnan(gain), 0.0, gain)


def _coarse_cells(nodes: Float) -> Mask:
    """(cell rows, cell cols) cells of the view, from its first node on, whose cubics are not good enough.

    Judged at every node of the view by the cubic through its neighbours at odd distances, which is as far
    off as the cubic of a lattice twice as wide; a lost ray anywhere in its reach is not good enough either.
    """
    values = nodes[..., :3] * [1.0, 1.0, 100.0]
    error = np.zeros((nodes.shape[0] - 2 * MARGIN, nodes.shape[1] - 2 * MARGIN))
    for axis in (0, 1):
        moved = np.moveaxis(values, axis, 0)
        near, far = moved[2:-4] + moved[4:-2], moved[:-6] + moved[6:]
        along = np.moveaxis(np.abs(moved[3:-3] - (9.0 * near - far) / 16.0).max(axis=-1), 0, axis)
        error += along[:, MARGIN:-MARGIN] if axis == 0 else along[MARGIN:-MARGIN]
    poor = ~(error <= ORDER * TOLERANCE)
    cells: Mask = poor[:-1, :-1] | poor[1:, :-1] | poor[:-1, 1:] | poor[1:, 1:]
    return np.pad(cells, ((0, 1), (0, 1)), mode="edge")


@numba.njit(cache=True)
def _cubic(t: float) -> tuple[float, float, float, float]:
    """Weights at t, 0 <= t < 1, of the cubic through values at -1, 0, 1 and 2 (Lagrange)."""
    return (
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    )


@numba.njit(cache=True, nogil=True)
def _interpolate(nodes: Float, spacing: int, margin: int, out: Float) -> None:
    """Fill `out` (rows, cols, n) from `nodes`, whose node (margin, margin) lies at pixel (0, 0)."""
    count = nodes.shape[2]
    line = np.empty((nodes.shape[1], count))
    for row in range(out.shape[0]):
        j = row // spacing + margin
        a, b, c, d = _cubic((row % spacing) / spacing)
        for i in range(nodes.shape[1]):
            for k in range(count):
                line[i, k] = (
                    a * nodes[j - 1, i, k]
                    + b * nodes[j, i, k]
                    + c * nodes[j + 1, i, k]
                    + d * nodes[j + 2, i, k]
                )
        for col in range(out.shape[1]):
            i = col // spacing + margin
            a, b, c, d = _cubic((col % spacing) / spacing)
            for k in range(count):
                out[row, col, k] = (
                    a * line[i - 1, k] + b * line[i, k] + c * line[i + 1, k] + d * line[i + 2, k]
                )
