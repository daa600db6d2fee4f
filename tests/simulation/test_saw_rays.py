"""The ray shader of a saw against rays that are followed by hand through the saw's outline, one by one.

Shared is the rig file alone: here a saw is a polygon in the plane y = 0, its sides are crossed one after the
other, and the ray's part along y goes on by Snell's law.
"""

import math

import numpy as np
import pytest

from zeromethod import load_rig
from zeromethod.optics import Dented, Lost, Optics
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.press import Dent, Mirror, Shape

Q_TOLERANCE_PX = 0.02
"""float32 coordinates of up to 60 mm carry 4e-6 mm; a stray ray that grazes a face makes 20 times as much."""

DEEPER = {"prism.teeth.base_deviation_mm": [0.0, 0.02, -0.03, 0.05, 0.0, 0.04, -0.02, 0.01, 0.0, 0.0]}
UNEVEN = {
    "prism.teeth.pattern_deviation_deg": [0.0, 0.1, -0.2, 0.05, 0.15, -0.1, 0.0, 0.1, -0.05, 0.0],
    "prism.teeth.camera_deviation_deg": [0.1, -0.1, 0.2, -0.15, 0.05, 0.1, -0.2, 0.0, 0.1, 0.0],
}


def thin(**values) -> Rig:
    """The packaged rig with few rows of pixels."""
    return load_rig("thin").replace({"camera.rows": 64, "camera.centre_px": (511.5, 31.5), **values})


def outline(rig: Rig) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sides (start, end) of the saw's lower side, from P0 on, counter to how rays run."""
    prism, teeth = rig.prism, rig.prism.teeth
    pitch = prism.mirror_length_mm / teeth.count
    sides = []
    for k in range(teeth.count):
        by = [
            one[k] if one else 0.0
            for one in (teeth.base_deviation_mm, teeth.pattern_deviation_deg, teeth.camera_deviation_deg)
        ]
        a, b = math.radians(prism.pattern_angle_deg + by[1]), math.radians(prism.camera_angle_deg + by[2])
        left, right = (np.array([x, -teeth.base_mm - by[0]]) for x in (k * pitch, (k + 1) * pitch))
        width = pitch * math.tan(b) / (math.tan(a) + math.tan(b))
        tip = left + np.array([width, -width * math.tan(a)])
        sides += [(left, tip), (tip, right)]
    return sides


def next_side(sides, at, way):
    """(distance over |way|, side number) of the first side met, None for none."""
    best = None
    for number, (start, end) in enumerate(sides):
        along = end - start
        area = way[0] * along[1] - way[1] * along[0]
        if area == 0.0:
            continue
        off = start - at[[0, 2]]
        distance = (off[0] * along[1] - off[1] * along[0]) / area
        share = (off[0] * way[1] - off[1] * way[0]) / area
        if distance > 1e-7 and 0.0 <= share <= 1.0 and (best is None or distance < best[0]):
            best = distance, number
    return best


def follow(rig: Rig, u: float, v: float) -> tuple[np.ndarray | None, float, int]:
    """LCD (column, row) or None, light, faces crossed; by the mirror at rest."""
    sides, index, camera, display = outline(rig), rig.prism.index, rig.camera, rig.display
    position, aim = np.array(camera.position_mm), np.array(camera.look_at_mm)
    way = (aim - position) / np.linalg.norm(aim - position)
    up = np.array([0.0, 1.0, 0.0])
    at = position + camera.pixel_mm * (
        (u - camera.centre_px[0]) * np.cross(up, way) + (v - camera.centre_px[1]) * up
    )
    inside, crossed, light = False, 0, 1.0
    for _ in range(14):
        met = next_side(sides, at, way[[0, 2]])
        if met is None and inside and way[2] > 0.0:
            light *= reflectance(way[2], index)
            at, way = at - at[2] / way[2] * way, way * [1.0, 1.0, -1.0]
            continue
        if met is None:
            depth = rig.prism.teeth.base_mm + height(rig) + rig.pattern_layers[0].thickness_mm
            if inside or way[2] > 0.0:
                return None, 0.0, crossed
            at = at + (-depth - at[2]) / way[2] * way
            middle = np.array([display.columns - 1, display.rows - 1]) / 2
            return (at[:2] - display.centre_mm) / display.pitch_mm + middle, light, crossed
        at = at + met[0] * way
        start, end = sides[met[1]]
        along = (end - start) / np.linalg.norm(end - start)
        out = np.array([along[1], 0.0, -along[0]])  # rubber is on the other side
        ahead = out if inside else -out
        n1, n2 = (index, 1.0) if inside else (1.0, index)
        flat = n1 * (way - (way @ ahead) * ahead)
        left = n2 * n2 - flat @ flat
        if left <= 0.0:
            way = way - 2.0 * (way @ ahead) * ahead
            continue
        before, after = n1 * (way @ ahead), math.sqrt(left)
        s = (before - after) / (before + after)
        p = (n2 * n2 * before - n1 * n1 * after) / (n2 * n2 * before + n1 * n1 * after)
        crossed += 1
        light *= 1.0 - 0.5 * (s * s + p * p) if crossed > 2 else 1.0
        way, inside = (flat + after * ahead) / n2, not inside
    return None, 0.0, crossed


