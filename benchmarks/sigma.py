"""Whether the stated sigma is true: residual, warp, slope and depth against Monte Carlo, pixel by pixel.

The packaged bench binned by 4 under its default press of 0.2 mm, pictures drawn by the real renderer for the
warp that almost nulls it. The light at the pixels is rendered once per case; then the camera's noise is drawn
again 400 times and every frame goes through the sensor, the composition and the reader. Three noise levels,
two exposures (light in proportion), the mirror at rest too, and an exposure that saw two pictures.

"ratio": the sigma stated by the median frame over the standard deviation of the draws, per node. 400 draws
know that to 3.5 %, so a sigma that is exact has 99 % of the nodes within 0.91 to 1.09.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.pads import pad
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, small_rig
from zeromethod.arrays import Float, Single
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import Observation, PanelTiming, pair
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.gl import create_context
from zeromethod.loop.measured_warp import expect, measure_warp, unmixed
from zeromethod.optics import Dented, Optics
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.rig.model import Rig
from zeromethod.sensing import ResidualSensor
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.panel import Presentation, SimulatedPanel
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.sensor import Sensor
from zeromethod.surface import DepthCovariance, Surface, SurfaceReader
from zeromethod.surface.comparison import usable_nodes
from zeromethod.view.progress import progress
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest import Rest

DRAWS = 400

BORDER = 3
"""Rows of nodes next to the view's border, whose depth it makes uncertain (`surface.view_border`)."""
COVARIANCE_EVERY = 20
"""Draws from one whose full covariance is kept to the next."""
WORDS = ("residual", "warp", "slope", "depth")
MEDIAN, MOST, SHARE, VALID = (0.9, 1.1), (0.8, 1.2), 0.99, 0.95
PRESS = pad(VIEW_MIDDLE_MM, 0.0, 0.2, 5.0)
REST = Mirror()


@dataclass(frozen=True)
class Case:
    """Noise (grey levels rms, electrons per grey level), exposure over the packaged one, press, pictures."""

    name: str
    read_grey: float
    electrons_per_grey: float
    exposure: float
    press_mm: float = 0.2
    two_pictures: bool = False


LEVELS = (("low", 0.7, 600.0), ("packaged", 2.0, 150.0), ("high", 5.0, 20.0))
CASES = (
    *(
        Case(f"{name} noise, exposure {e:g}", grey, electrons, e)
        for name, grey, electrons in LEVELS
        for e in (1.0, 0.25)
    ),
    Case("packaged noise, at rest", 2.0, 150.0, 1.0, press_mm=0.0),
    Case("packaged noise, two pictures", 2.0, 150.0, 1.0, two_pictures=True),
)


@dataclass(frozen=True)
class Draws:
    """Values and sigmas, (draws, rows, cols, components) each, by word; NaN where not valid in that draw.

    usable: (rows, cols). covariances: stated with every `COVARIANCE_EVERY`th draw.
    """

    values: dict[str, Float]
    sigmas: dict[str, Float]
    usable: Any
    grid: NodeGrid
    covariances: list[DepthCovariance]

    @property
    def inner(self) -> Any:
        """Nodes (rows, cols) more than three rows from the first and last ones with a depth."""
        read = np.asarray(np.isfinite(self.values["depth"][..., 0]).any(axis=0))
        rows, cols = (np.flatnonzero(np.any(read, axis=axis))[[0, -1]] for axis in (1, 0))
        inner = np.zeros(read.shape, bool)
        inner[rows[0] + BORDER : rows[1] + 1 - BORDER, cols[0] + BORDER : cols[1] + 1 - BORDER] = True
        return inner

    @property
    def valid_share(self) -> float:
        """Usable nodes read with a depth, over all draws."""
        return float(np.mean(np.isfinite(self.values["depth"][..., 0])[:, self.usable]))

    def ratios(self, word: str) -> Float:
        """Median stated sigma over the draws' deviation, per usable node and component, flat.

        Nodes that were valid in fewer than 9 of 10 draws are left out.
        """
        among = self._often(word)
        value, sigma = self.values[word][:, among], self.sigmas[word][:, among]
        return np.asarray(np.nanmedian(sigma, axis=0) / np.nanstd(value, axis=0, ddof=1)).ravel()

    def true(self, word: str) -> Any:
        """Whether each of the ratios is within 0.8 to 1.2.

        Next to the view's border depth's may be larger: what the border does is in it, in all draws alike.
        """
        ratio = self.ratios(word)
        apart = ~self.inner[self._often(word)] if word == "depth" else np.zeros(len(ratio), bool)
        return (ratio >= MOST[0]) & ((ratio <= MOST[1]) | apart)

    def _often(self, word: str) -> Any:
        """Usable nodes (rows, cols) that were valid in 9 of 10 draws."""
        known = np.isfinite(self.values[word]).all(axis=-1).mean(axis=0) > 0.9
        return self.usable & known


