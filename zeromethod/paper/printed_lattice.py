"""The paper's sensor on the simulated bench: a fixed lattice, photographed with every press.

Pictures are drawn with exact rays (see `zeromethod.simulation.numpy_renderer`) and the camera's own noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Float
from zeromethod.paper.press import PITCH_MM
from zeromethod.pattern import Response
from zeromethod.rig.model import DisplaySpec, Rig
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.sensor import Sensor

LINE_MM = 0.4
"""Width of the dark lines: not given in the paper, a choice."""
DARK, LIGHT = 0.05, 0.95
"""Light of the lines and of the ground, shares of the panel's full light."""


def lattice_picture(display: DisplaySpec) -> Bytes:
    """LCD grey codes (rows, cols) of dark lines every 2.5 mm, one through P0 and one along y = 0.

    Drawn by length, not through any warp: each LCD pixel has the light of the ground that it covers. The
    panel's columns run along the pattern face, as in the rig "paper".
    """
    along = display.centre_mm[0] + display.pitch_mm * _about_middle(display.columns)
    across = display.centre_mm[1] + display.pitch_mm * _about_middle(display.rows)
    ground = np.outer(1.0 - _covered(across, display.pitch_mm), 1.0 - _covered(along, display.pitch_mm))
    codes = Response.from_rig(display).inverse(DARK + (LIGHT - DARK) * ground)
    return np.asarray(np.rint(codes), dtype=np.uint8)


def _about_middle(count: int) -> Float:
    return np.arange(count, dtype=np.float64) - (count - 1) / 2


def _covered(centre_mm: Float, width_mm: float) -> Float:
    """Share of intervals of `width_mm` that the lattice's lines cover."""

    def dark_until(place_mm: Float) -> Float:
        nearest = np.rint(place_mm / PITCH_MM)
        return LINE_MM * nearest + np.clip(place_mm - PITCH_MM * nearest, -LINE_MM / 2, LINE_MM / 2)

    dark_mm = dark_until(centre_mm + width_mm / 2) - dark_until(centre_mm - width_mm / 2)
    return np.asarray(dark_mm / width_mm)


def photograph(rig: Rig, mirrors: Sequence[Mirror]) -> list[NDArray[np.generic]]:
    """Draw the image (rows, cols) of the lattice by each mirror; the noise is that of frames 0, 1, ..."""
    renderer, sensor = NumpyRenderer(rig), Sensor(rig)
    handle = renderer.upload(lattice_picture(rig.display))
    always = np.ones(rig.display.rows, dtype=np.float32)
    images = []
    for number, mirror in enumerate(mirrors):
        light = renderer.expose([Piece(1.0, mirror, [(handle, always)])])
        images.append(np.array(sensor.image(light, number)))
    renderer.close()
    return images
