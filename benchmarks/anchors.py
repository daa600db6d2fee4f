"""Whether the constant of depth is as good as it says: thousands of dents of many families, without pictures.

Slopes fix depth but for a constant times a known field (`SurfaceReader.scale`). Exact warps of dents traced
through the simulated optics, with a frame's noise as the residual has it (and as nodes share it), are read by
the same reader as in a run; what the loop adds is left to `benchmarks.honesty` and `benchmarks.peaks`.

Seven families are what rubber makes: loads on a half-space, or on the rig's prism held at its faces
(`benchmarks.loads`). They are read by a rig file that states the body, and by one that does not; then on a
bonded layer that is 3 mm thinner or thicker than the 30 +- 3 mm of the rig file. The last group are dents by
formula, which no load makes, read by a rig file that says so: body = "none".

z: error of the constant over its stated sigma, a frame's noise included.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import exp, inf, isfinite, log, nan, sqrt
from pathlib import Path
from typing import Any

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
from benchmarks.loads import HELD, Load, Pressed, held_prism, rough
from benchmarks.peaks import LEVER_MM, RING_CURVATURE, middle_of_the_view
from benchmarks.report import Report, benchmark, figure, start
from benchmarks.rigs import coarser
from benchmarks.salt import generator, held_out, salt_option
from benchmarks.totals import SIGMAS, estimate, rate, rms
from zeromethod.arrays import Float
from zeromethod.cli.numbers import Whole
from zeromethod.errors import InputError
from zeromethod.optics import Dented, DepthField, Optics
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig, Rubber
from zeromethod.surface import Surface, SurfaceReader
from zeromethod.view.progress import progress
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.overlap import component_correlation
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

RESIDUAL_SIGMA_PX = 0.013
"""Noise of one frame's residual, camera px (2 grey levels in 8 bits)."""

DENTS, QUICK = 100, 8
"""Of each family."""

SEED = 2
"""0 and 1 are those that the laws of the far field were fitted to."""

DEEPEST_MM, MOST_OF_FOLD = 0.3, 0.4
LAYER_MM, LAYER_SIGMA_MM = 30.0, 3.0
MARGIN_MM = 20.0
"""How far outside the view loads lie, at most."""
FAMILY_RMS = 1.2
"""Most of the rms error of another version, in any family."""


def place(draw: np.random.Generator, low: Float, high: Float, beyond: float | None) -> Float:
    """(x, y) mm in the view and up to a share of it beyond (inwards: < 0).

    None: beside one of its sides, 10 mm inside to `MARGIN_MM` outside.
    """
    if beyond is not None:
        return np.asarray(low + draw.uniform(-beyond, 1.0 + beyond, 2) * (high - low))
    at = low + draw.uniform(0.0, 1.0, 2) * (high - low)
    axis, away = draw.integers(2), draw.uniform(-10.0, MARGIN_MM)
    at[axis] = low[axis] - away if draw.uniform() < 0.5 else high[axis] + away
    return np.asarray(at)


@dataclass(frozen=True)
class Loaded:
    """What rubber makes: loads of these kinds and widths (that of a Gaussian as broad, mm), fewest to most.

    beyond: as `place` has it. narrow: whether the narrowest are for the middle of the view at full size.
    """

    name: str
    beyond: float | None
    kinds: tuple[str, ...]
    widths_mm: tuple[float, float]
    counts: tuple[int, int] = (1, 1)
    narrow: bool = False


SOFT = ("gaussian", "rough", "parabola", "ball")
LOADED = (
    Loaded("one load", -0.15, SOFT, (1.0, 12.0), narrow=True),
    Loaded("several loads", 0.15, SOFT, (2.8, 10.0), (2, 5)),
    Loaded("load near the border", None, SOFT, (2.8, 12.0)),
    Loaded("ball", 0.15, ("ball",), (1.8, 7.0)),
    Loaded("cone", 0.15, ("cone",), (1.8, 7.0)),
    Loaded("flat punch or ring", 0.15, ("punch", "ring"), (2.8, 8.0)),
    Loaded("prism", -0.15, SOFT, (2.8, 10.0), (1, 2)),
)


@dataclass(frozen=True)
class Family:
    """Dents of one formula: 4 to 40 mm all over the view and beyond, else 1.5 to `largest` in the middle.

    longest: ratio of its axes, at most. beyond: how far out of view its centre may lie, over the view.
    """

    name: str
    profile: Callable[[np.random.Generator], Profile]
    smallest_mm: float
    largest_mm: float
    longest: float = 1.0
    count: int = 1
    beyond: float = 0.15

    @property
    def narrow(self) -> bool:
        """Whether its dents lie in the middle, the narrowest at full size."""
        return self.largest_mm <= 15.0