@dataclass(frozen=True)
class SumRatios:
    """Stated over drawn standard deviation of n weighted sums of depth; all (n,).

    ratio: rms of what the frames state over the draws' deviation. error: standard error of `ratio`,
    sqrt((kurtosis + 2) / (4 draws)). kurtosis: excess of the draws. spread: standard deviation of what the
    frames state, relative to its mean; 0 where all state the same.
    """

    ratio: Float
    error: Float
    kurtosis: Float
    spread: Float


def sum_ratios(draws: Draws, weights: Float) -> SumRatios:
    """Judge the stated covariance by sums of depth, weights (n, rows, cols) of nodes valid in every draw."""
    depth = draws.values["depth"][..., 0]
    used = (weights != 0).any(axis=0)
    drawn = depth[:, used] @ weights[:, used].T
    drawn -= drawn.mean(axis=0)
    deviation = drawn.std(axis=0)
    kurtosis = ((drawn / deviation) ** 4).mean(axis=0) - 3.0
    whole = np.zeros((len(weights), *draws.grid.shape))
    whole[:, *draws.grid.inner] = weights
    variance = np.array([[one.variance_of(w).noise for w in whole] for one in draws.covariances])
    stated = np.sqrt(variance)
    return SumRatios(
        np.sqrt(variance.mean(axis=0)) / deviation,
        np.sqrt((kurtosis + 2.0) / (4.0 * len(depth))),
        kurtosis,
        stated.std(axis=0) / stated.mean(axis=0),
    )


