"""Dents of pressures that are sums of one Gaussian load, on a half-space or a layer, as tables and maps.

Here lengths are in widths l of the load, exp(-r^2 / 2 l^2), and depths in the depth that a load of the same
force F has in the middle on a half-space, F / (sqrt(2 pi) l E*), E* = E / (1 - nu^2).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.ndimage import spline_filter
from scipy.special import i0e, i1e, j0, j1

from zeromethod.arrays import Float
from zeromethod.simulation.contact.compliance import layer_factor
from zeromethod.simulation.press import Shape
from zeromethod.simulation.shapes import radial
from zeromethod.simulation.spline import evaluate_line, line_coefficients

_TABLE_PITCH = 1 / 64
"""Of tables where they are widest: cubic splines leave (1/64)^4 / 384 of the fourth derivative, 1e-9."""
_BASE_PITCH = 1 / 8
"""Of tables about a layer's thickness from the middle, in thicknesses: some 1e-6 of the depth is left."""
_DENSE = 2**16
"""Steps of u from 0 to 1 of a table between which a straight line does."""
_MAP_PITCH = 1 / 8
"""Of maps about the loads, and over the distance far from them: splines leave 6e-5 of the steepest slope."""
_BASE_WAVES = 30.0
"""Wave number x thickness beyond which a layer yields as a half-space does: exp(-60) is left."""
_LOAD_WAVES = 9.0
"""Wave number x width beyond which a load has none: exp(-40) is left."""
_BASE_FAR = 30.0
"""Distance over thickness beyond which the base takes all: nothing of 1e-12 is left."""
_FARTHEST = 1e-3
"""u of the table's first place, which stands for 0: there D is off by u^2."""


@dataclass(frozen=True)
class Base:
    """What a layer lies on: its thickness in widths."""

    thickness: float
    poisson: float
    bonded: bool


@dataclass(frozen=True)
class Pieces:
    """Loads (n,) of one width at places (x, y), their shares of the force, which add up to 1."""

    x: Float
    y: Float
    share: Float

    @classmethod
    def circle(cls, radius: float) -> Pieces:
        """Evenly along a circle: one 0.75 widths from the next leaves exp(-(2 pi / 0.75)^2 / 2) = 1e-15."""
        count = int(np.ceil(2 * np.pi * radius / 0.75)) + 16
        angle = 2 * np.pi * np.arange(count) / count
        return cls(radius * np.cos(angle), radius * np.sin(angle), np.full(count, 1 / count))

    @classmethod
    def line(cls, length: float) -> Pieces:
        """Evenly along a line, by Gauss-Legendre's places, at least one a width."""
        at, weight = np.polynomial.legendre.leggauss(int(np.ceil(length)) + 8)
        return cls(0.5 * length * at, np.zeros(len(at)), 0.5 * weight)

    @classmethod
    def strewn(cls, radius: float, seed: int) -> Pieces:
        """At random over a disc, as many as widths squared fit into it by pi, of any force."""
        draw = np.random.default_rng(seed)
        count = max(3, round(radius**2))
        away, angle, force = (draw.uniform(0, most, count) for most in (1.0, 2 * np.pi, 1.0))
        away = radius * np.sqrt(away)
        return cls(away * np.cos(angle), away * np.sin(angle), force / force.sum())


@dataclass(frozen=True, eq=False)
class UnitDent:
    """A dent 1 deep where it is deepest.

    shape, size, coefficients: as `zeromethod.simulation.press.Dent` has them, size in widths. peak: its depth
    under the force. deepest: (2, k) places where it is reached. pieces: the loads.
    """

    shape: Shape
    size: float
    coefficients: Float = field(repr=False)
    peak: float
    deepest: Float = field(repr=False)
    pieces: Pieces = field(repr=False)


def load_field(r: Float, base: Base | None) -> tuple[Float, Float]:
    """(depth, slope over r) of one load at distances from its middle; base: None for a half-space.

    Source of the half-space: Hankel transform of the pressure, exp(-u) I0(u) with u = r^2 / 4.
    """
    u = 0.25 * r**2
    depth, over_r = i0e(u), 0.5 * (i1e(u) - i0e(u))
    if base is None:
        return depth, over_r
    reach = _BASE_FAR * max(base.thickness, 1.0)
    near = r < reach
    waves, lacks = _lacks(base)
    phase = np.outer(r[near], waves)
    # J1(x) / x, whose limit at 0 is a half
    by_phase = np.divide(j1(phase), phase, out=np.full_like(phase, 0.5), where=phase > 0)
    depth, over_r = depth * near, over_r * near
    depth[near] += j0(phase) @ lacks
    over_r[near] -= by_phase @ (lacks * waves**2)
    return depth, over_r


@lru_cache(8)
def _lacks(base: Base) -> tuple[Float, Float]:
    """Waves, and what a layer's answer to each lacks to a half-space's, for one load; times their weights."""
    most = min(_BASE_WAVES / base.thickness, _LOAD_WAVES)
    nodes, weights = np.polynomial.legendre.leggauss(30)
    panels = 60  # of at most 900 / 60 = 15 rad at the reach, which 30 nodes have to 1e-14
    waves = (most / panels * (np.arange(panels)[:, None] + 0.5 * (nodes + 1))).ravel()
    lacks = layer_factor(waves * base.thickness, base.poisson, bonded=base.bonded) - 1
    lacks *= np.sqrt(2 / np.pi) * np.exp(-0.5 * waves**2) * np.tile(0.5 * most / panels * weights, panels)
    return waves, lacks


