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
_MOVES = 4
_NEAREST = 0.6
"""Offset from a window's middle beyond which the window moves; a little over half, or it could swing."""


@dataclass(frozen=True, slots=True)
class Peak:
    """Point of largest |depth|: signed depth, mirror position and depth's standard deviation, all in mm."""

    depth_mm: float
    x_mm: float
    y_mm: float
    sigma_mm: float


def peak(surface: Surface) -> Peak:
    """Find the point of largest |depth| among the valid nodes by a local polynomial fit.

    A quartic over 5x5 to 13x13 nodes, by the dent's width where it is narrowest (bias 0.02 % for a Gaussian
    of sigma 4 nodes, below 0.01 % from 6 on), about the node nearest to its own summit, which on a ridge is
    not the deepest; a quadratic over 5x5 where border or holes leave too few nodes; the deepest node itself
    where even these are missing or the summit lies outside the window. All NaN when nothing is valid.
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
    for _ in range(_MOVES):
        summit = _summit(surface, row, col)
        if summit is None:
            return at_node
        offset, value = summit
        if np.max(np.abs(offset)) <= _NEAREST:
            break
        row, col = row + round(float(offset[1])), col + round(float(offset[0]))
    depth_mm, x_mm, y_mm = (float(part) for part in value)
    return Peak(depth_mm, x_mm, y_mm, at_node.sigma_mm)


def _summit(surface: Surface, row: int, col: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Summit's (column, row) offset from a node, and depth, x and y there; None where there is none."""
    fitted = _fit(surface, row, col, _REACH, 2)
    if fitted is None:
        return None
    coefficients, powers = fitted
    by_power = dict(zip(powers, coefficients[:, 0], strict=True))
    middle, difference = by_power[2, 0] + by_power[0, 2], by_power[2, 0] - by_power[0, 2]
    # Of the narrower way across: an edge is as narrow as a pad of its width, however long.
    steepest = middle - np.sign(by_power[0, 0]) * np.hypot(difference, by_power[1, 1])
    curvature = -steepest / by_power[0, 0]
    reach = _MAX_REACH if curvature <= 0.0 else round(_REACH_PER_SIGMA / np.sqrt(curvature))
    reach = int(np.clip(reach, _REACH, _MAX_REACH))
    finer = _fit(surface, row, col, reach, 4)
    if finer is not None:
        coefficients, powers = finer
    offset = _stationary(coefficients[:, 0], powers, _REACH if finer is None else reach)
    if offset is None:
        return None
    value = (_terms(offset[:1], offset[1:], powers) @ coefficients)[0]
    return offset, np.asarray(value, dtype=np.float64)


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
    coefficients: NDArray[np.float64], powers: list[tuple[int, int]], within: float
) -> NDArray[np.float64] | None:
    """Point (a, b) of zero gradient, no farther than `within` on either axis, by Newton's steps from 0."""
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
        if np.max(np.abs(at)) > within:
            return None
        if np.max(np.abs(step)) < 1e-9:
            break
    return at
