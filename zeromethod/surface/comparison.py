"""A reading compared with the true mirror, where that is known: on simulated benches.

Only reports look at the truth; nothing here feeds back into the loop or the reading.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.devices.protocols import TouchedMirror, TrueContact, TrueMirror
from zeromethod.optics import Dented, Optics
from zeromethod.surface import Peak, Surface, Where, peak
from zeromethod.warp.grid import NodeGrid


class _AtRest:
    def depth(self, x: Float, y: Float) -> Float:
        return np.zeros(np.broadcast_shapes(x.shape, y.shape))

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        return self.depth(x, y), self.depth(x, y)

    def reflectance_factor(self, x: Float, y: Float) -> Float:
        return 1.0 + self.depth(x, y)


AT_REST: TrueMirror = _AtRest()
"""A mirror that nothing presses."""

TruthSource = Callable[[int], TrueMirror]
"""Mirror at a time in ns."""


@dataclass(frozen=True)
class Comparison:
    """One frame's reading against the truth at its mid-exposure, over usable nodes.

    The true peak is the deepest usable point, read or not: a press that was missed is an error of the peak.
    The error of a peak inside a contact is that against depth_deepest_mm.
    All errors are NaN where no usable node was read.
    depth_deepest_mm: true depth where |depth| is largest, in a contact too, where nothing can be read.
    depth_peak_error_sigma_percent: stated sigma of the peak over the same true depth as its error.
    contacts: what truly touches, where the truth knows.
    """

    depth_peak_mm: float
    depth_peak_error_percent: float
    depth_rms_error_um: float
    slope_rms_error_mrad: float
    usable_share: float
    valid_share: float
    depth_deepest_mm: float = float("nan")
    depth_peak_error_sigma_percent: float = float("nan")
    contacts: tuple[TrueContact, ...] = ()


TOTAL = 1 - 1e-9
"""Reflectance from which reflection counts as total."""

LIT_SHARE = 0.3
"""Share of its reflectance at rest that makes a node usable where it is below the critical angle at rest:
what a loop that allows for Fresnel can read."""


def usable_nodes(optics: Optics, grid: NodeGrid, truth: TrueMirror) -> Mask:
    """(rows, cols) nodes whose true ray is reflected and lands a carrier period inside the LCD.

    Reflected: totally, where the mirror at rest reflects totally; else at least LIT_SHARE of what it does
    at rest (the paper's 45 degrees lie below the critical angle everywhere).
    """
    u, v = grid.mesh()
    trace = optics.trace(u, v, Dented(optics.rest, truth))
    whole = trace.reaches_display & (np.nan_to_num(trace.reflectance) > TOTAL)
    dim = trace.reaches_display & ~whole
    at_rest = optics.trace(u[dim], v[dim], optics.rest).reflectance
    whole[dim] = (at_rest <= TOTAL) & (trace.reflectance[dim] >= LIT_SHARE * at_rest)
    x, y = trace.point[..., 0], trace.point[..., 1]
    touched = np.zeros_like(whole)
    touched[whole] = truth.reflectance_factor(x[whole], y[whole]) < 1
    stretch = np.linalg.norm(np.gradient(trace.q, grid.spacing_px, axis=(0, 1)), axis=-1).max(axis=0)
    margin = grid.period_px * np.nan_to_num(stretch, nan=np.inf)
    size = np.array([optics.rig.display.columns, optics.rig.display.rows])
    with np.errstate(invalid="ignore"):
        inside = np.all((trace.q >= margin[..., None]) & (trace.q <= size - 1 - margin[..., None]), axis=-1)
    return np.asarray(whole & ~touched & inside & grid.measurable)


def true_peak_mm(truth: TrueMirror, x: Float, y: Float, *, touched: bool = False) -> float:
    """Deepest true depth near the points (x, y), refined between them to 1e-6 of itself.

    touched: also where something touches; else off any touch.
    """

    def untouched_depth(x: Float, y: Float) -> Float:
        depth = truth.depth(x, y)
        return depth if touched else np.where(truth.reflectance_factor(x, y) < 1, 0.0, depth)

    depth = untouched_depth(x, y)
    at = int(np.argmax(np.abs(depth)))
    x0, y0, best = x[at], y[at], float(depth[at])
    half = 1.0
    while half > 1e-3:
        step = np.linspace(-half, half, 11)
        dx, dy = np.meshgrid(step, step)
        around = untouched_depth(x0 + dx, y0 + dy)
        index = np.unravel_index(np.argmax(np.abs(around)), around.shape)
        x0, y0, best = x0 + dx[index], y0 + dy[index], float(around[index])
        half /= 4
    return best


def compare(
    surface: Surface, truth: TrueMirror, optics: Optics, grid: NodeGrid, deepest: Peak | None = None
) -> Comparison:
    """Errors of `surface` against `truth`; depth and slope are compared at the points as read.

    deepest: its peak, by default that of what was measured. A peak inside a contact is compared with the
    deepest point of all, any other with what can be read.
    """
    usable = usable_nodes(optics, grid, truth)
    contacts = tuple(truth.contacts) if isinstance(truth, TouchedMirror) else ()
    both = usable & surface.valid
    if not both.any():
        nothing = float("nan")
        share = float(np.mean(usable[grid.inner]))
        return Comparison(nothing, nothing, nothing, nothing, share, 0.0, contacts=contacts)
    x, y = surface.x_mm[both], surface.y_mm[both]
    depth_error = surface.depth_mm[both] - truth.depth(x, y)
    slope_error = surface.slope[both] - np.stack(truth.slope(x, y), axis=-1)
    known = surface.on_mirror & usable
    inner, everywhere = grid.inner, surface.on_mirror
    of_all = true_peak_mm(truth, surface.x_mm[everywhere], surface.y_mm[everywhere], touched=True)
    peak_true = true_peak_mm(truth, surface.x_mm[known], surface.y_mm[known])
    deepest = deepest or peak(surface)
    against = of_all if deepest.where is Where.INSIDE else peak_true
    percent = 100 / against if against else float("nan")
    return Comparison(
        depth_deepest_mm=of_all,
        depth_peak_mm=peak_true,
        depth_peak_error_percent=percent * (deepest.depth_mm - against),
        depth_peak_error_sigma_percent=abs(percent) * deepest.sigma_mm,
        depth_rms_error_um=1e3 * float(np.sqrt(np.mean(depth_error**2))),
        slope_rms_error_mrad=1e3 * float(np.sqrt(np.mean(np.sum(slope_error**2, axis=-1)))),
        usable_share=float(np.mean(usable[inner])),
        valid_share=float(np.count_nonzero(both)) / max(int(np.count_nonzero(usable)), 1),
        contacts=contacts,
    )