@lru_cache(32)
def _load_table(base: Base | None) -> tuple[float, Float]:
    """(size, table) of one load as `zeromethod.simulation.shapes.radial` takes them."""
    size = float(np.sqrt(2))  # the curvature in the middle is then all in u
    u, r = _table_places(size, base)
    return size, _table(u, size, *load_field(r, base))


def _table_places(size: float, base: Base | None) -> tuple[Float, Float]:
    """(u, r) of a table's places: some for what changes over a width, some for what does over a thickness."""
    count = size / _TABLE_PITCH + (0 if base is None else base.thickness / _BASE_PITCH)
    u = np.linspace(0, 1, int(np.ceil(count)) + 1)
    u[0] = _FARTHEST
    return u, size * np.sqrt(np.maximum(u**-2.0 - 1, 0.0))


def _table(u: Float, size: float, depth: Float, over_r: Float) -> Float:
    return line_coefficients(np.stack((depth / u, size**2 * over_r / u**3), axis=1)).T


def field_of(pieces: Pieces, base: Base | None, x: Float, y: Float) -> tuple[Float, Float]:
    """(depth, slope along x) of all loads at places (x, y)."""
    size, table = _load_table(base)
    depth, by_x = np.zeros((2, *np.broadcast_shapes(x.shape, y.shape)))
    for at_x, at_y, share in zip(pieces.x, pieces.y, pieces.share, strict=True):
        more, more_by_x, _ = radial(x - at_x, y - at_y, share, size, table)
        depth, by_x = depth + more, by_x + more_by_x
    return depth, by_x


@lru_cache(8)
def _dense_depths(base: Base | None) -> tuple[float, Float]:
    """(size, depths of one load at even steps of u, between which a straight line leaves 1e-8)."""
    size, table = _load_table(base)
    u = np.linspace(0, 1, _DENSE + 1)
    return size, u * evaluate_line(table[:1], u * (table.shape[1] - 3))[0]


def depth_of(pieces: Pieces, base: Base | None, x: Float, y: Float) -> Float:
    """Depth alone, for many places."""
    size, dense = _dense_depths(base)
    steps = np.diff(dense, append=dense[-1])
    depth = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    for at_x, at_y, share in zip(pieces.x, pieces.y, pieces.share, strict=True):
        at = _DENSE / np.sqrt((1 + ((x - at_x) / size) ** 2) + ((y - at_y) / size) ** 2)
        cell = at.astype(np.int32)
        depth += share * (dense[cell] + (at - cell) * steps[cell])
    return depth


@lru_cache(32)
def ring_dent(radius: float, base: Base | None) -> UnitDent:
    """That of loads along a circle; of one load for radius 0."""
    if radius == 0:
        one = Pieces(np.zeros(1), np.zeros(1), np.ones(1))
        size, table = _load_table(base)
        return _round(one, size, table)
    pieces, size = Pieces.circle(radius), float(np.hypot(np.sqrt(2), radius))
    u, r = _table_places(size, base)
    r = np.maximum(r, 1e-3)  # slope over r has its limit there to 1e-6
    depth, by_r = field_of(pieces, base, r, np.zeros(1))
    return _round(pieces, size, _table(u, size, depth, by_r / r))


def _round(pieces: Pieces, size: float, table: Float) -> UnitDent:
    reach = np.linspace(0.0, pieces.x.max() + 3.0, 1 + round(64 * (pieces.x.max() + 3.0)))
    depth = radial(reach, np.zeros(1), 1.0, size, table)[0]
    deepest, peak = float(reach[depth.argmax()]), float(depth.max())
    angle = 2 * np.pi * np.arange(12 if deepest else 1) / 12
    places = deepest * np.stack((np.cos(angle), np.sin(angle)))
    return UnitDent(Shape.RADIAL, size, table / peak, peak, places, pieces)


def rod_dent(length: float, reach: float, base: Base | None) -> UnitDent:
    """That of loads along a line in x. reach: how far the map is to be dense enough."""
    return _spread(("line", length), reach, base)


def rough_dent(radius: float, seed: int, reach: float, base: Base | None) -> UnitDent:
    """That of loads strewn over a disc."""
    return _spread(("strewn", radius, seed), reach, base)


@lru_cache(32)
def _spread(of: tuple[str, float] | tuple[str, float, int], reach: float, base: Base | None) -> UnitDent:
    pieces = Pieces.line(of[1]) if len(of) == 2 else Pieces.strewn(of[1], of[2])
    half = 0.5 * of[1] if len(of) == 2 else of[1]
    # a pitch that grows to 1/8 of the distance at the reach, and is 1/8 of a width at the outermost load
    size = max(reach ** (2 / 3), 1.5 * half)
    pitch = _MAP_PITCH / (1 + (half / size) ** 2) ** 1.5
    w = np.linspace(-1, 1, 2 * int(np.ceil(size / pitch)) + 1)
    w[[0, -1]] *= 1 - 1e-9
    at = size * w / np.sqrt(1 - w**2)
    depth = depth_of(pieces, base, at, at[:, None])
    row, col = np.unravel_index(depth.argmax(), depth.shape)
    # the deepest place between the samples, to a twentieth of their pitch
    near = np.linspace(-pitch, pitch, 41)
    fine = depth_of(pieces, base, at[col] + near, (at[row] + near)[:, None])
    down, right = np.unravel_index(fine.argmax(), fine.shape)
    deepest = np.array([[at[col] + near[right]], [at[row] + near[down]]])
    peak = float(fine.max())
    coefficients = spline_filter(depth / peak, order=3, mode="mirror")
    return UnitDent(Shape.WHOLE_PLANE, size, coefficients, peak, deepest, pieces)
