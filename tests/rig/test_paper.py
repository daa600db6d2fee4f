"""The paper's bench: numbers of the paper, and rays that land where its comments say."""

import math

import pytest

from zeromethod.rig.load import load_rig


def test_every_ray_through_the_camera_face_lands_on_the_display():
    # 45/45 degrees and a camera square to the camera face: a ray at distance w from R0 along that face
    # leaves the pattern face square at the same distance from R0's mirror image, leg - w from P0.
    rig = load_rig("paper")
    leg, camera, display = rig.prism.pattern_length_mm, rig.camera, rig.display
    assert leg is not None
    assert camera.pixel_mm is not None
    axis = [a - p for a, p in zip(camera.look_at_mm, camera.position_mm, strict=True)]
    # look_at and position carry 1e-6 mm: 1e-8 rad over 300 mm
    assert axis[0] / math.hypot(*axis) == pytest.approx(-math.sqrt(0.5), abs=1e-8)
    assert axis[2] / math.hypot(*axis) == pytest.approx(math.sqrt(0.5), abs=1e-8)
    assert camera.look_at_mm[0] == pytest.approx(leg / math.sqrt(2), abs=1e-6)

    along = [leg / 2 + (u - camera.centre_px[0]) * camera.pixel_mm for u in range(camera.columns)]
    across = [(v - camera.centre_px[1]) * camera.pixel_mm for v in range(camera.rows)]
    outside = [a for a in along if not 0 <= a <= leg]
    assert len(outside) == 24
    half_columns, half_rows = display.columns * display.pitch_mm / 2, display.rows * display.pitch_mm / 2
    assert all(abs(a - display.centre_mm[0]) < half_columns for a in along)
    assert all(abs(y - display.centre_mm[1]) < half_rows for y in across)
    assert max(across) < rig.prism.width_mm / 2


def test_centre_ray_is_just_below_total_reflection_as_the_comment_says():
    rig = load_rig("paper")
    incidence, n = math.radians(45), rig.prism.index
    assert math.degrees(math.asin(1 / n)) - 45 == pytest.approx(0.17, abs=0.005)
    refracted = math.asin(n * math.sin(incidence))
    s = (math.sin(incidence - refracted) / math.sin(incidence + refracted)) ** 2
    p = (math.tan(incidence - refracted) / math.tan(incidence + refracted)) ** 2
    assert (round(s, 2), round(p, 2)) == (0.73, 0.54)
