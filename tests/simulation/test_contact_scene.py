"""Scenes of objects: the mirror's depth around them, several at once, their gaps, their files."""

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.objects import Form, Held, Solid
from zeromethod.simulation.contact.scene import scene_of
from zeromethod.simulation.contact.touch import evanescent_mm
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.scenario import load_scenario

RUBBER = Rubber()
BALL = Solid(Form.BALL, 5.0)


def mirror_of(*held: Held) -> Mirror:
    scene = scene_of(held, RUBBER)
    return Mirror(scene.dents, scene.touches)


def around(x_mm: float, y_mm: float, low_mm: float, high_mm: float) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(0)
    r, angle = np.exp(draw.uniform(np.log(low_mm), np.log(high_mm), 2000)), draw.uniform(0, 2 * np.pi, 2000)
    return x_mm + r * np.cos(angle), y_mm + r * np.sin(angle)


@pytest.mark.parametrize(("low_mm", "high_mm"), [(1e-3, 0.45), (0.55, 2.0), (2.0, 25.0)])
def test_depth_and_slope_around_a_ball_are_hertz_s(low_mm, high_mm):
    exact = Mirror((Dent(Shape.BALL, 42.0, 1.0, 0.05, 5.0),))
    mirror = mirror_of(Held(BALL, 42.0, 1.0, depth_mm=0.05))
    x, y = around(42.0, 1.0, low_mm, high_mm)
    np.testing.assert_allclose(mirror.depth(x, y), exact.depth(x, y), atol=2e-6)  # 2 nm of 50 um
    slope, expected = np.array(mirror.slope(x, y)), np.array(exact.slope(x, y))
    np.testing.assert_allclose(slope, expected, atol=2e-5)  # of up to 0.1


def test_depth_under_a_turned_rod_follows_the_rod():
    angle = np.radians(30.0)
    mirror = mirror_of(Held(Solid(Form.EDGE, 3.0, length_mm=8.0, angle_deg=30.0), 42.0, 1.0, depth_mm=0.04))
    along, across = np.linspace(-3.5, 3.5, 50), 0.1
    x = 42.0 + along * np.cos(angle) - across * np.sin(angle)
    y = 1.0 + along * np.sin(angle) + across * np.cos(angle)
    np.testing.assert_allclose(mirror.depth(x, y), 0.04 - across**2 / 6.0, atol=5e-6)
    assert np.all(mirror.reflectance_factor(x, y) == 0.0)


def test_a_neighbour_takes_load_off_and_the_depth_under_each_stays_its_own():
    alone = mirror_of(Held(BALL, 42.0, 1.0, depth_mm=0.05))
    both = mirror_of(Held(BALL, 42.0, 1.0, depth_mm=0.05), Held(BALL, 44.0, 1.0, depth_mm=0.05, number=1))
    first, second = both.touches
    assert first.force_n == pytest.approx(second.force_n, rel=2e-3)
    assert first.force_n < 0.95 * alone.touches[0].force_n
    # each away from the other
    assert first.centroid_mm[0] < 42.0
    assert second.centroid_mm[0] > 44.0
    np.testing.assert_allclose(both.depth([42.0, 44.0], [1.0, 1.0]), 0.05, rtol=1e-3)


def test_an_object_that_is_moved_presses_alike_elsewhere():
    here, there = (mirror_of(Held(BALL, x, y, depth_mm=0.03)) for x, y in ((42.0, 1.0), (38.5, -4.0)))
    assert there.touches[0].level is here.touches[0].level
    assert there.touches[0].centroid_mm == pytest.approx((38.5, -4.0), abs=1e-3)
    np.testing.assert_allclose(there.depth(39.5, -4.0), here.depth(43.0, 1.0), rtol=1e-12)


def test_friction_lifts_the_rubber_behind_and_sinks_it_ahead_as_its_poissons_ratio_lets_it():
    """Cerruti: Q (1 - 2 nu) (1 + nu) / (2 pi E) x / r^2; Johnson 1985, 3.2. Nothing of nearly 0.5 is left."""
    dragging = Held(Solid(Form.BALL, 5.0, friction=0.5), 42.0, 1.0, depth_mm=0.05)
    plain, dragged = mirror_of(Held(BALL, 42.0, 1.0, depth_mm=0.05)), mirror_of(dragging)
    x, y = around(42.0, 1.0, 3.0, 20.0)
    force_n = plain.touches[0].force_n
    per_n = 0.5 * (1 - 2 * RUBBER.poisson) * (1 + RUBBER.poisson) / (2 * np.pi * 1.0)
    ahead = force_n * per_n * (x - 42.0) / ((x - 42.0) ** 2 + (y - 1.0) ** 2)
    # the contact is half a mm wide
    np.testing.assert_allclose(
        dragged.depth(x, y) - plain.depth(x, y), ahead, atol=0.02 * np.abs(ahead).max()
    )


