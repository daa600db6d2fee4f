"""What a bench can do, from its rig alone: every figure of `zeromethod design` in one call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from zeromethod.control.stability_margin import stability_margin
from zeromethod.design.advice import design_warnings
from zeromethod.design.delay_budget import ASSUMED_COMPUTING_S
from zeromethod.design.figures import Figures, design_figures
from zeromethod.design.press_limits import DEFAULT_KINDS, PressKind
from zeromethod.design.resolution import ASSUMED_PUPIL_MM
from zeromethod.design.sampled_view import SampledView
from zeromethod.design.vary import Variation, curves
from zeromethod.optics import check_geometry
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import ControlSpec, Rig

_CONTROLLERS = sorted({*get_args(ControlSpec.model_fields["controller"].annotation)} - {"passive"})


def assess_rig(
    rig: Rig | str | Path,
    *,
    presses: Sequence[str] = (),
    pupil_mm: float | None = None,
    computing_s: float = ASSUMED_COMPUTING_S,
    vary: Sequence[str] = (),
) -> Figures:
    """Figures of what a bench can do, planned or calibrated; nothing is simulated or measured.

    Parameters
    ----------
    rig : Rig, str or Path
        A rig, a rig file, or the name of a packaged rig.
    presses : sequence of str
        Presses whose largest depth is wanted, "load:2", "ball:50", "cone:5", "edge:2" (mm); by default
        one of each kind.
    pupil_mm : float, optional
        Diameter of the lens's entrance pupil; a typical one by default.
    computing_s : float
        Time to read a frame and to draw the next picture.
    vary : sequence of str
        Curves over a quantity, "angle=45:60" or "KEY=FROM:TO:N" with a dotted key of the rig file.

    Returns
    -------
    dict
        "tir", "regions", "presses", "resolution", "noise", "carrier", "delay", "view", "seams" (of a
        saw, else None), "motion", "warnings" and "vary".

    Raises
    ------
    InputError
        For a rig, a press or a variation that cannot be used.
    """
    kinds = [PressKind.parse(text) for text in presses] or list(DEFAULT_KINDS)
    runs = [Variation.parse(text) for text in vary]
    bench = rig if isinstance(rig, Rig) else load_rig(rig)
    check_geometry(bench)
    pupil = ASSUMED_PUPIL_MM if pupil_mm is None else pupil_mm
    view = SampledView(bench)
    figures = design_figures(view, kinds, pupil, computing_s)
    figures["resolution"]["pupil_assumed"] = pupil_mm is None
    figures["delay"] |= stability_figures(bench, figures["delay"]["worst_frames"])
    figures["warnings"] = design_warnings(view, figures)
    figures["vary"] = [curves(bench, run, pupil) for run in runs]
    return figures


def stability_figures(rig: Rig, delay_frames: float) -> Figures:
    """Largest stable gain of each controller at the longest delay, with the rig's own."""
    largest = {
        name: stability_margin(rig.control.model_copy(update={"controller": name}), delay_frames).largest_gain
        for name in _CONTROLLERS
    }
    return {"controller": rig.control.controller, "gain": rig.control.gain, "largest_gain": largest}
