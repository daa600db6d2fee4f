"""Section 5 of the paper on the simulated bench: one press, read off one line of lattice crossings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.devices.protocols import TrueMirror
from zeromethod.errors import MeasurementError
from zeromethod.optics import Dented, Optics
from zeromethod.paper.picks import Picks, pick
from zeromethod.paper.press import LatticeView
from zeromethod.paper.printed_lattice import photograph
from zeromethod.paper.series import Series
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape

DEPTH_MM, SIGMA_MM = 0.2, 5.0
"""The press of section 5: "about 0.2 mm" is given; its width is not, 5 mm is this project's choice."""
_MIN_CROSSINGS = 3
_BAND_ROWS = 132


@dataclass(frozen=True, slots=True)
class LatticeReading:
    """The paper's reading of a press.

    line: the crossings used, px. series: mm and rad at these. true_mm: (n,) planted depth at series.l.
    peak_mm: deepest point read; peak_true_mm: deepest true point of the line.
    """

    line: Picks
    series: Series
    true_mm: Float
    peak_true_mm: float

    @property
    def peak_mm(self) -> float:
        """Deepest point of the average of rises and drops."""
        return float(self.series.depth.max())

    @property
    def peak_error_percent(self) -> float:
        """Error of the deepest point."""
        return 100 * (self.peak_mm / self.peak_true_mm - 1)

    @property
    def line_rms_um(self) -> float:
        """Error of the average over all points of the line."""
        return 1e3 * float(np.sqrt(np.mean((self.series.depth - self.true_mm) ** 2)))


def read_picks(
    view: LatticeView, line: Picks, truth: TrueMirror, *, step: Literal["printed", "centred"] = "printed"
) -> LatticeReading:
    """Reconstruct the mirror along one line of picks and compare it with the truth at y = 0.

    step: equation 19 as printed, or without its lag of one interval; see `lattice.series.reconstruct`.
    """
    series = view.series(line.before[:, 0], line.after[:, 0], step=step)
    along = np.linspace(0.0, view.length_mm, 4001)
    return LatticeReading(
        line=line,
        series=series,
        true_mm=truth.depth(series.l, np.zeros_like(series.l)),
        peak_true_mm=float(truth.depth(along, np.zeros_like(along)).max()),
    )


def read_images(
    rig: Rig, before: NDArray[np.generic], after: NDArray[np.generic], truth: TrueMirror
) -> tuple[LatticeReading, LatticeReading]:
    """Read a press off the middle line of two images: with whole-pixel picks, as by hand, and between pixels.

    Raises MeasurementError where fewer than three crossings are visible.
    """
    view = LatticeView.of(rig)
    line = pick(before, after, view.period_px, view.origin_px).line(0)
    if len(line.index) < _MIN_CROSSINGS:
        raise MeasurementError(f"only {len(line.index)} crossings are visible along the middle of the image")
    return read_picks(view, line.whole(), truth), read_picks(view, line, truth)


def scatter(rig: Rig, shifts_mm: tuple[Float, Float]) -> Float:
    """Error at the peak, %, of presses moved against the lattice, (n, 4).

    Columns: whole-pixel and sub-pixel picks with equation 19 as printed, then both without its lag.

    shifts_mm: shifts along l and along y, all pairs. Only the middle `_BAND_ROWS` of the camera are drawn.
    """
    band = _middle_rows(rig)
    middle_mm = Optics(rig).length_mm / 2
    mirrors = [
        Mirror((Dent(Shape.GAUSSIAN, middle_mm + x, y, DEPTH_MM, SIGMA_MM),))
        for y in shifts_mm[1]
        for x in shifts_mm[0]
    ]
    before, *after = photograph(band, [Mirror(), *mirrors])
    readings = []
    for image, mirror in zip(after, mirrors, strict=True):
        pair = read_images(band, before, image, mirror)
        view = LatticeView.of(band)
        centred = (read_picks(view, each.line, mirror, step="centred") for each in pair)
        readings.append([each.peak_error_percent for each in (*pair, *centred)])
    return np.array(readings)


def _middle_rows(rig: Rig) -> Rig:
    """The rig with the middle rows of its camera alone, which is faster to draw."""
    column, row = rig.camera.centre_px
    update = {"rows": _BAND_ROWS, "centre_px": (column, row - (rig.camera.rows - _BAND_ROWS) // 2)}
    return rig.model_copy(update={"camera": rig.camera.model_copy(update=update)})


def without_pick_error(rig: Rig, truth: TrueMirror) -> LatticeReading:
    """Read the press off the very places where the middle line's crossings are seen, by exact rays.

    What is left is the method's own error: series, approximations, and the layers that it does not know.
    """
    view, optics = LatticeView.of(rig), Optics(rig)
    rest_px = view.resting_px()
    row = view.origin_px[1]
    drawn = optics.rest_map(rest_px, np.full_like(rest_px, row))[:, 0]
    fine = np.linspace(rest_px[0] - 1.0, rest_px[-1] + 1.0, 20001)
    seen = optics.trace(fine, np.full_like(fine, row), Dented(optics.rest, truth)).q[:, 0]
    after_px = np.interp(drawn, seen, fine)
    index = np.stack([np.arange(len(rest_px)) + 1, np.zeros(len(rest_px))], axis=-1).astype(np.int64)
    before, after = (np.stack([u, np.full_like(u, row)], axis=-1) for u in (rest_px, after_px))
    return read_picks(view, Picks(index, before, after), truth)


def layers_error_percent(rig: Rig, truth: TrueMirror) -> dict[str, float]:
    """Error at the peak of picks without error: on the bare prism, with the acryl, and with the gap too."""
    layers = rig.pattern_layers
    stacks = {"bare": (), "acryl": tuple(slab for slab in layers if slab.index > 1.0), "as built": layers}
    return {
        name: without_pick_error(rig.model_copy(update={"pattern_layers": stack}), truth).peak_error_percent
        for name, stack in stacks.items()
    }
