"""Peak: the deepest point of a reading, between the nodes, and what holes in the reading may conceal."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from zeromethod.arrays import Float, Mask
from zeromethod.surface.chance import by_chance_mm
from zeromethod.surface.gaps import gaps_between
from zeromethod.surface.holes import deeper_inside_mm
from zeromethod.surface.node_passes import deepest_node
from zeromethod.surface.peak_place import place_sigma_mm
from zeromethod.surface.polynomials import polynomial, powers_of, stationary, terms, whole_window
from zeromethod.surface.surface import Surface, check_surface

_REACH, _MAX_REACH = 2, 6
"""Half widths of the smallest and the largest window, nodes."""
_REACH_PER_SIGMA = 0.35
"""Half width of the window over the dent's sigma, at most. Where that is less than `_REACH`, a spline is
used."""
_QUARTIC_BIAS, _HOLED = 0.005, 3.0
"""Relative bias of a quartic's summit over (half width / sigma)^6; its factor where a hole takes up to a
fifth of the window's nodes."""
_QUADRATIC_BIAS = 0.12
"""Relative bias of a quadratic's summit over (half width / sigma)^4: rms over Gaussians of sigma 1.5 to 8
nodes, 6 to 12 of 25 nodes missing."""
_NOTICED = 0.3
"""Change of the summit by a window one node smaller, over sigma, from which the larger one is too large."""
_SPLINE, _LEAST_SPLINE = 8, 4
"""Nodes on every side that a spline goes through, and fewest: its weights halve from node to node."""
_MIN_SHARE, _MIN_NODES = 0.8, 12
"""Share of a window's nodes that a quartic needs, and number that a quadratic needs (of 25)."""
_MOVES, _NEAREST = 4, 0.6
"""A window whose summit lies farther than this from its middle moves, so often at most; a little over half a
node, or it could oscillate."""
_SECTORS = 24
"""Directions around a summit in which gaps are looked for."""
_NOTICEABLE = 0.02
"""Step over a gap, relative to the peak, from which it counts as lying on the slope."""


_Fitted = tuple[Float, list[tuple[int, int]]]
"""Coefficients of a polynomial and their powers, see `_fit`."""


class Where(enum.StrEnum):
    """Whether a peak was seen, and what is next to it."""

    MEASURED = "measured"
    BESIDE = "beside a contact"
    INSIDE = "inside a contact"


@dataclass(frozen=True, slots=True, repr=False)
class Peak:
    """Point of largest |depth|.

    Attributes
    ----------
    depth_mm : float
        Signed depth, positive into the rubber.
    x_mm, y_mm : float
        Place on the mirror.
    sigma_mm : float
        Standard deviation of the depth, holes and what the geometry leaves open included.
    deeper_mm : float
        One-sided part of sigma_mm: how much deeper the mirror may be inside holes.
    sigma_x_mm, sigma_y_mm : float
        Standard deviation of the place; NaN where too few nodes are valid around it.
    where : Where
        Inside a contact nothing was measured: depth is carried in from around it. Beside one, the mirror goes
        deeper.
    """

    depth_mm: float
    x_mm: float
    y_mm: float
    sigma_mm: float
    deeper_mm: float = 0.0
    sigma_x_mm: float = math.nan
    sigma_y_mm: float = math.nan
    where: Where = Where.MEASURED

    @property
    def sigma_local_mm(self) -> float:
        """Standard deviation of the depth at this point, holes left out, mm."""
        return math.sqrt(max(self.sigma_mm**2 - self.deeper_mm**2, 0.0))

    def __repr__(self) -> str:
        at = f"x {self.x_mm:.3f}, y {self.y_mm:.3f} mm"
        at += "" if self.where is Where.MEASURED else f", {self.where}"
        return f"<Peak {self.depth_mm:.6g} mm, sigma {self.sigma_mm:.2g} mm, at {at}>"