class Bench:
    """One bench, and frames of it under chosen noise."""

    def __init__(self, rig: Rig | None = None) -> None:
        self.rig = small_rig() if rig is None else rig
        self.optics = Optics(self.rig)
        self.rest = Rest.of(self.rig, self.optics)
        self.reader = SurfaceReader(self.rig, self.optics, self.rest.grid)
        self._light = NumpyRenderer(self.rig)
        self._context = create_context()

    @cached_property
    def _pattern(self) -> PatternRenderer:
        size = (self.rig.display.columns, self.rig.display.rows)
        target, response = Target.from_spec(self.rig.target), Response.from_rig(self.rig.display)
        return PatternRenderer(self._context, self.rest.grid, self.rest.q, size, target, response)

    def mirror(self, press_mm: float) -> Mirror:
        """Mirror under the default press of that depth."""
        if not press_mm:
            return REST
        return Mirror((replace(PRESS, depth_mm=press_mm),))

    def warp(self, press_mm: float) -> Float:
        """Where the nodes look, finite everywhere."""
        mirror = Dented(self.optics.rest, self.mirror(press_mm))
        q = self.optics.trace(*self.rest.grid.mesh(), mirror).q
        return np.where(np.isfinite(q), q, self.rest.q)

    def exposed(self, case: Case) -> tuple[Single, Observation]:
        """Light at the pixels, and what was shown, of one frame."""
        # 2 um short of the press, so that the residual is small but not nothing.
        pictures = [self.warp(max(case.press_mm - 0.002, 0.0))]
        times = [0]
        middle_ns, exposure_ns = 500_000_000, 8_000_000
        if case.two_pictures:
            pictures.insert(0, self.warp(case.press_mm - 0.006))
            times.append(middle_ns - 12_000_000)
        log = PresentationLog(self.rest.q.shape[:2])
        presentations = []
        with self._context:
            for time_ns, q in zip(times, pictures, strict=True):
                log.record(time_ns, q, time_ns)
                presentations.append(Presentation(time_ns, self._light.upload(self._pattern.image(q))))
        panel = SimulatedPanel(self.rig.display, self.rig.display.refresh_hz)
        half = exposure_ns // 2
        shares = panel.weights(presentations, middle_ns - half, middle_ns + half)
        light = self._light.expose([Piece(1.0, self.mirror(case.press_mm), shares)])
        frame = Frame(np.zeros((1, 1), np.uint8), middle_ns, exposure_ns, 0, 0)
        timing, kind = PanelTiming.of(self.rig.display), self.rig.target.kind
        shown = pair(log, frame, timing, self.warp(case.press_mm), self.rest.grid, kind)
        assert shown is not None
        assert (len(shown.entries) == 2) == case.two_pictures
        return np.float32(case.exposure) * light, shown

    def _less_constant(self, surface: Surface, mirror: Mirror) -> Float:
        """Depth (rows, cols), mm, less the mean error over the anchor's nodes, as sigma of noise counts it.

        Not less its mean: of a dent it is another one for every node that fails in some draws.
        """
        inner = self.rest.grid.inner
        scale = np.where(surface.valid[inner], self.reader.scale, np.nan)
        of_anchor = np.where(surface.anchor.mask[inner], scale, np.nan)
        error_mm = (surface.depth_mm - mirror.depth(surface.x_mm, surface.y_mm))[inner]
        constant_mm = np.nansum(of_anchor * error_mm) / np.nansum(of_anchor**2)
        out = np.full(surface.depth_mm.shape, np.nan)
        out[inner] = surface.depth_mm[inner] - constant_mm * scale
        return out

    def _of_noise(self, surface: Surface) -> Float:
        """Sigma of depth (rows, cols), mm, less the anchor's own."""
        inner = self.rest.grid.inner
        scale = np.where(surface.valid[inner], self.reader.scale, np.nan)
        anchor_mm = np.full(surface.depth_mm.shape, np.nan)
        anchor_mm[inner] = surface.anchor.sigma_mm * scale / np.sqrt(np.nanmean(scale**2))
        return np.asarray(np.sqrt(surface.sigma_depth_mm**2 - anchor_mm**2))

    def draws(self, case: Case, count: int = DRAWS) -> Draws:
        """Draw the noise `count` times."""
        noise = {"read_grey": case.read_grey, "electrons_per_grey": case.electrons_per_grey}
        spec = type(self.rig.camera.noise).model_validate({**self.rig.camera.noise.model_dump(), **noise})
        rig = changed(self.rig, camera={"noise": spec})
        sensor = ResidualSensor.from_rig(rig, self.rest.grid, Target.from_spec(rig.target).light)
        chip = Sensor(rig)
        light, shown = self.exposed(case)
        known = expect(shown, self.warp(case.press_mm), self.rest.visible, self.rest)
        guess = known.residual_px
        if shown.mixture is not None and shown.mixture.bias_px is not None:
            guess = known.residual_px + shown.mixture.bias_px
        inner, mirror = self.rest.grid.inner, self.mirror(case.press_mm)
        values: dict[str, list[Float]] = {word: [] for word in WORDS}
        sigmas: dict[str, list[Float]] = {word: [] for word in WORDS}
        surface = None
        covariances = []
        for number in range(count):
            image = chip.image(light, number)
            residual = unmixed(sensor.measure(image, guess), shown, self.rest.grid)
            measured = measure_warp(shown, residual, known, self.rest)
            surface = self.reader.read(measured, surface)
            if number % COVARIANCE_EVERY == 0:
                covariances.append(self.reader.covariance(surface))
            good = (measured.valid & surface.valid)[inner][..., None]
            depth = (self._less_constant(surface, mirror)[..., None], self._of_noise(surface)[..., None])
            pairs = (
                (residual.d, residual.sigma),
                (measured.q, measured.sigma),
                (surface.slope, surface.sigma_slope),
                depth,
            )
            for word, (value, sigma) in zip(WORDS, pairs, strict=True):
                values[word].append(np.where(good, value[inner], np.nan))
                sigmas[word].append(np.where(good, sigma[inner], np.nan))
        usable = usable_nodes(self.optics, self.rest.grid, mirror)[inner]
        return Draws(
            {word: np.array(value) for word, value in values.items()},
            {word: np.array(value) for word, value in sigmas.items()},
            usable,
            self.rest.grid,
            covariances,
        )