def reflectance(cosine: float, index: float) -> float:
    """Of rubber to air, unpolarised (the packaged rig names no polarisation)."""
    beyond = 1.0 - index * index * (1.0 - cosine * cosine)
    if beyond <= 0.0:
        return 1.0
    after = math.sqrt(beyond)
    s = (index * cosine - after) / (index * cosine + after)
    p = (cosine - index * after) / (cosine + index * after)
    return 0.5 * (s * s + p * p)


def height(rig: Rig) -> float:
    a, b = np.tan(np.radians([rig.prism.pattern_angle_deg, rig.prism.camera_angle_deg]))
    return float(rig.prism.mirror_length_mm / rig.prism.teeth.count * a * b / (a + b))


@pytest.mark.parametrize("values", [{}, UNEVEN, DEEPER], ids=["as drawn", "uneven angles", "unequal depth"])
def test_the_shader_follows_rays_face_by_face_stray_ones_too(values, gl_context):
    rig = thin(**values)
    renderer = GpuRenderer(rig, gl_context)
    q, light = renderer.ray_map(Mirror())
    renderer.close()
    astray, wrong, row = 0, 0, 20
    for u in range(1024):
        expected, share, crossed = follow(rig, u, row)
        astray += crossed > 2 or share < 0.1
        if expected is None:
            wrong += bool(np.isfinite(q[row, u, 0]))
            continue
        good = np.abs(q[row, u] - expected).max() < Q_TOLERANCE_PX
        wrong += not (good and light[row, u] == pytest.approx(share, abs=1e-3))  # cosines of grazing rays
    # between teeth of unequal depth is a step that neither model closes: what passes there means nothing
    assert wrong <= (8 if values is DEEPER else 0)
    assert bool(values) == (astray > 0)  # even teeth hide their seams


def test_light_that_a_tilt_sends_astray_arrives_where_it_does(gl_context):
    rig, dent = thin(), Dent(Shape.GAUSSIAN, 40.0, 0.0, 0.2, 5.0)
    renderer = GpuRenderer(rig, gl_context)
    q, light = renderer.ray_map(Mirror((dent,)))
    renderer.close()
    optics = Optics(rig)
    v, u = np.mgrid[0:64, 0:1024].astype(float)
    truth = optics.trace(u, v, Dented(optics.rest, Mirror((dent,))))
    arrived, straight = np.isfinite(q[..., 0]), truth.lost == Lost.NONE
    assert np.abs(q - truth.q)[arrived & straight].max() < Q_TOLERANCE_PX
    assert not (straight & ~arrived).any()
    stray = arrived & (truth.lost == Lost.SEAM)
    # a seam that opens shows the LCD by way of the next tooth, dim, or by the wrong face, bright
    assert np.count_nonzero(stray & (light < 0.1)) > 200
    assert np.count_nonzero(stray & (light > 0.9)) > 200
    assert np.median(np.abs(q - truth.q)[stray][:, 0]) > 20.0
