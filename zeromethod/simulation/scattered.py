"""Depths at scattered points of the mirror as a smooth map on a regular lattice, fading to rest around them.

The map is a cubic B-spline of one pitch on both axes, as a dent of shape "map" has it, so that every renderer
draws it. Its coefficients c minimise |B c - d|^2 + `STIFFNESS` |second differences of c|^2: a plate that
bends least where there are no points. The three outermost rings of coefficients are 0, which takes value,
slope and curvature to 0 at the lattice's border.
"""

from __future__ import annotations

import numpy as np
import scipy
from scipy.sparse import csr_array, diags_array, eye_array, kron

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.simulation.spline import evaluate_spline, spline_weights

STIFFNESS = 1e-3
"""Small compared with the points, whose own square is about 1 per coefficient; `REFINEMENTS` gives back what
it still takes off."""

REFINEMENTS = 3
"""Times that the misfit at the points is fitted, too. It also moves points to where they are: the matrix is
that of the points given first, from which a press moves them by its depth, a fraction of a pitch."""

FADE_PITCHES = 24
"""Width of the border in which the map fades to rest."""

_RINGS = 3


class ScatteredMap:
    """Fits maps to depths at points that hardly move; one factorisation serves all of them.

    pitch_mm: of the lattice. centre_mm: (x, y) of its middle.
    """

    def __init__(self, x_mm: Float, y_mm: Float, pitch_mm: float) -> None:
        """x_mm, y_mm: (n,) finite points, mm, near which depths will be given. InputError for n < 16."""
        if x_mm.size < 16:
            raise InputError(f"mirror: {x_mm.size} points with a depth: at least 16 make a map")
        self.pitch_mm = pitch_mm
        low = np.array([y_mm.min(), x_mm.min()])
        high = np.array([y_mm.max(), x_mm.max()])
        rows, cols = np.ceil((high - low) / pitch_mm).astype(int) + 1 + 2 * (FADE_PITCHES + _RINGS)
        self._shape = int(rows), int(cols)
        self.centre_mm = float(0.5 * (low[1] + high[1])), float(0.5 * (low[0] + high[0]))
        self._free = np.zeros(self._shape, dtype=np.bool_)
        self._free[_RINGS:-_RINGS, _RINGS:-_RINGS] = True
        basis = self._basis(x_mm, y_mm)
        self._back = basis.T.tocsr()
        normal = self._back @ basis + STIFFNESS * self._bending()
        self._solver = scipy.sparse.linalg.splu(
            normal.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )

    def fit(self, x_mm: Float, y_mm: Float, depth_mm: Float) -> Float:
        """Coefficients (rows, cols) of the map that has depths (n,) at points (n,) near those given first."""
        coefficients = np.zeros(self._shape)
        misfit = depth_mm
        row, col = self._place(x_mm, y_mm)
        for _ in range(1 + REFINEMENTS):
            coefficients[self._free] += self._solver.solve(self._back @ misfit)
            misfit = depth_mm - evaluate_spline(coefficients, row, col)[0]
        return coefficients

    def _place(self, x_mm: Float, y_mm: Float) -> tuple[Float, Float]:
        """(row, col) coordinates of coefficients."""
        rows, cols = self._shape
        x0, y0 = self.centre_mm
        return (y_mm - y0) / self.pitch_mm + (rows - 1) / 2, (x_mm - x0) / self.pitch_mm + (cols - 1) / 2

    def _basis(self, x_mm: Float, y_mm: Float) -> csr_array:
        """(n, free) value of each free coefficient's spline at each point."""
        row, col = self._place(x_mm, y_mm)
        i, j = np.floor(row).astype(np.intp), np.floor(col).astype(np.intp)
        weights = spline_weights(row - i)[0][:, :, None] * spline_weights(col - j)[0][:, None, :]
        offsets = np.arange(-1, 3)
        flat = (i[:, None] + offsets)[:, :, None] * self._shape[1] + (j[:, None] + offsets)[:, None, :]
        point = np.broadcast_to(np.arange(row.size)[:, None, None], flat.shape)
        whole = csr_array((weights.ravel(), (point.ravel(), flat.ravel())), shape=(row.size, self._free.size))
        return whole[:, np.flatnonzero(self._free)]

    def _bending(self) -> csr_array:
        """(free, free) quadratic form: squares of second differences, the mixed ones twice, all borders 0."""
        rows, cols = (int(n) - 2 * _RINGS for n in self._shape)
        by_row, by_col = _second(rows), _second(cols)
        step_row, step_col = _first(rows), _first(cols)
        form = kron(by_row.T @ by_row, eye_array(cols)) + kron(eye_array(rows), by_col.T @ by_col)
        return csr_array(form + 2 * kron(step_row.T @ step_row, step_col.T @ step_col))


def _first(n: int) -> csr_array:
    """(n + 1, n) differences of neighbours, zeros beyond both ends."""
    return csr_array(diags_array([np.ones(n), -np.ones(n)], offsets=[0, -1], shape=(n + 1, n)))


def _second(n: int) -> csr_array:
    """(n + 2, n) second differences, zeros beyond both ends."""
    ones = np.ones(n)
    return csr_array(diags_array([ones, -2 * ones, ones], offsets=[0, -1, -2], shape=(n + 2, n)))