FAMILIES = (
    Family("Gaussian in the middle", lambda _: gauss, 1.5, 15.0),
    Family("long Gaussian in the middle", lambda _: gauss, 3.0, 10.0, 2.5),
    Family("1/r in the middle", lambda _: power(1.0), 1.5, 5.0),
    Family("edge in the middle", lambda _: straight, 1.5, 5.0),
    Family("Gaussian anywhere", lambda _: gauss, 4.0, 40.0),
    Family("long Gaussian anywhere", lambda _: gauss, 4.0, 40.0, 2.5),
    Family("1/r anywhere", lambda _: power(1.0), 3.0, 16.0),
    Family("ball anywhere", lambda _: dry_ball, 4.0, 16.0),
    Family("layer anywhere", lambda _: layer, 3.0, 16.0),
    Family("power of r anywhere", lambda draw: power(draw.uniform(1.5, 4.0)), 4.0, 20.0),
    Family("flat pad anywhere", lambda draw: pad(draw.uniform(2.5, 4.0)), 4.0, 25.0),
    Family("long 1/r anywhere", lambda _: power(1.0), 3.0, 16.0, 2.0),
    Family("cone anywhere", lambda _: sharp, 4.0, 16.0),
    Family("two Gaussians", lambda _: gauss, 4.0, 20.0, 1.0, 2),
    Family("two 1/r", lambda _: power(1.0), 3.0, 16.0, 1.0, 2),
    Family("wide Gaussian far out of view", lambda _: gauss, 8.0, 60.0, 1.0, 1, 0.6),
    Family("wide 1/r far out of view", lambda _: power(1.0), 8.0, 60.0, 1.0, 1, 0.6),
    Family("bulge around a dent", lambda _: bulged, 3.0, 16.0),
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

    def reader_by(self, rubber: Rubber) -> SurfaceReader:
        """The reader of a rig file that says this of the rubber."""
        return SurfaceReader(self.rig.model_copy(update={"rubber": rubber}), self.optics, self.grid)

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
        x, y = place(draw, low, high, -0.42 if family.narrow else family.beyond)
        size_mm = _between(draw, max(family.smallest_mm, smallest_mm), family.largest_mm)
        stretch, angle = np.sqrt(draw.uniform(1.0, family.longest)), draw.uniform(0.0, np.pi)
        short_mm = size_mm / stretch
        steepest = MOST_SLOPE * short_mm * exp(0.5)
        folds = short_mm**2 / (RING_CURVATURE * LEVER_MM)
        depth_mm = draw.uniform(0.1, 1.0) * min(steepest, MOST_OF_FOLD * folds, DEEPEST_MM)
        parts.append(Planted(profile, depth_mm, float(x), float(y), size_mm, float(stretch), float(angle)))
    return parts[0] if family.count == 1 else Sum(tuple(parts))


def _between(draw: np.random.Generator, low: float, high: float) -> float:
    """Evenly in its logarithm."""
    return exp(draw.uniform(log(low), log(high)))


def pressed(
    family: Loaded, view: View, draw: np.random.Generator, turn: int, smallest_mm: float, thickness_mm: float
) -> Pressed:
    """Loads of the family, held to the same limits; kinds take turns. thickness_mm: of a bonded layer."""
    low, high = view.seen.min(axis=0), view.seen.max(axis=0)
    narrowest, widest = family.widths_mm
    loads: list[Load] = []
    for number in range(draw.integers(family.counts[0], family.counts[1] + 1)):
        # the middle of a load's dent is that of a Gaussian of sqrt(2) times its width
        width_mm = _between(
            draw, max(narrowest, smallest_mm / sqrt(2)) if family.narrow else narrowest, widest
        )
        x, y = (float(at) for at in place(draw, low, high, family.beyond))
        kind, q = family.kinds[(turn // 2 + number) % len(family.kinds)], width_mm * draw.uniform(0.2, 1.0)
        loads += rough(draw, q, x, y, width_mm) if kind == "rough" else [Load(kind, q, x, y, width_mm)]
    prism = held_prism(view.rig) if family.name == "prism" else None
    dent = Pressed(tuple(loads), thickness_mm, prism)
    most = _most(dent, low - MARGIN_MM, high + MARGIN_MM)
    return replace(dent, scale=draw.uniform(0.1, 1.0) / most)


def _most(dent: Pressed, low: Float, high: Float) -> float:
    """The largest of depth, slope and fold over its limit, within a box."""
    pitch = 0.25 * min(load.width_mm for load in dent.loads)
    x, y = np.meshgrid(*(np.arange(*ends, pitch) for ends in zip(low, high, strict=True)))
    by_x, by_y = dent.slope(x, y)
    (xy, xx), yy = np.gradient(by_x, pitch), np.gradient(by_y, pitch, axis=0)
    # the larger of both principal curvatures: only a hollow's rim folds
    curvature = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    return max(
        float(np.hypot(by_x, by_y).max()) / MOST_SLOPE,
        float(curvature.max()) * LEVER_MM / MOST_OF_FOLD,
        float(np.abs(dent.depth(x, y)).max()) / DEEPEST_MM,
    )


STATED, SILENT, OFF, FORMULA = "body stated", "body not stated", "layer 10 % off", "by formula"
BODIES: dict[str, dict[str, Any]] = {
    "not stated": {},
    "half-space": {"support": "free"},
    "layer": {"support": "bonded", "thickness_mm": LAYER_MM, "thickness_sigma_mm": LAYER_SIGMA_MM},
    "prism": {"support": HELD.model_dump()},
    "none": {"body": "none"},
}
"""What a rig file says of its rubber."""


@dataclass(frozen=True)
class Case:
    """Dents of a family, on a bonded layer or not, and the group of each of `BODIES` they are read with."""

    family: Loaded | Family
    groups: dict[str, str]
    layer: bool = False

    @property
    def name(self) -> str:
        """Of its rows."""
        return f"{self.family.name}, layer" if self.layer else self.family.name

    def dent(self, view: View, draw: np.random.Generator, turn: int, smallest_mm: float) -> DepthField:
        """One of them."""
        if isinstance(self.family, Family):
            return drawn(self.family, view, draw, smallest_mm)
        off_mm = LAYER_SIGMA_MM if turn // 2 % 2 else -LAYER_SIGMA_MM
        return pressed(self.family, view, draw, turn, smallest_mm, LAYER_MM + off_mm if self.layer else inf)


CASES = (
    *(
        Case(one, {"prism" if one.name == "prism" else "half-space": STATED, "not stated": SILENT})
        for one in LOADED
    ),
    *(Case(one, {"layer": OFF, "not stated": SILENT}, layer=True) for one in LOADED if one.name != "prism"),
    *(Case(one, {"none": FORMULA}) for one in FAMILIES),
)

Read = tuple[float, float]
"""Error of the constant and its stated sigma, mm."""


def anchored(view: View, reader: SurfaceReader, surface: Surface, dent: DepthField) -> Read:
    """Multiple of the scale in the error of depth, mm, and its stated sigma with a frame's noise."""
    h = reader.scale[surface.valid[view.grid.inner]]
    x, y = surface.x_mm[surface.valid], surface.y_mm[surface.valid]
    off = float((h * (surface.depth_mm[surface.valid] - dent.depth(x, y))).sum() / (h * h).sum())
    inner = surface.valid[view.grid.inner]
    weights = np.zeros(view.grid.shape)
    weights[view.grid.inner] = np.where(inner, reader.scale, 0.0) / (h * h).sum()
    return off, reader.covariance(surface).variance_of(weights).sigma


def constants(count: int) -> dict[str, dict[str, list[Read]]]:
    """By group and row: those of `count` dents of every case."""
    rig = load_rig("simulated")
    coarse, half, middle = views = [
        View(one) for one in (coarser(rig, 4), coarser(rig, 2), middle_of_the_view(rig))
    ]
    kept = {
        key: value
        for key, value in rig.rubber.model_dump(exclude_unset=True).items()
        if key not in ("support", "thickness_mm", "thickness_sigma_mm", "youngs_modulus_mpa")
    }

    @cache
    def reader(view: int, body: str) -> SurfaceReader:
        return views[view].reader_by(Rubber.model_validate({**kept, **BODIES[body]}))

    found: dict[str, dict[str, list[Read]]] = {}
    with progress(len(CASES), "families") as advance:
        for number, case in enumerate(CASES):
            draw = generator(SEED, number)
            for turn in range(count):
                wide = coarse if turn % 2 else half
                view = (half if turn % 2 else middle) if case.family.narrow else wide
                dent = case.dent(view, draw, turn, 0.0 if view is middle else 4.0)
                warp = view.warp(dent, draw)
                for body, group in case.groups.items():
                    by = reader(views.index(view), body)
                    read = anchored(view, by, by.read(warp), dent)
                    found.setdefault(group, {}).setdefault(case.name, []).append(read)
            advance(case.name)
    return found


Row = dict[str, tuple[float, float]]
"""Figures of a family or a group, each with its standard error: nm, and shares of 1."""


def row_of(reads: Sequence[Read]) -> Row:
    """Of errors and their sigma, mm."""
    error, sigma = 1e6 * np.array(reads).T
    z = error / sigma
    return {
        ERROR: estimate(rms, error),
        SIGMA: estimate(np.median, sigma),
        Z: estimate(rms, z),
        BEYOND: rate(int(np.count_nonzero(np.abs(z) > SIGMAS)), len(z)),
        SHARE: estimate(lambda s, e: np.median(s) / rms(e), sigma, error),
    }


ERROR, SIGMA = "error, rms, nm", "stated sigma, median, nm"
Z, BEYOND, SHARE = "error over sigma, rms", "beyond 3 sigma", "sigma over rms error"
OTHERS_ERROR, OTHERS_SIGMA = "error over another version's", "sigma over another version's"
BARS: dict[tuple[str, str], tuple[float | None, float | None]] = {
    (STATED, Z): (0.8, 1.3),
    (STATED, BEYOND): (None, 0.01),
    (STATED, OTHERS_ERROR): (None, 0.5),
    (STATED, OTHERS_SIGMA): (None, 1.0),
    (SILENT, Z): (0.7, 1.3),
    (SILENT, OTHERS_SIGMA): (None, 2.0),
    (OFF, Z): (0.7, 1.3),
    (OFF, OTHERS_SIGMA): (None, 2.0),
    (FORMULA, Z): (None, 1.5),
    (FORMULA, BEYOND): (None, 0.05),
    (FORMULA, SHARE): (None, 3.0),
}
"""Least and most of a group's figures."""


def report(count: int, against: Path | None = None) -> Report:
    """A row for every family and group, and the groups' figures."""
    scenes = f"{count} of each family, salt {held_out()!r}"
    others = {} if against is None else _others(against, scenes)
    rows, figures, worst = {}, [], 0.0
    for group, families in constants(count).items():
        families["all"] = [read for reads in families.values() for read in reads]
        for name, reads in families.items():
            row = rows[f"{group}: {name}"] = row_of(reads)
            if others:
                for ratio, words in ((OTHERS_ERROR, ERROR), (OTHERS_SIGMA, SIGMA)):
                    row[ratio] = row[words][0] / others[f"{group}: {name}"][words][0], nan
                worst = max(worst, row[OTHERS_ERROR][0] if group == STATED else 0.0)
        for words, pair in row.items():
            least, most = BARS.get((group, words), (None, None))
            figures.append(figure(f"{group}: {words}", *pair, least=least, most=most))
    if others:
        name = f"{STATED}: {OTHERS_ERROR}, worst family"
        figures.append(figure(name, worst, most=FAMILY_RMS))
    table = [["family", *row]]
    table += [
        [name, *(f"{v:.3g}" + f" ± {e:.2g}" * isfinite(e) for v, e in of.values())]
        for name, of in rows.items()
    ]
    title = "The constant of dents of many families"
    return Report(title, figures, table, {"scenes": scenes, "rows": rows}, totals=True)


def _others(file: Path, scenes: str) -> dict[str, Row]:
    """Rows of another version, of the same scenes."""
    try:
        data = json.loads(file.read_text())["data"]
        theirs, rows = data["scenes"], dict(data["rows"])
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--against: {file}: no summary of this benchmark") from None
    if theirs != scenes:
        raise InputError(f"--against: {file}: of other scenes: {theirs}, not {scenes}")
    return rows


@benchmark(
    "anchors",
    __doc__,
    click.option("--dents", type=Whole(min=2), default=DENTS, show_default=True, help="Of each family."),
    click.option(
        "--against",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="Another version's --summary, of the same dents.",
    ),
    salt_option,
)
def command(quick: bool, dents: int, against: Path | None) -> Report:
    """Run everything."""
    return report(QUICK if quick else dents, against)


if __name__ == "__main__":
    start(command)
