"""The paper's figures and tables on the simulated bench, and what this system reads of the same press."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.optics import Optics
from zeromethod.paper.lattice_reading import (
    LatticeReading,
    layers_error_percent,
    read_images,
    read_picks,
    scatter,
)
from zeromethod.paper.needle_reading import NeedleResult, reproduce_needle
from zeromethod.paper.press import LatticeView
from zeromethod.paper.press_reading import SurfaceReading, read_whole_image, read_zero
from zeromethod.paper.printed_lattice import photograph
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.scenario import scenario_of

Figures = dict[str, Any]

PRESS = "paper"
"""The packaged press of section 5: 0.2 mm deep, held at the mirror's middle; by formula, on no rubber."""
PAPER_PRESS: Figures = {"peak_mm": 0.2, "peak_error_percent": 10.0}
"""Section 5: pressed "about 0.2 mm", error "approximately 10 percent at the peak area"."""
SHIFT_MM = 1.25
"""Half a lattice pitch: how far the presses of the scatter move along l, and from there on along y."""

STEPS = (
    "needle of section 3.1",
    "drawing the press of section 5",
    "reading the lattice",
    "all pixels of the two images",
    "closing the loop",
    "the press moved against the lattice",
)


@dataclass(frozen=True)
class Reproduction:
    """What `zeromethod reproduce` finds; pictures are drawn from it.

    Attributes
    ----------
    rig : Rig
        The paper's bench.
    press : Mirror
        The planted press.
    needle : NeedleResult
        Section 3.1.
    before, after : (rows, cols) array
        Camera images.
    whole, between : LatticeReading
        The paper's method with whole-pixel and with sub-pixel picks.
    pixels, pixels_own_window : SurfaceReading
        All pixels, with the window of `press_reading.WINDOW_PITCHES` and with those that the
        correlation chooses.
    zero : SurfaceReading
        The zero method.
    scatter_percent : (n, 4) array
        See `lattice_reading.scatter`: the press moved by up to half a lattice pitch.
    layers_percent : dict
        Error at the peak without error of picks, by what lies on the prism.
    """

    rig: Rig
    press: Mirror
    needle: NeedleResult
    before: NDArray[np.generic]
    after: NDArray[np.generic]
    whole: LatticeReading
    between: LatticeReading
    pixels: SurfaceReading
    pixels_own_window: SurfaceReading
    zero: SurfaceReading
    scatter_percent: Float
    layers_percent: dict[str, float]

    def truth_along_line(self, points: int = 801) -> tuple[Float, Float]:
        """(l, depth), each (points,) mm: the planted mirror at y = 0.

        Parameters
        ----------
        points : int
            How many.

        Returns
        -------
        along_mm, depth_mm : (points,) array
            Place along the mirror, and depth.
        """
        along = np.linspace(0.0, Optics(self.rig).length_mm, points)
        return along, self.press.depth(along, np.zeros_like(along))

    def figures(self) -> Figures:
        """All figures as JSON can say them; None where there is none.

        Returns
        -------
        dict
            The figures.
        """
        columns = {
            "paper": PAPER_PRESS,
            "whole_pixel_picks": _of_lattice(self.whole),
            "sub_pixel_picks": _of_lattice(self.between),
            "whole_image": _of_surface(self.pixels),
            "zero_method": _of_surface(self.zero),
        }
        view = LatticeView.of(self.rig)
        centred = [
            read_picks(view, each.line, self.press, step="centred") for each in (self.whole, self.between)
        ]
        picks = ("whole_pixel_picks", "sub_pixel_picks")
        names = (*picks, *(f"{name}_without_lag" for name in picks))
        return {
            "rig": self.rig.name,
            "seed": self.rig.simulation.seed,
            "press": columns,
            "press_without_lag": {name: _of_lattice(each) for name, each in zip(picks, centred, strict=True)},
            "press_moved": {
                name: _spread(errors) for name, errors in zip(names, self.scatter_percent.T, strict=True)
            },
            "error_percent_without_pick_error": self.layers_percent,
            "whole_image_own_window": _of_surface(self.pixels_own_window),
            "needle": self.needle.figures(),
        }


def _of_lattice(reading: LatticeReading) -> Figures:
    names = ("peak_mm", "peak_error_percent", "line_rms_um")
    return {name: getattr(reading, name) for name in names} | {"points": len(reading.true_mm)}


def _of_surface(reading: SurfaceReading) -> Figures:
    names = ("peak_mm", "peak_error_percent", "line_rms_um", "view_rms_um", "points", "frames", "reason")
    return {name: getattr(reading, name) for name in names}


def _spread(errors: Float) -> Figures:
    return {
        "positions": len(errors),
        "median_percent": float(np.median(errors)),
        "least_percent": float(np.min(errors)),
        "most_percent": float(np.max(errors)),
        "share_from_5_to_20_percent": float(np.mean((np.abs(errors) >= 5.0) & (np.abs(errors) <= 20.0))),
    }


def reproduce(advance: Callable[[str], None] | None = None, *, quick: bool = False) -> Reproduction:
    """Reproduce sections 3.1 and 5 of the paper on the packaged rig "paper"; the same figures every time.

    Parameters
    ----------
    advance : callable, optional
        Called after each of `STEPS` with the name of the next.
    quick : bool
        Fewer positions in the scatter, and fewer frames in the loop.

    Returns
    -------
    Reproduction
        Every figure, and what pictures are drawn from.

    Raises
    ------
    MeasurementError
        Where the lattice is not found in the image; a zero method that never nulls says so in
        its reading.
    """
    next_step = advance or (lambda _: None)
    rig = load_rig("paper").replace({"rubber.body": "none", "rubber.support": None}, scenario=PRESS)
    scenario = scenario_of(rig)
    press = scenario.mirror_at(round(0.5e9 * scenario.duration_s))
    needle = reproduce_needle()
    next_step(STEPS[1])
    before, after = photograph(rig, [Mirror(), press])
    next_step(STEPS[2])
    whole, between = read_images(rig, before, after, press)
    layers_percent = layers_error_percent(rig, press)
    next_step(STEPS[3])
    pixels = read_whole_image(rig, before, after, press)
    pixels_own_window = read_whole_image(rig, before, after, press, own_window=True)
    next_step(STEPS[4])
    zero = read_zero(rig, press, seconds=0.35 if quick else 0.6)
    next_step(STEPS[5])
    along, across = (3, 1) if quick else (5, 3)
    shifts_mm = np.linspace(-SHIFT_MM, SHIFT_MM, along), np.linspace(0.0, SHIFT_MM, across)
    scatter_percent = scatter(rig, shifts_mm)
    next_step("")
    return Reproduction(
        rig=rig,
        press=press,
        needle=needle,
        before=before,
        after=after,
        whole=whole,
        between=between,
        pixels=pixels,
        pixels_own_window=pixels_own_window,
        zero=zero,
        scatter_percent=scatter_percent,
        layers_percent=layers_percent,
    )
