"""Depth read on the thin saw: dents of sigma 1.5 to 8 mm anywhere on the face, on seams, over three teeth.

The packaged rig `thin`, its geometry known. Warps are exact rays with one frame's noise; what sees a seam
is not in them. Dents are 0.3 of their fold limit deep (of sigma 8 mm 0.15, which still ends on the LCD). A
step is the difference, between the nodes to either side of a seam, of the mean error of depth.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import click
import numpy as np

from benchmarks.anchors import View
from benchmarks.dents import Planted, gauss
from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.arrays import Float
from zeromethod.cli.numbers import Whole
from zeromethod.design.sampled_view import SampledView
from zeromethod.design.seams import seam_figures
from zeromethod.rig.load import load_rig
from zeromethod.surface import Surface, peak
from zeromethod.view.progress import progress
from zeromethod.warp.validity import Flag

SIGMAS_MM = (1.5, 2.0, 3.0, 5.0, 8.0)
OFF_SEAM_MM = (0.0, 1.4, 4.15)
"""From a seam: on it, where its nodes' neighbours are, in the middle of a tooth."""
FOLD_MM_5 = 0.66
"""Depth at which a dent of sigma 5 mm folds; it grows as sigma squared."""
SHARE, WIDE_SHARE, WIDE_MM = 0.3, 0.15, 6.0
MOST_PERCENT, MOST_BAND_MM, MOST_STEP_NM, MOST_FAR = 0.5, 0.6, 50.0, 0.01
FAR_SIGMAS = 3.0


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
    rng = np.random.default_rng(20)
    middle = view.reader.read(view.warp(Planted(gauss, 1e-4, 41.0, 0.0, 2.0)))
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
                    dent = Planted(gauss, depth_mm, at_mm + off_mm, y_mm, sigma_mm)
                    found.append(_read(view, dent, depth_mm, sigma_mm, off_mm, rng))
                    advance("thin")
    return found


def _read(
    view: View, dent: Planted, depth_mm: float, sigma_mm: float, off_mm: float, rng: np.random.Generator
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


@benchmark(
    "thin",
    __doc__,
    click.option("--draws", type=Whole(min=1), help="Of each dent.  [default: 8, --quick: 1]"),
)
def command(quick: bool, draws: int | None) -> Report:
    """Read all dents; the seams' width is the rig's."""
    found = readings(draws or (1 if quick else 8))
    seams = seam_figures(SampledView(load_rig("thin")))
    assert seams is not None
    worst = max(one.worst_percent for one in found)
    summit = max(abs(one.peak_percent) for one in found)
    step = max(one.step_nm for one in found)
    band = seams["band_mm"]
    far = float(np.mean([one.far_share for one in found]))
    figures = [
        Figure(
            "depth of any node, over the peak", f"{worst:.2f} %", f"{MOST_PERCENT} %", worst <= MOST_PERCENT
        ),
        Figure("peak", f"{summit:.2f} %", f"{MOST_PERCENT} %", summit <= MOST_PERCENT),
        Figure("nodes beyond 3 sigma", f"{far:.2%}", f"{MOST_FAR:.0%}", far <= MOST_FAR),
        Figure("mirror that a seam hides", f"{band:.2f} mm", f"{MOST_BAND_MM} mm", band <= MOST_BAND_MM),
        Figure("step across a seam", f"{step:.0f} nm", f"{MOST_STEP_NM:.0f} nm", step <= MOST_STEP_NM),
        Figure("nodes that see a seam", f"{seams['nodes_share']:.1%}"),
    ]
    details = [["sigma, mm", "off a seam, mm", "worst node, %", "peak, %", "step, nm", "beyond 3 sigma"]]
    details += [
        [
            f"{one.sigma_mm:g}", f"{one.off_mm:g}", f"{one.worst_percent:.3f}", f"{one.peak_percent:+.3f}",
            f"{one.step_nm:.0f}", f"{one.far_share:.1%}",
        ]
        for one in found
    ]  # fmt: skip
    data = {"seams": seams, "readings": [asdict(one) for one in found]}
    return Report("Depth on the thin saw", figures, details, data)


if __name__ == "__main__":
    start(command)
