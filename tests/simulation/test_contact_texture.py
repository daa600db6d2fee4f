"""Textures of the simulated bench: fields of tips, solved in contact like any other hard object."""

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.objects import Form, Held, Solid
from zeromethod.simulation.contact.scene import scene_of
from zeromethod.simulation.contact.texture import Texture, Weave
from zeromethod.simulation.scenario import load_scenario

RADIUS_MM = 3.0


def lattice(count=301):
    axis = np.linspace(-RADIUS_MM, RADIUS_MM, count)
    return np.meshgrid(axis, axis)


def touch_of(texture, force_n=0.5):
    solid = Solid(Form.TEXTURE, RADIUS_MM, texture=texture)
    (touch,) = scene_of([Held(solid, 40.0, 0.0, force_n=force_n)], Rubber()).touches
    return touch


@pytest.mark.parametrize("weave", list(Weave))
def test_the_highest_tip_is_the_lowest_point_and_another_seed_is_another_texture(weave):
    one, same, other = (Texture(weave, 0.5, 0.8, 0.003, seed) for seed in (1, 1, 2))
    height = one.profile(*lattice(), RADIUS_MM)
    inside = np.hypot(*lattice()) < RADIUS_MM
    # 20 um from a tip of 0.8 mm (grains: of 0.4 mm) it is 0.5 um higher
    assert 0 <= height[inside].min() < 5e-4
    np.testing.assert_array_equal(height, same.profile(*lattice(), RADIUS_MM))
    assert np.abs(height - other.profile(*lattice(), RADIUS_MM)).max() > 1e-3


def test_a_brush_touches_with_one_spot_for_each_bristle_and_more_area_under_more_force():
    texture = Texture(Weave.BRUSH, 1.0, 0.8, 0.001)
    light, hard = touch_of(texture, 0.3), touch_of(texture, 1.0)
    assert light.area_mm2 < hard.area_mm2
    assert light.force_n == pytest.approx(0.3, rel=1e-6)
    steps = np.arange(-2, 3) + 40.0
    x, y = np.meshgrid(steps, steps - 40.0)
    bristles = np.hypot(x - 40, y) < 2.5
    assert hard.covers(x, y)[bristles].all()
    assert not hard.covers(x + 0.5, y + 0.5)[bristles].any()


def test_packaged_textures_are_held_stuck_and_slid():
    for name in ("towel", "brush", "cloth", "sandpaper"):
        scenario = load_scenario(name)
        (one,) = scenario.objects
        moves = [one.moving(round(1e9 * at), round(1e9 * at) + 1000) for at in (0.5, 0.8, 1.1, 1.4)]
        assert moves == [False, True, False, True]
        share = touch_of(one.solid.texture, one.points[1].depth_mm).area_mm2 / (np.pi * RADIUS_MM**2)
        assert 0.1 < share < 0.5  # spots with rubber between them


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ('weave = "knit"', "sandpaper"),
        ("pitch_mm = 0.0", "pitch_mm"),
        ("height_mm = -1.0", "height_mm"),
        ("ridge_pitch_mm = 0.5", "not for shape 'texture'"),
        ("seed = 0.5", "seed"),
    ],
)
def test_a_texture_that_makes_no_sense_is_refused_in_one_line(tmp_path, given, words):
    keys = {"weave": '"pile"', "pitch_mm": "0.5", "tip_mm": "1.0", "radius_mm": "3.0"}
    name, value = given.split(" = ")
    lines = "\n".join(f"{key} = {text}" for key, text in (keys | {name: value}).items())
    path = tmp_path / "press.toml"
    point = "{ time_s = 0.0, x_mm = 40.0, y_mm = 0.0, force_n = 0.5 }"
    path.write_text(f'[[object]]\nshape = "texture"\n{lines}\npath = [{point}]\n')
    with pytest.raises(InputError) as refusal:
        load_scenario(path)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)