def peak(surface: Surface) -> Peak:
    """Find the point of largest |depth| by a local polynomial fit.

    Parameters
    ----------
    surface : Surface
        The reading; nodes that a closed fold cuts off (`Surface.cut_off`) count with the valid ones.

    Returns
    -------
    Peak
        All NaN when nothing is valid.

    Notes
    -----
    A quartic over 5x5 to 13x13 nodes, by the dent's width where it is narrowest, about the node nearest to
    its own summit, which on a ridge is not the deepest; a quadratic over 5x5 where border or holes leave too
    few nodes; the deepest node itself where even these are missing or the summit lies outside the window.
    A dent of less than sigma 6 nodes is too narrow for a quartic (0.01 % at 4 nodes, 0.6 % at 2): there the
    summit is that of a quintic spline through the nodes around (bias below 0.01 % for a Gaussian of 2 nodes,
    0.2 % for a Lorentzian of 2.4), if they are all measured.

    Sigma is the node's, that of being the largest of many (`by_chance_mm`), that of the fit (half of what a
    cubic spline differs by; a quartic's or quadratic's bias for a Gaussian as narrow), that of gaps in the
    slope around the summit, and that of holes (`zeromethod.surface.holes`): what they may hide, as far as it
    is deeper than the peak. A contact takes the light away, so that a peak next to one is that of
    the measured nodes, with a sigma nearly as large as the contact is deep.
    """
    check_surface("peak", surface)
    if not surface.valid.any():
        return Peak(np.nan, np.nan, np.nan, np.nan)
    found, fitted = _deepest(surface)
    measured, sigma_mm = surface.valid, found.sigma_mm
    gap_mm = around_mm(surface, fitted, found.x_mm, found.y_mm, found.depth_mm)
    if surface.cut_off is not None:
        measured = measured | surface.cut_off.valid
        inside, fitted_inside = _deepest(surface.cut_off)
        if abs(inside.depth_mm) > abs(found.depth_mm):
            found, fitted, gap_mm = inside, fitted_inside, 0.0
            sigma_mm = found.sigma_mm
    deeper_mm = deeper_inside_mm(surface, measured, fitted, found.depth_mm)
    chance_mm = by_chance_mm(found.depth_mm, sigma_mm, int(np.count_nonzero(measured)))
    sigma_mm = math.hypot(sigma_mm, gap_mm, deeper_mm, chance_mm)
    return replace(found, sigma_mm=sigma_mm, deeper_mm=deeper_mm)


def _deepest(surface: Surface) -> tuple[Peak, Mask]:
    """Peak of the valid nodes alone, and the window (rows, cols) of its fit."""
    row, col = node = deepest_node(surface.depth_mm, surface.valid)
    sigma_mm = float(surface.sigma_depth_mm[node])
    window = np.zeros(surface.valid.shape, bool)
    summit = _summit(surface, row, col)
    for _ in range(_MOVES - 1):
        if summit is None or np.max(np.abs(summit.offset)) <= _NEAREST:
            break
        row, col = row + round(float(summit.offset[1])), col + round(float(summit.offset[0]))
        summit = _summit(surface, row, col)
    if summit is None:
        depth_mm, x_mm, y_mm = (float(field[node]) for field in _fields(surface))
        return Peak(depth_mm, x_mm, y_mm, sigma_mm, 0.0, *place_sigma_mm(surface, *node)), window
    reach = summit.reach
    window[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1] = True
    depth_mm, x_mm, y_mm = (float(part) for part in summit.value)
    sigma_mm = math.hypot(sigma_mm, summit.model_mm)
    return Peak(depth_mm, x_mm, y_mm, sigma_mm, 0.0, *place_sigma_mm(surface, row, col)), window


@dataclass(frozen=True, slots=True)
class _Summit:
    """Summit near a node.

    offset: (column, row) from the node. value: depth, x and y there, mm. reach: the window's half width.
    model_mm: standard deviation of depth because the fitted function is not the dent's.
    """

    offset: Float
    value: Float
    reach: int
    model_mm: float


