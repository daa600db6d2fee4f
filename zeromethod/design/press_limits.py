"""The deepest press of a kind and size that a picture can null: exact rays, the loop's own test of nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.design.lever import largest_curvature_per_mm, mirror_mm_per_px
from zeromethod.design.sampled_view import SampledView
from zeromethod.design.tir import critical_deg
from zeromethod.errors import InputError
from zeromethod.optics import Dented
from zeromethod.optics.mirror import normal_of
from zeromethod.simulation.loads import Form, load
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.validity import Flag

SHALLOWEST_MM, DEEPEST_MM = 1e-4, 5.0
"""Depths between which limits are looked for."""

_PRECISION = 0.03
_GROWTH = 3.0
_REACH = 3.0
"""How far from its middle a press is looked at, in sizes: by then its curvature is past its largest."""
_NOT_DRAWN = int(Flag.FOLDED | Flag.UNDRAWABLE | Flag.OFF_DISPLAY)
_KINDS = ("load", "gaussian", "ball", "cone", "edge")
_EDGE_LENGTHS = 5.0
_NEAR_MM = 1.0


@dataclass(frozen=True)
class PressKind:
    """A press without depth or place.

    size_mm: load width, Gaussian and edge sigma, ball radius, cone contact radius; all on a half-space.
    """

    shape: Shape | Form
    size_mm: float

    @classmethod
    def parse(cls, text: str) -> PressKind:
        """Kind of "load:2", ...; InputError, one line, where it is none."""
        shape, _, size = text.partition(":")
        try:
            size_mm = float(size)
        except ValueError:
            size_mm = np.nan
        if shape not in _KINDS or not 0.0 < size_mm < 1e4:
            allowed = "|".join(_KINDS)
            raise InputError(
                f"--press: {text!r}: {allowed}, a colon, a size in mm above 0, below 10000 (load:2)"
            )
        return cls(Form.LOAD if shape == Form.LOAD else Shape(shape), size_mm)

    def __str__(self) -> str:
        """E.g. "load:2"."""
        return f"{self.shape.value}:{self.size_mm:g}"

    def dent(self, x_mm: float, y_mm: float, depth_mm: float) -> Dent:
        """Press of that depth; an edge lies along y and is five sigmas long."""
        if isinstance(self.shape, Form):
            return load(x_mm, y_mm, depth_mm, self.size_mm)
        edge = self.shape is Shape.EDGE
        return Dent(
            self.shape, x_mm, y_mm, depth_mm, self.size_mm,
            length_mm=_EDGE_LENGTHS * self.size_mm if edge else 0.0, angle_deg=90.0 if edge else 0.0,
        )  # fmt: skip

    def reach_mm(self, depth_mm: float) -> float:
        """Distance from the middle within which the press bends the mirror most."""
        if self.shape is Shape.BALL:
            return _REACH * float(np.sqrt(self.size_mm * depth_mm))
        half_mm = _EDGE_LENGTHS / 2 * self.size_mm if self.shape is Shape.EDGE else 0.0
        return _REACH * self.size_mm + half_mm


DEFAULT_KINDS = tuple(
    PressKind.parse(kind) for kind in ("load:0.7", "load:1.4", "load:3.5", "ball:150", "cone:5", "edge:2")
)


@dataclass(frozen=True)
class PressLimit:
    """Depths in mm at one place, infinite where none up to DEEPEST_MM matters, 0 where lost at rest.

    fold_mm: where some node folds; nulled_mm: the deepest press that a picture nulls whole, and `because`
    what ends it; total_mm: up to which reflection is total everywhere.
    """

    fold_mm: float
    nulled_mm: float
    because: str
    total_mm: float


def press_limit(view: SampledView, kind: PressKind, x_mm: float, y_mm: float) -> PressLimit:
    """Limits of a press in the middle (x_mm, y_mm), to 3 %.

    Folded and undrawable are what `zeromethod.warp.warp_flags` calls so, at the rig's own nodes: a press
    whose bend is narrower than they are apart (the rim of a ball's contact) is judged as they see it. Light
    lost where a press touches is not counted.
    """
    size = view.rig.display.columns, view.rig.display.rows
    period, spacing = view.rig.target.period_px, view.grid.spacing_px
    at_rest = warp_flags(view.trace.q, view.trace.q, period, size, spacing_px=spacing)
    judged = view.on_lcd & (at_rest == 0)

    def flags_at(depth_mm: float) -> int:
        patch = _around(view, x_mm, y_mm, kind.reach_mm(depth_mm))
        dented = Dented(view.optics.rest, Mirror((kind.dent(x_mm, y_mm, depth_mm),)))
        q = view.optics.trace(view.u_px[patch], view.v_px[patch], dented).q
        flags = warp_flags(q, view.trace.q[patch], period, size, spacing_px=spacing)
        return int(np.bitwise_or.reduce(flags[judged[patch] & np.isfinite(q).all(axis=-1)], initial=0))

    here = _around(view, x_mm, y_mm, 0.0)
    if not judged[here].any():
        on_lcd = view.on_lcd[here]
        because = f"{_reason(int(at_rest[here][on_lcd].max()))} at rest" if on_lcd.any() else "not seen"
        return PressLimit(0.0, 0.0, because, 0.0)
    nulled_mm = _largest(lambda depth: not flags_at(depth) & _NOT_DRAWN, SHALLOWEST_MM)
    fold_mm = _largest(lambda depth: not flags_at(depth) & int(Flag.FOLDED), max(nulled_mm, SHALLOWEST_MM))
    because = _reason(flags_at(nulled_mm * (1 + _PRECISION))) if np.isfinite(nulled_mm) else ""
    return PressLimit(fold_mm, nulled_mm, because, _total_mm(view, kind, x_mm, y_mm, judged))


def nulled_mm(view: SampledView, limits: Sequence[Mapping[str, Any]]) -> Float:
    """Deepest press that can be nulled with its middle at each node, (rows, cols), mm, by a few places'.

    limits: `PressLimit` as dicts, with x_mm and y_mm of their places. Between them the limit goes with the
    node's own largest curvature; what is left, how the lever changes over the press, with the inverse squared
    distance. NaN where the node does not see the LCD or no place's limit is known.
    """
    curvature = largest_curvature_per_mm(view)
    weights, total = np.zeros(curvature.shape), np.zeros(curvature.shape)
    for limit in limits:
        away = np.hypot(view.x_mm - limit["x_mm"], view.y_mm - limit["y_mm"])
        if not (np.isfinite(away).any() and 0.0 < limit["nulled_mm"] < np.inf):
            continue
        here = curvature.ravel()[np.nanargmin(np.where(view.on_lcd, away, np.nan))]
        weight = 1.0 / (away**2 + _NEAR_MM**2)
        weights += weight
        total += weight * limit["nulled_mm"] / here
    with np.errstate(invalid="ignore", divide="ignore"):
        result: Float = curvature * total / weights
    return result


def _reason(flags: int) -> str:
    if flags & int(Flag.FOLDED):
        return "fold"
    return "LCD edge" if flags & int(Flag.OFF_DISPLAY) else "too fine for the LCD"


def _around(view: SampledView, x_mm: float, y_mm: float, reach_mm: float) -> tuple[slice, slice]:
    """Rows and columns of nodes that contain all mirror points within reach, two nodes more on every side."""
    spacing = view.grid.spacing_px * np.nan_to_num(mirror_mm_per_px(view))
    reach = np.maximum(spacing, reach_mm)
    with np.errstate(invalid="ignore"):
        near = (np.abs(view.x_mm - x_mm) < reach[..., 0]) & (np.abs(view.y_mm - y_mm) < reach[..., 1])
    if not near.any():
        return slice(0), slice(0)
    rows, columns = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
    return slice(max(rows[0] - 2, 0), rows[-1] + 3), slice(max(columns[0] - 2, 0), columns[-1] + 3)


def _largest(good: Callable[[float], bool], start_mm: float) -> float:
    """Largest depth up to which `good`, from start_mm on by steps, then by halving; inf, or 0 for none."""
    depth = start_mm
    if not good(depth):
        return 0.0
    while good(_GROWTH * depth):
        depth *= _GROWTH
        if depth > DEEPEST_MM:
            return np.inf
    low, high = depth, _GROWTH * depth
    while high > low * (1 + _PRECISION):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if good(middle) else (low, middle)
    return low


def _total_mm(view: SampledView, kind: PressKind, x_mm: float, y_mm: float, judged: Mask) -> float:
    """Depth up to which every judged node is beyond the critical angle, its mirror point fixed."""
    critical = np.cos(np.radians(critical_deg(view.rig)))

    def total(depth_mm: float) -> bool:
        patch = _around(view, x_mm, y_mm, kind.reach_mm(depth_mm))
        point = view.trace.point[patch][judged[patch]]
        direction = view.direction[patch][judged[patch]]
        zx, zy = view.optics.rest.gradient(point[..., 0], point[..., 1])
        dx, dy = Mirror((kind.dent(x_mm, y_mm, depth_mm),)).slope(point[..., 0], point[..., 1])
        cosine = np.einsum("ni,ni->n", direction, normal_of((zx - dx, zy - dy)))
        return bool((cosine <= critical).all())

    return _largest(total, SHALLOWEST_MM)
