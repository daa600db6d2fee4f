"""Depth read on the thin saw: loads of sigma 1.5 to 8 mm anywhere on the face, on seams, over three teeth.

The packaged rig `thin`, its geometry known. Warps are exact rays with one frame's noise; what sees a seam
is not in them. Dents are 0.3 of their fold limit deep (of sigma 8 mm 0.15, which still ends on the LCD). A
step is the difference, between the nodes to either side of a seam, of the mean error of depth.

Then unknown benches, every parameter of which, single teeth's too, is off by its prior: pixels twice as
large, exact rays with 0.02 LCD px of noise, mixed where a pixel's window sees a seam. Each is calibrated from
the rest map alone, and with three presses of 0.2 mm known to 1 µm; eight other presses are read through it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.anchors import View
from benchmarks.calibration_study import BINNING, Truth
from benchmarks.pads import pad
from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.salt import generator, salt_option
from benchmarks.totals import rms
from zeromethod.arrays import Float
from zeromethod.calibration import (
    KnownPress,
    Measurement,
    Presses,
    Priors,
    RestPositions,
    RestReading,
    ToothSeams,
    depth_error,
    fit,
)
from zeromethod.cli.numbers import Whole
from zeromethod.design.sampled_view import SampledView
from zeromethod.design.seams import seam_figures
from zeromethod.optics import Dented
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.simulation.press import Mirror
from zeromethod.surface import Surface, peak
from zeromethod.view.progress import progress
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

SIGMAS_MM = (1.5, 2.0, 3.0, 5.0, 8.0)
OFF_SEAM_MM = (0.0, 1.4, 4.15)
"""From a seam: on it, where its nodes' neighbours are, in the middle of a tooth."""
FOLD_MM_5 = 0.82
"""Depth at which a load of sigma 5 mm folds; it grows as sigma squared."""
SHARE, WIDE_SHARE, WIDE_MM = 0.3, 0.15, 6.0
MOST_PERCENT, MOST_BAND_MM, MOST_FAR = 0.5, 0.6, 0.01
FAR_SIGMAS = 3.0
CASES = ("rest map alone", "three presses")
TESTS, MOST_CALIBRATED = 8, 1.5
MIXED_PX, JUMP_PX = (-3.0, -1.5, 1.5, 3.0), 0.1
"""Offsets, in the large pixels, at which a window of the rest map looks; LCD px from which it sees a seam."""


@dataclass(frozen=True)
class Reading:
    """Of one dent: errors of nodes and peak, percent; steps over seams, nm; share of nodes beyond 3 sigma."""

    sigma_mm: float
    off_mm: float
    worst_percent: float
    peak_percent: float
    step_nm: float
    far_share: float


