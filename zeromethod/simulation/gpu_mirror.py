"""A mirror in the terms of bench_mirror.glsl: dents to call, their numbers, maps as splines."""

from __future__ import annotations

from math import erf

import moderngl
import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.gl import float_texture
from zeromethod.optics.mirror import rest_heights
from zeromethod.rig.model import RestSurface
from zeromethod.simulation.gpu_bench import Values
from zeromethod.simulation.press import SAMPLED, Dent, Mirror, Shape
from zeromethod.simulation.spline import line_coefficients

_SAMPLED = "at, dent_place[{i}], dent_shape[{i}], dent_maps, dent_more[{i}].z, field);"
_FIELD = {
    Shape.GAUSSIAN: "gaussian(at, dent_place[{i}], field);",
    Shape.BALL: "ball(at, dent_place[{i}], dent_shape[{i}], field);",
    Shape.CONE: "cone(at, dent_place[{i}], dent_shape[{i}], field);",
    Shape.EDGE: "edge(at, dent_place[{i}], dent_shape[{i}], field);",
    Shape.MAP: f"height_map({_SAMPLED}",
    Shape.RADIAL: f"radial({_SAMPLED}",
    Shape.WHOLE_PLANE: f"whole_plane({_SAMPLED}",
}
_ROUND_TOUCH = "left = min(left, round_touch(at, dent_place[{i}], dent_more[{i}]));"
_STRAIGHT_TOUCH = "left = min(left, straight_touch(at, dent_place[{i}], dent_shape[{i}], dent_more[{i}]));"


def acting_dents(mirror: Mirror) -> tuple[Dent, ...]:
    """Those dents that change anything."""
    return tuple(dent for dent in mirror.dents if dent.depth_mm != 0.0)


def mirror_defines(dents: tuple[Dent, ...]) -> dict[str, int | str]:
    """Constants of bench_mirror.glsl: one program serves all mirrors with the same shapes in a row."""
    touches = [_STRAIGHT_TOUCH if d.length_mm else _ROUND_TOUCH for d in dents]
    return {
        "DENTS": max(len(dents), 1),
        "EACH_DENT": " ".join(_FIELD[dent.shape].format(i=i) for i, dent in enumerate(dents)),
        "EACH_TOUCH": " ".join(call.format(i=i) for i, call in enumerate(touches)),
    }


def _numbers(dent: Dent, first_row: int) -> tuple[list[float], list[float], list[float]]:
    """(w of dent_place after x, y, depth; dent_shape; dent_more) as the functions of bench_dents.glsl say."""
    size, depth = dent.size_mm, dent.depth_mm
    turn = [float(np.cos(np.radians(dent.angle_deg))), float(np.sin(np.radians(dent.angle_deg)))]
    more = [
        dent.contact_mm if dent.touches else -1.0,
        dent.touch_reflectance,
        float(first_row),
        0.5 * dent.length_mm,
    ]
    if dent.shape is Shape.GAUSSIAN:
        return [0.5 / size**2], [0.0] * 4, more
    if dent.shape is Shape.BALL:
        contact2 = size * abs(depth)
        return [contact2**0.5], [1.0 / (np.pi * contact2), 0.0, 0.0, 0.0], more
    if dent.shape is Shape.CONE:
        return [size], [2.0 * depth / (np.pi * size), 0.0, 0.0, 0.0], more
    if dent.shape is Shape.EDGE:
        steepness = 1.0 / (np.sqrt(2.0) * size)
        scale = 0.5 * depth / erf(0.5 * dent.length_mm * steepness)
        return [steepness], [*turn, 0.5 * dent.length_mm, scale], more
    rows, cols = _coefficients(dent).shape
    if dent.shape is Shape.RADIAL:
        return [1.0 / size**2], [float(cols - 3), 0.0, 0.0, 0.0], more
    return [1.0 / size], [*turn, float(cols), float(rows)], more


def _coefficients(dent: Dent) -> Float:
    if dent.map_coefficients is None:
        raise InputError("press: shape 'map': no height map given, a .npy of depths is needed")
    return dent.map_coefficients


def mirror_values(dents: tuple[Dent, ...], middle_mm: Float) -> Values:
    """Uniforms of the dents; `middle_mm` (3,) is the world position of the shader's origin."""
    place, shape, more = [], [], []
    first_row = 0
    for dent in dents:
        last, of_shape, of_touch = _numbers(dent, first_row)
        place.append([dent.x_mm - middle_mm[0], dent.y_mm - middle_mm[1], dent.depth_mm, *last])
        shape.append(of_shape)
        more.append(of_touch)
        first_row += len(_coefficients(dent)) if dent.shape in SAMPLED else 0
    return {"dent_place": place, "dent_shape": shape, "dent_more": more} if dents else {}


def map_texture(context: moderngl.Context, dents: tuple[Dent, ...]) -> moderngl.Texture | None:
    """Coefficients of all maps and tables, one below the other; None where no dent has any."""
    blocks = [_coefficients(dent) for dent in dents if dent.shape in SAMPLED]
    if not blocks:
        return None
    cols = max(block.shape[1] for block in blocks)
    stacked = np.vstack([np.pad(block, ((0, 0), (0, cols - block.shape[1]))) for block in blocks])
    return _in_fours(context, stacked)


def rest_code(rest: RestSurface) -> int:
    """REST of bench_mirror.glsl."""
    return ("flat", "sphere", "map", "cylinder").index(rest.shape)


def rest_values(rest: RestSurface, middle_mm: Float) -> Values:
    """Constants of the rest surface."""
    if rest.shape in ("sphere", "cylinder"):
        centre = [rest.centre_mm[0] - middle_mm[0], rest.centre_mm[1] - middle_mm[1]]
        turn = np.radians(rest.axis_deg)
        off_axis = np.array([-np.sin(turn), np.cos(turn)])
        return {"rest_sphere": np.array([*centre, rest.radius_mm]), "rest_off_axis": off_axis}
    if rest.shape == "map" and rest.pitch_mm is not None:
        # the first coefficient lies one pitch before the first height
        first = np.array(rest.origin_mm) - rest.pitch_mm - middle_mm[:2]
        return {"rest_grid": np.array([*first, rest.pitch_mm])}
    return {}


def rest_texture(context: moderngl.Context, rest: RestSurface) -> moderngl.Texture | None:
    """B-spline coefficients of the rest surface's map; None where it has none. InputError if unreadable."""
    if rest.shape != "map":
        return None
    return _in_fours(context, line_coefficients(line_coefficients(rest_heights(rest)).T).T)


def _in_fours(context: moderngl.Context, coefficients: Float) -> moderngl.Texture:
    """Texture whose texel (row, col) holds the coefficients (row, col) to (row, col + 3)."""
    fours = np.lib.stride_tricks.sliding_window_view(coefficients.astype(np.float32), 4, axis=1)
    return float_texture(context, fours)