def test_objects_that_run_into_each_other_are_refused():
    with pytest.raises(InputError, match=r"object\[1\]: its contact lies on that of object\[0\]"):
        mirror_of(Held(BALL, 42.0, 1.0, depth_mm=0.05), Held(BALL, 42.2, 1.0, depth_mm=0.05, number=1))


def test_the_optical_outline_of_a_ball_exceeds_its_contact_by_about_a_hundredth():
    (touch,) = mirror_of(Held(BALL, 42.0, 1.0, depth_mm=0.05)).touches
    for degrees, depth_nm in ((50.0, 215.0), (60.0, 125.0)):
        depth_mm = float(evanescent_mm(np.cos(np.radians(degrees)), 1.41))
        assert depth_mm == pytest.approx(1e-6 * depth_nm, rel=0.02)
        r = np.linspace(0.45, 0.55, 2001)
        half = r[np.argmin(np.abs(touch.crossing(42.0 + r, np.full_like(r, 1.0), depth_mm) - 0.5))]
        assert 1.003 < half / 0.5 < 1.02


def test_light_crosses_inside_a_contact_and_not_beside_it():
    mirror = mirror_of(Held(Solid(Form.PUNCH, 1.0, albedo=0.8), 42.0, 1.0, depth_mm=0.02))
    x = np.array([42.0, 42.9, 43.1, 45.0])
    left, scattered = mirror.light(x, np.full(4, 1.0), np.full(4, np.cos(np.radians(50.0))), 1.41)
    np.testing.assert_allclose(left, [0, 0, 1, 1], atol=1e-3)
    np.testing.assert_allclose(scattered, [0.8, 0.8, 0, 0], atol=1e-3)
    np.testing.assert_array_equal(mirror.reflectance_factor(x, np.full(4, 1.0)), [0, 0, 1, 1])


@pytest.mark.parametrize("name", ["hertz", "jkr", "cone", "punch", "edge", "finger", "covered"])
def test_every_packaged_touch_holds_one_object(name):
    scenario = load_scenario(name)
    (touch,) = scenario.mirror_at(round(0.6e9)).touches
    assert touch.area_mm2 > 0.7
    assert touch.force_n > 0
    assert scenario.mirror_at(round(1.2e9)) == Mirror()
    assert scenario.moving(round(0.31e9), round(0.32e9))
    assert scenario.bends_ns(0, round(1e9)) == (round(0.3e9), round(0.35e9))


def test_a_finger_touches_on_its_ridges():
    (touch,) = load_scenario("finger").mirror_at(round(0.6e9)).touches
    along = np.linspace(-0.7, 0.7, 2801)
    angle = np.radians(20.0)
    inside = touch.covers(42.0 + along * np.cos(angle), along * np.sin(angle)).astype(float)
    crests = np.cos(2 * np.pi * along / 0.45) > 0
    assert inside[crests].mean() > inside[~crests].mean() + 0.1


POINT = "path = [{ time_s = 0.0, x_mm = 42.0, y_mm = 0.0, depth_mm = 0.03 }]\n"
OBJECT = f"[[object]]\nshape = 'ball'\nradius_mm = 5\n{POINT}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OBJECT.replace("radius_mm = 5\n", ""), "object[0].radius_mm: missing: needed for shape 'ball'"),
        (OBJECT + "flank_deg = 3", "object[0].flank_deg: 3.0: not for shape 'ball'"),
        (OBJECT + "albedo = 'pink'", 'object[0].albedo: "pink": one of "black", "grey", "white"'),
        (OBJECT.replace("ball", "block"), 'object[0].shape: "block": one of "ball", "cone", "punch"'),
        (
            OBJECT.replace(", depth_mm = 0.03", ""),
            "object[0].path: missing: depth_mm at every point, or force_n",
        ),
        (
            OBJECT.replace("[{", "[{ time_s = 0.0, x_mm = 1.0, y_mm = 0.0, force_n = 1.0 }, {"),
            "object[0].path: ",
        ),
    ],
)
def test_bad_objects_are_refused_in_one_line(refusal, text, message):
    assert refusal(text).startswith(message)


def test_hard_objects_press_no_body_that_is_not_elastic():
    with pytest.raises(InputError) as caught:
        load_scenario("hertz", Rubber(body="none"))
    assert str(caught.value) == 'scenario: "hertz": one without hard objects, as rubber.body is "none"'
    assert load_scenario("none", Rubber(body="none")).objects == ()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"support": "bonded"}, "thickness_mm: missing: a number above 0 for support 'bonded'"),
        ({"thickness_mm": 3.0}, "thickness_mm: 3.0: only with support 'bonded' or 'sliding'"),
        ({"poisson": 0.6}, "poisson: 0.6: a number at least 0 and at most 0.5"),
    ],
)
def test_rubber_that_cannot_be_is_refused(values, message):
    with pytest.raises(InputError, match="Rubber: ") as caught:
        Rubber(**values)
    assert message in str(caught.value)