def seams_of(surface: Surface) -> list[slice]:
    """Columns of nodes of each seam in the middle row, those at the view's ends left out."""
    seam = np.asarray(surface.seam)[surface.depth_mm.shape[0] // 2].astype(np.int8)
    starts, ends = (np.flatnonzero(np.diff(seam) == sign) + 1 for sign in (1, -1))
    return [slice(a, b) for a, b in zip(starts, ends, strict=True) if a > 8 and b < len(seam) - 8]


def largest_step_nm(error: Float, surface: Surface) -> float:
    """Of the mean error of three columns on either side of each seam."""
    steps = [
        np.nanmean(error[:, seam.stop : seam.stop + 3]) - np.nanmean(error[:, seam.start - 3 : seam.start])
        for seam in seams_of(surface)
    ]
    return float(1e6 * np.max(np.abs(steps)))


def readings(draws: int) -> list[Reading]:
    """All dents, each with so many frames' noise."""
    view = View(load_rig("thin"))
    rng = generator(20)
    middle = view.reader.read(view.warp(Mirror((pad(41.0, 0.0, 1e-4, 2.0),))))
    seam = seams_of(middle)[1]
    at_mm = float(middle.x_mm[middle.x_mm.shape[0] // 2, seam].mean())
    found = []
    with progress(len(SIGMAS_MM) * len(OFF_SEAM_MM) * draws, "thin") as advance:
        for sigma_mm in SIGMAS_MM:
            share = WIDE_SHARE if sigma_mm > WIDE_MM else SHARE
            depth_mm = share * FOLD_MM_5 * (sigma_mm / 5.0) ** 2
            for off_mm in OFF_SEAM_MM:
                for _ in range(draws):
                    y_mm = float(rng.uniform(-5.0, 5.0))
                    place = at_mm + off_mm, y_mm
                    dent = Mirror((pad(*place, depth_mm, sigma_mm, view.rig.rubber),))
                    found.append(_read(view, dent, depth_mm, sigma_mm, off_mm, rng))
                    advance("thin")
    return found


def _read(
    view: View, dent: Mirror, depth_mm: float, sigma_mm: float, off_mm: float, rng: np.random.Generator
) -> Reading:
    warp = view.warp(dent, rng)
    clean = view.reader.read(warp)
    warp.flags[np.asarray(clean.seam)] |= np.uint16(Flag.SEAM)
    surface = view.reader.read(warp)
    error = surface.depth_mm - dent.depth(surface.x_mm, surface.y_mm)
    valid = surface.valid
    far = np.abs(error)[valid] > FAR_SIGMAS * surface.sigma_depth_mm[valid]
    return Reading(
        sigma_mm,
        off_mm,
        float(100 * np.abs(error[valid]).max() / depth_mm),
        float(100 * (peak(surface).depth_mm / depth_mm - 1)),
        largest_step_nm(error, surface),
        float(far.mean()),
    )


class _Sawn(Truth):
    """A drawn saw; its rest map's windows mix both sides of a seam."""

    def warp(self, mirror: Mirror) -> Warp:
        warp, dented = super().warp(mirror), Dented(self.optics.rest, mirror)
        u, v = self.grid.mesh()
        around = [self.optics.trace(u + by, v, dented).q for by in MIXED_PX]
        mixed = np.abs(np.mean(around, axis=0) - warp.q).max(axis=-1) > JUMP_PX
        warp.q[mixed] = np.mean([warp.q, *around], axis=0)[mixed]
        return warp


def calibrated(number: int) -> list[dict[str, Any]]:
    """Of one unknown bench, calibrated from both sets of data: errors of depth, percent, and over sigma."""
    rng = generator(20, number)
    nominal = binned(load_rig("thin"), BINNING)
    priors = Priors.of(nominal)
    bench = _Sawn(priors.at(priors.within(rng.standard_normal(len(priors.names)))), rng)
    rest = bench.warp(Mirror())
    reading, seams = RestReading.of(bench.grid, rest), ToothSeams.of(nominal, bench.grid, rest)
    known = Presses.of(reading, [bench.known_press(share) for share in (0.25, 0.5, 0.75)])
    others = Presses.of(reading, [_other(bench, rng) for _ in range(TESTS)])
    data: list[Measurement] = [RestPositions.of(bench.grid, rest), *([] if seams is None else [seams])]
    found, error = [], None
    for case, more in zip(CASES, ([], [known]), strict=True):
        fitted = fit(priors, [*data, *more])
        derivatives = depth_error(fitted, bench.grid, reading) if error is None else error
        error = replace(derivatives, covariance=fitted.covariance)
        rig = fitted.rig.replace({"geometry": {"known": "calibrated", **error.modes}})
        peaks = Presses.of(reading.prepared(rig), others.presses).peaks(rig)
        errors = np.array([peak.depth_mm for peak in peaks]) / others.measured - 1.0
        sigmas = np.array([peak.sigma_mm / peak.depth_mm for peak in peaks])
        over = (errors / sigmas).tolist()
        found.append({"case": case, "errors": (100 * errors).tolist(), "over_sigma": over})
    return found


def _other(bench: Truth, rng: np.random.Generator) -> KnownPress:
    """Any other press, as its exact depth knows it."""
    place, sigma_mm = bench.place(rng.uniform(0.2, 0.8), rng.uniform(0.3, 0.7)), rng.uniform(2.0, 6.0)
    depth_mm = rng.uniform(0.1, 0.25) * FOLD_MM_5 * (sigma_mm / 5.0) ** 2
    warp = bench.warp(Mirror((pad(*place, depth_mm, sigma_mm, bench.rig.rubber),)))
    return KnownPress("other", warp, depth_mm, depth_mm)


def _calibrated_figures(benches: list[list[dict[str, Any]]]) -> list[Figure]:
    figures = []
    for case in CASES if benches else ():
        mine = [one for bench in benches for one in bench if one["case"] == case]
        off = [rms(one["errors"]) for one in mine]
        over = rms([value for one in mine for value in one["over_sigma"]])
        worst, all_ = max(off), rms(off)
        words = f"{all_:.2f} %, worst bench {worst:.2f} %"
        figures += [
            Figure(f"calibrated, {case}: depth, rms of {len(mine)} benches", words, f"{MOST_CALIBRATED} %",
                   all_ <= MOST_CALIBRATED),
            Figure(f"calibrated, {case}: error over sigma", f"{over:.2f}", "0.5 to 1.5", 0.5 <= over <= 1.5),
        ]  # fmt: skip
    return figures


@benchmark(
    "thin",
    __doc__,
    click.option("--draws", type=Whole(min=1), help="Of each dent.  [default: 8, --quick: 1]"),
    click.option("--benches", type=Whole(min=0), help="To calibrate.  [default: 10, --quick: 2]"),
    part_options,
    salt_option,
)
def command(
    quick: bool, draws: int | None, benches: int | None, keep: Path | None, most_runs: int | None
) -> Report:
    """Read all dents; the seams' width is the rig's. Runs that are kept are calibrated benches."""
    found = readings(draws or (1 if quick else 8))
    count = (2 if quick else 10) if benches is None else benches
    unknown = Parts(keep, most_runs).run(count, "benches", calibrated)
    seams = seam_figures(SampledView(load_rig("thin")))
    assert seams is not None
    worst = max(one.worst_percent for one in found)
    summit = max(abs(one.peak_percent) for one in found)
    step = max(one.step_nm for one in found)
    band = seams["band_mm"]
    far = float(np.mean([one.far_share for one in found]))
    figures = [
        figure("error of any node, worst, over the peak", 0.01 * worst, unit="%", most=0.007),
        Figure("peak", f"{summit:.2f} %", f"{MOST_PERCENT} %", summit <= MOST_PERCENT),
        Figure("nodes beyond 3 sigma", f"{far:.2%}", f"{MOST_FAR:.0%}", far <= MOST_FAR),
        Figure("mirror that a seam hides", f"{band:.2f} mm", f"{MOST_BAND_MM} mm", band <= MOST_BAND_MM),
        figure("step across a seam, worst", step, unit="nm", most=150.0),
        Figure("nodes that see a seam", f"{seams['nodes_share']:.1%}"),
        *_calibrated_figures(unknown),
    ]
    details = [["sigma, mm", "off a seam, mm", "worst node, %", "peak, %", "step, nm", "beyond 3 sigma"]]
    details += [
        [
            f"{one.sigma_mm:g}", f"{one.off_mm:g}", f"{one.worst_percent:.3f}", f"{one.peak_percent:+.3f}",
            f"{one.step_nm:.0f}", f"{one.far_share:.1%}",
        ]
        for one in found
    ]  # fmt: skip
    data = {"seams": seams, "readings": [asdict(one) for one in found], "benches": unknown}
    return Report("Depth on the thin saw", figures, details, data)


if __name__ == "__main__":
    start(command)
