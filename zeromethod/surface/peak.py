"""The deepest point of a reading, between the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zeromethod.surface.surface import Surface

_REACH = 2
_MAX_REACH = 6
_REACH_PER_SIGMA = 0.35
"""Half width of the window over the dent's width: a quartic's bias grows with its sixth power."""
_MIN_SHARE = 0.8
_MIN_NODES = 12
_STEPS = 8


@dataclass(frozen=True, slots=True)
class Peak:
    """Point of largest |depth|: signed depth, mirror position and depth's standard deviation, all in mm."""

    depth_mm: float
    x_mm: float
    y_mm: float
    sigma_mm: float


def peak(surface: Surface) -> Peak:
    """Find the point of largest |depth| among the valid nodes by a local polynomial fit.

    A quartic over 5x5 to 13x13 nodes, by the dent's width (bias 0.02 % for a Gaussian of sigma 4 nodes, below
    0.01 % from 6 on); a quadratic over 5x5 where border or holes leave too few nodes; the node itself where
    even these are missing or the fit's summit lies more than one node away. All NaN when nothing is valid.
    """
    depth = np.where(surface.valid, surface.depth_mm, np.nan)
    if not surface.valid.any():
        return Peak(np.nan, np.nan, np.nan, np.nan)
    row, col = (int(k) for k in np.unravel_index(int(np.nanargmax(np.abs(depth))), depth.shape))
    at_node = Peak(
        float(depth[row, col]),
        float(surface.x_mm[row, col]),
        float(surface.y_mm[row, col]),
        float(surface.sigma_depth_mm[row, col]),
    )
    fitted = _fit(surface, row, col, _REACH, 2)
    if fitted is None:
        return at_node
    coefficients, powers = fitted
    by_power = dict(zip(powers, coefficients[:, 0], strict=True))
    curvature = -(by_power[2, 0] + by_power[0, 2]) / by_power[0, 0]
    reach = _MAX_REACH if curvature <= 0.0 else round(_REACH_PER_SIGMA / np.sqrt(curvature))
    finer = _fit(surface, row, col, int(np.clip(reach, _REACH, _MAX_REACH)), 4)
    if finer is not None:
        coefficients, powers = finer
    summit = _stationary(coefficients[:, 0], powers)
    if summit is None:
        return at_node
    value, x, y = (_terms(summit[:1], summit[1:], powers) @ coefficients)[0]
    return Peak(float(value), float(x), float(y), at_node.sigma_mm)


def _fit(
    surface: Surface, row: int, col: int, reach: int, degree: int
) -> tuple[NDArray[np.float64], list[tuple[int, int]]] | None:
    """Coefficients (terms, 3) of depth, x and y over (column, row) offsets, and their powers.

    None where fewer than `_MIN_SHARE` (quartic) or `_MIN_NODES` (quadratic) of the window are valid.
    """
    rows = slice(max(row - reach, 0), row + reach + 1)
    cols = slice(max(col - reach, 0), col + reach + 1)
    known = surface.valid[rows, cols]
    needed = _MIN_NODES if degree == 2 else _MIN_SHARE * (2 * reach + 1) ** 2
    if np.count_nonzero(known) < needed:
        return None
    r, c = np.nonzero(known)
    b, a = (r + rows.start - row).astype(np.float64), (c + cols.start - col).astype(np.float64)
    powers = _powers(degree)
    fields = (surface.depth_mm, surface.x_mm, surface.y_mm)
    values = np.stack([field[rows, cols][known] for field in fields], axis=-1)
    solution = np.linalg.lstsq(_terms(a, b, powers), values, rcond=None)[0]
    return np.asarray(solution, dtype=np.float64), powers


def _powers(degree: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]


def _terms(
    a: NDArray[np.float64], b: NDArray[np.float64], powers: list[tuple[int, int]], da: int = 0, db: int = 0
) -> NDArray[np.float64]:
    """Columns a^i b^j, differentiated da times by a and db times by b."""
    columns = []
    for i, j in powers:
        factor = float(np.prod(np.arange(i - da + 1, i + 1)) * np.prod(np.arange(j - db + 1, j + 1)))
        columns.append(factor * a ** max(i - da, 0) * b ** max(j - db, 0))
    return np.stack(columns, axis=-1)


def _stationary(
    coefficients: NDArray[np.float64], powers: list[tuple[int, int]]
) -> NDArray[np.float64] | None:
    """Point (a, b) of zero gradient within one node of the origin, by Newton's steps from there."""
    at = np.zeros(2)
    for _ in range(_STEPS):
        a, b = at[:1], at[1:]
        d10, d01, d20, d11, d02 = (
            float((_terms(a, b, powers, *order) @ coefficients)[0])
            for order in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        )
        determinant = d20 * d02 - d11 * d11
        if determinant <= 0.0:
            return None
        step = np.array([d02 * d10 - d11 * d01, d20 * d01 - d11 * d10]) / determinant
        at = at - step
        if np.max(np.abs(at)) > 1.0:
            return None
        if np.max(np.abs(step)) < 1e-9:
            break
    return at
