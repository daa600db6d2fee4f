"""Rigs with one number changed: what goes along, what stays, what is refused."""

import numpy as np
import pytest

from zeromethod import InputError, Optics
from zeromethod.design import Variation, curves, varied
from zeromethod.design.tir import incidence_deg
from zeromethod.design.vary import smallest_total_angle

from .design_benches import GAP, small, telecentric


@pytest.mark.parametrize("angle_deg", [45.0, 53.0, 60.0])
def test_the_camera_goes_along_with_the_camera_face(angle_deg):
    before, after = small(), varied(small(), "angle", angle_deg)
    old, new = Optics(before), Optics(after)
    old_trace, new_trace = old.centre(), new.centre()
    # it still looks at right angles into the face: the centre ray meets the mirror at the prism's angle,
    # as well as the rig's rounded position (1e-4 mm at 300 mm) says
    assert incidence_deg(new_trace)[0] == pytest.approx(angle_deg, abs=1e-4)
    share = old_trace.point[0, 0] / old.length_mm, new_trace.point[0, 0] / new.length_mm
    assert share[1] == pytest.approx(share[0], abs=1e-6)
    air = [
        -float(optics.prism.camera_face.depth_below(np.array(rig.camera.position_mm)))
        for optics, rig in ((old, before), (new, after))
    ]
    assert air[1] == pytest.approx(air[0], abs=1e-4)


def test_words_set_their_own_number_and_no_other():
    rig = small(pattern_layers=(GAP.model_copy(update={"index": 1.5}), GAP))
    assert varied(rig, "index", 1.45).prism.index == 1.45
    assert [layer.thickness_mm for layer in varied(rig, "gap", 2.0).pattern_layers] == [0.5, 2.0]
    assert varied(rig, "focal", 3000.0).camera.focal_px == (3000.0, 3000.0)
    moved = varied(rig, "distance", 400.0).camera
    away = np.array(moved.position_mm) - moved.look_at_mm
    assert np.linalg.norm(away) == pytest.approx(400.0)
    assert moved.look_at_mm == rig.camera.look_at_mm
    old = np.array(rig.camera.position_mm) - rig.camera.look_at_mm
    np.testing.assert_allclose(away / 400.0, old / np.linalg.norm(old))


def test_dotted_keys_reach_every_number():
    rig = small()
    assert varied(rig, "display.pitch_mm", 0.1).display.pitch_mm == 0.1
    assert varied(rig, "camera.position_mm[1]", 5.0).camera.position_mm[1] == 5.0
    assert varied(rig, "pattern_layers[0].thickness_mm", 1.5).pattern_layers[0].thickness_mm == 1.5
    assert varied(rig, "target.period_px", 12.0).target.period_px == 12
    assert varied(rig, "camera.noise.read_grey", 5.0).camera.noise.read_grey == 5.0


def test_curves_follow_the_angle():
    found = curves(telecentric(), Variation.parse("angle=46:54:3"), 5.0)
    critical = np.degrees(np.arcsin(1 / 1.41))
    assert found["values"] == [46.0, 50.0, 54.0]
    np.testing.assert_allclose(found["tir_margin_deg"], np.array(found["values"]) - critical, atol=1e-6)


def test_a_value_that_cannot_work_leaves_a_hole_with_its_reason():
    found = curves(small(), Variation.parse("distance=20:300:2"), 5.0)
    assert found["tir_margin_deg"][0] is None
    assert found["tir_margin_deg"][1] is not None
    assert "camera.position_mm" in found["refused"]["20"]


def test_the_least_angle_is_the_critical_one_where_rays_are_parallel():
    angle = smallest_total_angle(telecentric(45.0))
    critical = np.degrees(np.arcsin(1 / 1.41))
    assert critical < angle <= critical + 0.05


def test_no_angle_helps_a_rubber_like_air():
    rig = telecentric(45.0, prism={"index": 1.02})
    assert smallest_total_angle(rig, highest_deg=60.0) is None


@pytest.mark.parametrize("given", ["", "=45", "=45:45", "=a:b", "=45:60:1", "=45:60:x", "=nan:60"])
def test_what_is_no_variation_is_refused(given):
    with pytest.raises(InputError, match="--vary"):
        Variation.parse(f"angle{given}")


@pytest.mark.parametrize(
    ("key", "values", "reason"),
    [
        *[
            (key, (1.0, 2.0, 2), "angle, index, gap")
            for key in ("angel", "prism.indx", "display.driver", "pattern_layers[7].index", "prism")
        ],
        ("display.columns", (1000.0, 1001.0, 3), "whole number"),
        ("index", (5.0, 6.0, 2), r"prism\.index"),  # nothing works
    ],
)
def test_numbers_that_cannot_be_varied_are_refused(key, values, reason):
    with pytest.raises(InputError, match=reason):
        curves(small(), Variation(key, *values), 5.0)
