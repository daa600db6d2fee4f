"""Objects in contact, and a cloth, in the terms of bench_touch.glsl."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from zeromethod.arrays import Float
from zeromethod.gl import float_texture
from zeromethod.simulation.cloth import BORDER, Cloth
from zeromethod.simulation.contact.touch import FAR, Touch
from zeromethod.simulation.gpu_bench import Values


def touch_values(touches: Sequence[Touch], middle_mm: Float) -> Values:
    """Uniforms; `middle_mm` (3,) is the world position of the shader's origin."""
    place, turn, first_row = [], [], 0
    for touch in touches:
        rows, cols = touch.level.shape
        angle = np.radians(touch.angle_deg)
        x, y = touch.x_mm - middle_mm[0], touch.y_mm - middle_mm[1]
        place.append([x, y, 1 / touch.pitch_mm, float(first_row)])
        turn.append([float(np.cos(angle)), float(np.sin(angle)), float(cols), float(rows)])
        first_row += rows
    albedo = [touch.albedo for touch in touches]
    return {"touch_place": place, "touch_turn": turn, "touch_albedo": albedo} if touches else {}


def level_texture(context: moderngl.Context, touches: Sequence[Touch]) -> moderngl.Texture | None:
    """All levels, one lattice below the other; None where nothing touches."""
    if not touches:
        return None
    cols = max(touch.level.shape[1] for touch in touches)
    padded = [
        np.pad(touch.level, ((0, 0), (0, cols - touch.level.shape[1])), constant_values=FAR)
        for touch in touches
    ]
    return float_texture(context, np.vstack(padded))


def cloth_values(cloth: Cloth, middle_mm: Float) -> Values:
    """Uniforms of a cloth; `middle_mm` (3,) is the world position of the shader's origin."""
    spec = cloth.spec
    c, s = (one / spec.weave_mm for one in cloth.turn)
    return {
        "cloth_place": [-middle_mm[0], -middle_mm[1], c, s],
        "cloth_points": [*cloth.radii, BORDER, 1 / spec.give_mm],
        "cloth_albedo": spec.albedo,
    }
