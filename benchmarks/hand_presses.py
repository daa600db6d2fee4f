"""Presses as hands make them, and which of them a rig can null whole, by its geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from benchmarks.calibration_benches import View
from benchmarks.pads import STEEPEST, pad
from zeromethod.optics import Dented, Optics
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.validity import Flag

NARROWEST_MM = 4.0
"""Sigma of the narrowest: 2.4 nodes of a bench with four times larger pixels, as 1 mm is at full size."""
MOST_SLOPE, DEEPEST_MM = 0.012, 0.3
_STEP_PX = 2
"""Distance of the rays: next to the rim of a ball's contact the mirror bends within less than a node."""
_SEAM_STEPS, _SHALLOWER = 5, 0.7
"""Of a saw: rays at a seam's jump are fewer; and how much less deep a press is until it can be nulled."""


def any_press(view: View, draw: np.random.Generator) -> tuple[Dent, ...]:
    """A press as hands make them: narrow or far wider than the view, its middle out of view, too."""
    x, y = view.place(float(draw.uniform(-0.15, 1.15)), float(draw.uniform(-0.15, 1.15)))
    size_mm = float(np.exp(draw.uniform(np.log(NARROWEST_MM), np.log(40.0))))
    depth_mm = min(MOST_SLOPE * draw.uniform(0.1, 1.0) * size_mm / STEEPEST, DEEPEST_MM)
    if draw.uniform() < 0.2:
        contact_mm = float(draw.uniform(4.0, 8.0))
        depth_mm = min(depth_mm, 0.1)
        return (Dent(Shape.BALL, x, y, depth_mm, contact_mm**2 / depth_mm),)
    return (pad(x, y, depth_mm, size_mm, view.rubber),)


def can_be_nulled(rig: Rig, dents: Sequence[Dent]) -> bool:
    """Whether no part of the view, between the nodes either, folds or is too fine for the LCD: exact rays."""
    optics, period = Optics(rig), rig.target.period_px
    rows, columns = (np.arange(period, n - period, _STEP_PX) for n in (rig.camera.rows, rig.camera.columns))
    u, v = np.meshgrid(columns.astype(np.float64), rows.astype(np.float64))
    rest = optics.trace(u, v, optics.rest).q
    q = optics.trace(u, v, Dented(optics.rest, Mirror(tuple(dents)))).q
    size = rig.display.columns, rig.display.rows
    at_rest, pressed = (warp_flags(one, rest, period, size, spacing_px=_STEP_PX) for one in (rest, q))
    seen = (at_rest == 0) & np.isfinite(q).all(axis=-1)
    bad = seen & (pressed & np.uint16(Flag.FOLDED | Flag.UNDRAWABLE) != 0)
    if rig.prism.teeth is not None:
        bad = cv2.morphologyEx(bad.view(np.uint8), cv2.MORPH_OPEN, np.ones((1, _SEAM_STEPS), np.uint8)) > 0
    return not bad.any()


def shallow_enough(rig: Rig, dents: Sequence[Dent]) -> tuple[Dent, ...]:
    """Presses of the same width that the rig can null whole; a ball's contact stays as wide."""
    while not can_be_nulled(rig, dents):
        dents = [
            replace(
                one,
                depth_mm=_SHALLOWER * one.depth_mm,
                size_mm=one.size_mm / (_SHALLOWER if one.shape is Shape.BALL else 1.0),
            )
            for one in dents
        ]
    return tuple(dents)
