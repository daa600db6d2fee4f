"""Whether anchors and peaks are as good as they say: thousands of dents of many families, without pictures.

Exact warps of dents traced through the simulated optics, with a frame's noise as the residual has it (and as
nodes share it), are read by the same reader as in a run; what the loop adds is left to `benchmarks.honesty`
and `benchmarks.peaks`. "known" families are presses as `benchmarks.honesty` and
`benchmarks.peaks` make them, the "other" ones are others: some of them follow no law of the far field.

z: error over stated sigma, of the peak at its own place, and of the anchor: of the constant (times `scale`)
that the whole depth is off by, its noise of a frame included.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp, log

import click
import numpy as np

from benchmarks.dents import (
    Planted,
    Profile,
    Sum,
    bulged,
    dry_ball,
    gauss,
    layer,
    pad,
    power,
    sharp,
    straight,
)
from benchmarks.hand_presses import MOST_SLOPE
from benchmarks.honesty import by_place_mm
from benchmarks.peaks import LEVER_MM, RING_CURVATURE, middle_of_the_view
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import coarser
from benchmarks.salt import generator, salt_option
from zeromethod.arrays import Float
from zeromethod.cli.numbers import Whole
from zeromethod.optics import Dented, DepthField, Optics
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface, SurfaceReader, peak
from zeromethod.view.progress import progress
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.overlap import component_correlation
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

RESIDUAL_SIGMA_PX = 0.013
"""Noise of one frame's residual, camera px (2 grey levels in 8 bits)."""

DENTS, QUICK = 100, 10
"""Of each family."""

SEED = 2
"""0 and 1 are those that the laws of the far field were fitted to."""

DEEPEST_MM, MOST_OF_FOLD = 0.3, 0.4
FAR_SIGMAS = 3.0
Z_RMS, MOST_FAR = (0.8, 1.25), 0.015


@dataclass(frozen=True)
class Family:
    """Dents of one kind. wide: 4 to 40 mm all over the view and beyond, else 1.5 to `largest` in the middle.

    longest: ratio of its axes, at most. known: whether other benchmarks press so. beyond: how far out of view
    its centre may lie, over the view.
    """

    name: str
    known: bool
    profile: Callable[[np.random.Generator], Profile]
    smallest_mm: float
    largest_mm: float
    longest: float = 1.0
    count: int = 1
    beyond: float = 0.15

    @property
    def wide(self) -> bool:
        """Whether its dents lie all over the view, and beyond."""
        return self.largest_mm > 15.0


FAMILIES = (
    Family("Gaussian in the middle", True, lambda _: gauss, 1.5, 15.0),
    Family("long Gaussian in the middle", True, lambda _: gauss, 3.0, 10.0, 2.5),
    Family("1/r in the middle", True, lambda _: power(1.0), 1.5, 5.0),
    Family("edge in the middle", True, lambda _: straight, 1.5, 5.0),
    Family("Gaussian anywhere", True, lambda _: gauss, 4.0, 40.0),
    Family("long Gaussian anywhere", True, lambda _: gauss, 4.0, 40.0, 2.5),
    Family("1/r anywhere", True, lambda _: power(1.0), 3.0, 16.0),
    Family("ball anywhere", True, lambda _: dry_ball, 4.0, 16.0),
    Family("layer anywhere", False, lambda _: layer, 3.0, 16.0),
    Family("power of r anywhere", False, lambda draw: power(draw.uniform(1.5, 4.0)), 4.0, 20.0),
    Family("flat pad anywhere", False, lambda draw: pad(draw.uniform(2.5, 4.0)), 4.0, 25.0),
    Family("long 1/r anywhere", False, lambda _: power(1.0), 3.0, 16.0, 2.0),
    Family("cone anywhere", False, lambda _: sharp, 4.0, 16.0),
    Family("two Gaussians", False, lambda _: gauss, 4.0, 20.0, 1.0, 2),
    Family("two 1/r", False, lambda _: power(1.0), 3.0, 16.0, 1.0, 2),
    Family("wide Gaussian far out of view", False, lambda _: gauss, 8.0, 60.0, 1.0, 1, 0.6),
    Family("wide 1/r far out of view", False, lambda _: power(1.0), 8.0, 60.0, 1.0, 1, 0.6),
    Family("bulge around a dent", False, lambda _: bulged, 3.0, 16.0),
)