@dataclass(frozen=True)
class Ratios:
    """Sigma over deviation of one quantity in one case: median, 1 in 200 on either side, share within."""

    case: str
    word: str
    median: float
    low: float
    high: float
    within: float
    valid: float
    typical: float

    @property
    def met(self) -> bool:
        """Whether all three bars are."""
        in_middle = MEDIAN[0] <= self.median <= MEDIAN[1]
        return bool(in_middle and self.within >= SHARE and self.valid >= VALID)


def ratios(case: Case, draws: Draws) -> list[Ratios]:
    """Judge every quantity of one case."""
    out = []
    for word in WORDS:
        ratio = draws.ratios(word)
        low, median, high = (float(np.quantile(ratio, share)) for share in (0.005, 0.5, 0.995))
        within = float(np.mean(draws.true(word)))
        typical = float(np.nanmedian(draws.sigmas[word]))
        out.append(Ratios(case.name, word, median, low, high, within, draws.valid_share, typical))
    return out


def report(cases: Sequence[Case] = CASES, count: int = DRAWS) -> Report:
    """Ratios of all cases."""
    bench = Bench()
    found: list[Ratios] = []
    with progress(len(cases), "cases") as bar:
        for case in cases:
            found += ratios(case, bench.draws(case, count))
            bar(case.name)
    header = ["case", "quantity", "sigma", "median ratio", "0.5 %", "99.5 %", "within 0.8 to 1.2", "valid"]
    units = {"residual": ("px", 1.0), "warp": ("LCD px", 1.0), "slope": ("urad", 1e6), "depth": ("nm", 1e6)}
    rows = [
        [
            r.case,
            r.word,
            f"{r.typical * units[r.word][1]:.3g} {units[r.word][0]}",
            f"{r.median:.3f}",
            f"{r.low:.3f}",
            f"{r.high:.3f}",
            f"{100 * r.within:.2f} %",
            f"{100 * r.valid:.1f} %",
        ]
        for r in found
    ]
    figures = []
    for word in WORDS:
        of_word = [r for r in found if r.word == word]
        medians = [r.median for r in of_word]
        value = (
            f"median {min(medians):.3f} to {max(medians):.3f}, within {min(r.within for r in of_word):.4f}"
        )
        bar_text = f"{MEDIAN[0]} to {MEDIAN[1]}, {SHARE} within {MOST[0]} to {MOST[1]}, {VALID} valid"
        figures.append(Figure(f"sigma over rms, {word}", value, bar_text, all(r.met for r in of_word)))
    data = {"draws": count, "ratios": [asdict(r) for r in found]}
    return Report(f"Stated sigma against {count} draws of the noise", figures, [header, *rows], data)


@benchmark("sigma", __doc__)
def command(quick: bool) -> Report:
    return report(CASES[2:4] if quick else CASES)


if __name__ == "__main__":
    start(command)