def _summit(surface: Surface, row: int, col: int) -> _Summit | None:
    """Summit near a node; None where there is none."""
    fitted = _fit(surface, row, col, _REACH, 2)
    if fitted is None:
        return None
    coefficients, powers = fitted
    by_power = dict(zip(powers, coefficients[:, 0], strict=True))
    middle, difference = by_power[2, 0] + by_power[0, 2], by_power[2, 0] - by_power[0, 2]
    # along the narrower axis: an edge is as narrow as a pad of its width, however long
    steepest = middle - np.sign(by_power[0, 0]) * np.hypot(difference, by_power[1, 1])
    # 1 / sigma^2 of the dent, in nodes
    curvature = max(-steepest / by_power[0, 0], 0.0)
    widest = _MAX_REACH if curvature == 0.0 else int(_REACH_PER_SIGMA / math.sqrt(curvature))
    reach = min(max(widest, _REACH), _MAX_REACH)
    finer = _fit(surface, row, col, reach, 4)
    flat_mm = 0.0
    if finer is not None:
        reach, finer, flat_mm = _as_flat(surface, row, col, reach, finer)
        coefficients, powers = finer
    else:
        reach = _REACH
    of_depth = coefficients[:, 0].tolist(), powers
    offset = stationary(lambda *place: polynomial(*of_depth, *place), np.zeros(2), reach, 1e-9)
    if offset is None:
        return None
    value = np.asarray((terms(offset[:1], offset[1:], powers) @ coefficients)[0], dtype=np.float64)
    if widest < _REACH and np.max(np.abs(offset)) <= _NEAREST:
        splined = _splined(surface, row, col, offset)
        if splined is not None:
            return splined
    steep = reach * reach * curvature
    bias = _QUADRATIC_BIAS * steep**2 if finer is None else _QUARTIC_BIAS * steep**3
    part = slice(max(row - reach, 0), row + reach + 1), slice(max(col - reach, 0), col + reach + 1)
    if finer is not None and not surface.valid[part].all():
        bias *= _HOLED
    return _Summit(offset, value, reach, math.hypot(bias * abs(float(value[0])), flat_mm))


def _as_flat(surface: Surface, row: int, col: int, reach: int, fitted: _Fitted) -> tuple[int, _Fitted, float]:
    """Largest window whose quartic a smaller one confirms; its fit, and the difference of the two, mm.

    For a pad's flat bottom: it has no curvature that says how wide the window may be, and its edge is no
    quartic.
    """
    noticed_mm = _NOTICED * float(surface.sigma_depth_mm[row, col])
    while reach > _REACH:
        closer = _fit(surface, row, col, reach - 1, 4)
        if closer is None:
            break
        differ_mm = abs(float(fitted[0][0, 0] - closer[0][0, 0]))
        if differ_mm < noticed_mm:
            return reach, fitted, differ_mm
        reach, fitted = reach - 1, closer
    return reach, fitted, 0.0


def _splined(surface: Surface, row: int, col: int, start: Float) -> _Summit | None:
    """Summit of a quintic spline near a node and an offset; None where too few nodes around are valid."""
    rows, cols = surface.valid.shape
    size = min(_SPLINE, row, col, rows - 1 - row, cols - 1 - col)
    while size >= _LEAST_SPLINE:
        part = slice(row - size, row + size + 1), slice(col - size, col + size + 1)
        if surface.valid[part].all():
            break
        size -= 1
    else:
        return None
    knots = np.arange(-size, size + 1.0)
    x, y, depth, rough = (
        scipy.interpolate.RectBivariateSpline(knots, knots, field[part], kx=degree, ky=degree)
        for field, degree in (
            (surface.x_mm, 3),
            (surface.y_mm, 3),
            (surface.depth_mm, 5),
            (surface.depth_mm, 3),
        )
    )
    at = stationary(
        lambda at, across, down: float(depth(at[1], at[0], dx=down, dy=across)[0, 0]), start, _REACH, 1e-6
    )
    if at is None:
        return None
    value = np.array([float(spline(at[1], at[0])[0, 0]) for spline in (depth, x, y)])
    return _Summit(at, value, _REACH, 0.5 * abs(float(rough(at[1], at[0])[0, 0]) - float(value[0])))