@dataclass(frozen=True)
class View:
    """One camera's nodes, and the reader of its warps."""

    rig: Rig

    @cached_property
    def optics(self) -> Optics:
        """Of the rig."""
        return Optics(self.rig)

    @cached_property
    def grid(self) -> NodeGrid:
        """Of the rig."""
        return NodeGrid.of_rig(self.rig)

    @cached_property
    def reader(self) -> SurfaceReader:
        """Of its warps."""
        return SurfaceReader(self.rig, self.optics, self.grid)

    @cached_property
    def seen(self) -> Float:
        """Mirror points (n, 2), mm."""
        point = self.optics.trace(*self.grid.mesh(), self.optics.rest).point[..., :2]
        return np.asarray(point[np.isfinite(point).all(axis=-1)])

    @cached_property
    def _roots(self) -> tuple[tuple[Float, Float], ...]:
        """Square roots of the noise's covariance down and across, for each component."""
        own, other = (
            [_root(np.asarray(one), count) for one in self._correlation] for count in self.grid.shape[::-1]
        )
        return (other[1], own[0]), (other[0], own[1])

    @property
    def _correlation(self) -> tuple[Float, Float]:
        return component_correlation(self.grid.period_px, self.grid.spacing_px, self.rig.target.kind)

    def warp(self, dent: DepthField, draw: np.random.Generator | None = None) -> Warp:
        """The exact warp of a dent, with one frame's noise where a generator is given."""
        trace = self.optics.trace(*self.grid.mesh(), Dented(self.optics.rest, dent))
        flags = np.full(self.grid.shape, Flag.OUTSIDE, np.uint16)
        flags[self.grid.inner] = 0
        flags[~trace.reaches_display] |= np.uint16(Flag.NO_RAY)
        bending = jacobian(trace.q, self.grid.spacing_px)
        q = trace.q
        if draw is not None:
            white = draw.standard_normal((2, *self.grid.shape))
            noise = np.stack(
                [down @ one @ across for one, (down, across) in zip(white, self._roots, strict=True)]
            )
            q = q + RESIDUAL_SIGMA_PX * np.einsum("...ij,j...->...i", bending, noise)
        sigma = RESIDUAL_SIGMA_PX * np.linalg.norm(bending, axis=-1)
        return Warp(q, np.where(np.isfinite(sigma), sigma, 1.0), flags, time_ns=0)


def _root(correlation: Float, count: int) -> Float:
    """Symmetric root (count, count) of the covariance of nodes on a line."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    matrix = np.where(apart < len(correlation), correlation[np.minimum(apart, len(correlation) - 1)], 0.0)
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def drawn(family: Family, view: View, draw: np.random.Generator, smallest_mm: float) -> DepthField:
    """A dent of the family, at most `MOST_SLOPE` steep, 0.4 of what folds and `DEEPEST_MM` deep."""
    low, high = view.seen.min(axis=0), view.seen.max(axis=0)
    profile = family.profile(draw)
    parts = []
    for _ in range(family.count):
        share = (
            draw.uniform(-family.beyond, 1.0 + family.beyond, 2)
            if family.wide
            else draw.uniform(0.42, 0.58, 2)
        )
        size_mm = exp(draw.uniform(log(max(family.smallest_mm, smallest_mm)), log(family.largest_mm)))
        stretch, angle = np.sqrt(draw.uniform(1.0, family.longest)), draw.uniform(0.0, np.pi)
        short_mm = size_mm / stretch
        steepest = MOST_SLOPE * short_mm * exp(0.5)
        folds = short_mm**2 / (RING_CURVATURE * LEVER_MM)
        depth_mm = draw.uniform(0.1, 1.0) * min(steepest, MOST_OF_FOLD * folds, DEEPEST_MM)
        x, y = low + share * (high - low)
        parts.append(Planted(profile, depth_mm, float(x), float(y), size_mm, float(stretch), float(angle)))
    return parts[0] if family.count == 1 else Sum(tuple(parts))


@dataclass(frozen=True)
class Read:
    """Errors and stated sigmas, mm: of a peak and of its anchor."""

    peak_mm: float
    peak_sigma_mm: float
    anchor_mm: float
    anchor_sigma_mm: float


def read(view: View, dent: DepthField, draw: np.random.Generator) -> Read:
    """One dent in one frame."""
    surface = view.reader.read(view.warp(dent, draw))
    found = peak(surface)
    at = np.array(found.x_mm), np.array(found.y_mm)
    by_place = by_place_mm(surface, found, dent)
    sigma_mm = float(np.hypot(found.sigma_mm, by_place))
    return Read(found.depth_mm - float(dent.depth(*at)), sigma_mm, *anchored(view, surface, dent))


def anchored(view: View, surface: Surface, dent: DepthField) -> tuple[float, float]:
    """Multiple of the scale in the error of depth, mm, and its stated sigma with a frame's noise."""
    h = view.reader.scale[surface.valid[view.grid.inner]]
    x, y = surface.x_mm[surface.valid], surface.y_mm[surface.valid]
    off = float((h * (surface.depth_mm[surface.valid] - dent.depth(x, y))).sum() / (h * h).sum())
    inner = surface.valid[view.grid.inner]
    weights = np.zeros(view.grid.shape)
    weights[view.grid.inner] = np.where(inner, view.reader.scale, 0.0) / (h * h).sum()
    return off, view.reader.covariance(surface).variance_of(weights).sigma


