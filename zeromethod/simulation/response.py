"""The simulated panel's light for each grey code, straight from the rig file."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from zeromethod.arrays import Float
from zeromethod.rig.model import DisplaySpec


def light_of_codes(display: DisplaySpec) -> Float:
    """(256,) light 0..1 of the grey codes 0..255."""
    codes = np.arange(256) / 255.0
    if display.response_light is not None:
        knots = np.linspace(0.0, 1.0, len(display.response_light))
        return np.interp(codes, knots, display.response_light)
    return codes**display.gamma


def exponents(display: DisplaySpec) -> Float:
    """(rows, cols) exponent of the light of every pixel of the panel."""
    if display.response_exponent is None:
        return np.ones((display.rows, display.columns))
    given = np.array(display.response_exponent)
    corners = tuple(np.linspace(0.0, 1.0, count) for count in given.shape)
    field = RegularGridInterpolator(corners, given)
    down, across = np.linspace(0.0, 1.0, display.rows), np.linspace(0.0, 1.0, display.columns)
    return np.asarray(field(np.stack(np.meshgrid(down, across, indexing="ij"), axis=-1)))


def code_of_light(display: DisplaySpec, light: float) -> int:
    """Grey code whose light is nearest to `light` (0..1)."""
    return int(np.argmin(np.abs(light_of_codes(display) - light)))