def _fit(surface: Surface, row: int, col: int, reach: int, degree: int) -> _Fitted | None:
    """Coefficients (terms, 3) of depth, x and y over (column, row) offsets, and their powers.

    None where fewer than `_MIN_SHARE` (quartic) or `_MIN_NODES` (quadratic) of the window are valid.
    """
    rows = slice(max(row - reach, 0), row + reach + 1)
    cols = slice(max(col - reach, 0), col + reach + 1)
    known = surface.valid[rows, cols]
    needed = _MIN_NODES if degree == 2 else _MIN_SHARE * (2 * reach + 1) ** 2
    if np.count_nonzero(known) < needed:
        return None
    uneven = surface.seam is not None and bool(surface.seam[rows, cols].any())
    if not uneven and known.all() and known.size == (2 * reach + 1) ** 2:
        values = np.stack([field[rows, cols].ravel() for field in _fields(surface)], axis=-1)
        return whole_window(reach, degree) @ values, powers_of(degree)
    r, c = np.nonzero(known)
    b, a = (r + rows.start - row).astype(np.float64), (c + cols.start - col).astype(np.float64)
    if uneven:
        # nodes at a saw's seams are no even lattice on the mirror, and depth over their number no polynomial
        across, down = surface.x_mm[rows, cols], surface.y_mm[rows, cols]
        a = (across[known] - surface.x_mm[row, col]) / np.nanmedian(np.diff(across, axis=1))
        b = (down[known] - surface.y_mm[row, col]) / np.nanmedian(np.diff(down, axis=0))
    values = np.stack([field[rows, cols][known] for field in _fields(surface)], axis=-1)
    powers = powers_of(degree)
    solution = np.linalg.lstsq(terms(a, b, powers), values, rcond=None)[0]
    return np.asarray(solution, dtype=np.float64), powers


def _fields(surface: Surface) -> tuple[Float, Float, Float]:
    return surface.depth_mm, surface.x_mm, surface.y_mm


def around_mm(surface: Surface, fitted: Mask, x_mm: float, y_mm: float, depth_mm: float) -> float:
    """Standard deviation that gaps in the slopes around a summit add to its depth, mm.

    Where a fold surrounds the summit except for an opening, depth is known through the opening alone, past
    nodes that are bent as much as those lost. So every direction that has a gap counts with that gap's sigma.
    fitted: (rows, cols) nodes of the summit's own fit, between which gaps do no harm.
    """
    if not (surface.on_mirror & ~surface.valid).any():
        return 0.0
    gaps = gaps_between(surface.valid, surface.valid)
    if not len(gaps):
        return 0.0
    point = np.stack([surface.x_mm, surface.y_mm], axis=-1)
    step, spread = gaps.steps(surface.slope, point)
    on_slope = (np.abs(step) > _NOTICEABLE * abs(depth_mm)) & ~(fitted[gaps.near] & fitted[gaps.far])
    middle = 0.5 * (point[gaps.near] + point[gaps.far]) - (x_mm, y_mm)
    angle = np.arctan2(middle[:, 1], middle[:, 0]) / (2 * np.pi) + 0.5
    sector = np.minimum((_SECTORS * angle).astype(np.intp), _SECTORS - 1)[on_slope]
    count = np.bincount(sector, minlength=_SECTORS)
    total = np.bincount(sector, spread[on_slope] ** 2, minlength=_SECTORS)
    return float(np.mean(np.sqrt(total / np.maximum(count, 1))))