def report(count: int) -> Report:
    """`count` dents of every family."""
    rig = load_rig("simulated")
    coarse, half, middle = (View(one) for one in (coarser(rig, 4), coarser(rig, 2), middle_of_the_view(rig)))
    found: dict[str, list[Read]] = {}
    with progress(len(FAMILIES), "families") as advance:
        for number, family in enumerate(FAMILIES):
            draw = generator(SEED, number)
            found[family.name] = []
            for turn in range(count):
                view = (coarse if turn % 2 else half) if family.wide else (half if turn % 2 else middle)
                smallest_mm = 0.0 if view is middle else 4.0
                dent = drawn(family, view, draw, smallest_mm)
                found[family.name].append(read(view, dent, draw))
            advance(family.name)
    return summarise(found)


def _row(name: str, reads: Sequence[Read]) -> list[str]:
    cells = [name, f"{len(reads)}"]
    for error, sigma in (
        ([r.anchor_mm for r in reads], [r.anchor_sigma_mm for r in reads]),
        ([r.peak_mm for r in reads], [r.peak_sigma_mm for r in reads]),
    ):
        off, stated = 1e6 * np.array(error), 1e6 * np.array(sigma)
        z = off / stated
        cells += [
            f"{np.sqrt(np.mean(z**2)):.2f}",
            f"{np.abs(z).max():.1f}",
            f"{np.count_nonzero(np.abs(z) > FAR_SIGMAS)}",
            f"{np.sqrt(np.mean(off**2)):.0f}",
            f"{np.median(stated):.0f}",
            f"{np.sqrt(np.mean(stated**2)):.0f}",
        ]
    return cells


def summarise(found: dict[str, list[Read]]) -> Report:
    """A row for every family, and bars over the known and the other ones."""
    groups = {
        "known families": [r for f in FAMILIES if f.known for r in found[f.name]],
        "other families": [r for f in FAMILIES if not f.known for r in found[f.name]],
    }
    figures = []
    for name, reads in groups.items():
        z = np.array([r.peak_mm / r.peak_sigma_mm for r in reads])
        rms, far = float(np.sqrt(np.mean(z**2))), float(np.mean(np.abs(z) > FAR_SIGMAS))
        met = Z_RMS[0] <= rms <= Z_RMS[1]
        figures.append(Figure(f"z of peaks, rms, {name}", f"{rms:.2f}", f"{Z_RMS[0]} to {Z_RMS[1]}", met))
        figures.append(
            Figure(f"peaks beyond 3 sigma, {name}", f"{far:.1%}", f"<= {MOST_FAR:.1%}", far <= MOST_FAR)
        )
    header = ["family", "dents"]
    for what in ("anchor", "peak"):
        header += [f"{what}: z rms", "largest", "> 3", "rms, nm", "median sigma", "rms sigma"]
    rows = [_row(name, reads) for name, reads in {**found, **groups}.items()]
    data = {
        name: [[r.peak_mm, r.peak_sigma_mm, r.anchor_mm, r.anchor_sigma_mm] for r in reads]
        for name, reads in found.items()
    }
    return Report("Anchors and peaks of dents of many families", figures, [header, *rows], data)


@benchmark(
    "anchors",
    __doc__,
    click.option("--dents", type=Whole(min=2), default=DENTS, show_default=True, help="Of each family."),
    salt_option,
)
def command(quick: bool, dents: int) -> Report:
    """Run everything."""
    return report(QUICK if quick else dents)


if __name__ == "__main__":
    start(command)
