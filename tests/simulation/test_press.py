"""Dents: closed forms against numeric derivatives, contact mechanics and planted maps."""

import numpy as np
import pytest

from zeromethod.rig.tables import Rubber
from zeromethod.simulation.loads import load, ring, rod, rough
from zeromethod.simulation.press import Dent, Mirror, Shape, contact_radius_mm

_SIDE = np.linspace(-1, 1, 13)
_BUMP = np.exp(-4 * (_SIDE[:, None] ** 2 * 1.7 + (_SIDE[None, :] - 0.1) ** 2))
DENTS = [
    Dent(Shape.GAUSSIAN, 1.0, -2.0, 0.2, 1.5),
    Dent(Shape.GAUSSIAN, 1.0, -2.0, -0.2, 1.5),
    Dent(Shape.BALL, 1.0, -2.0, 0.2, 5.0),
    Dent(Shape.BALL, 1.0, -2.0, -0.2, 5.0),
    Dent(Shape.CONE, 1.0, -2.0, 0.2, 1.3),
    Dent(Shape.EDGE, 1.0, -2.0, 0.1, 0.8, length_mm=4.0, angle_deg=25.0),
    Dent(Shape.MAP, 1.0, -2.0, 0.1, 0.4, angle_deg=-70.0, map=_BUMP),
    load(1.0, -2.0, 0.2, 1.1),
    load(1.0, -2.0, -0.2, 1.1, Rubber(support="sliding", thickness_mm=2.0)),
    ring(1.0, -2.0, 0.2, 2.5, 0.7),
    rod(1.0, -2.0, 0.2, 4.0, 0.7, 25.0),
    rough(1.0, -2.0, 0.2, 3.0, 1.0, 5),
]


@pytest.mark.parametrize("dent", DENTS, ids=lambda d: f"{d.shape}{d.depth_mm:+}")
def test_slope_is_the_derivative_of_depth(dent):
    mirror = Mirror((dent,))
    rng = np.random.default_rng(0)
    x, y = 1.0 + rng.uniform(-4, 4, 400), -2.0 + rng.uniform(-4, 4, 400)
    r = np.hypot(x - 1.0, y + 2.0)
    kink = contact_radius_mm(dent.shape, abs(dent.depth_mm), dent.size_mm)
    away = (np.abs(r - kink) > 0.05) & (r > 0.1)  # higher derivatives jump at the contact's rim and a tip
    x, y, h = x[away], y[away], 1e-4
    by_x, by_y = mirror.slope(x, y)
    # central differences: error h^2 d''' / 6, d''' < 100 /mm^2 near a rim, so < 2e-7
    np.testing.assert_allclose(by_x, (mirror.depth(x + h, y) - mirror.depth(x - h, y)) / (2 * h), atol=2e-7)
    np.testing.assert_allclose(by_y, (mirror.depth(x, y + h) - mirror.depth(x, y - h)) / (2 * h), atol=2e-7)


@pytest.mark.parametrize("shape", [Shape.BALL, Shape.CONE])
def test_depth_is_continuous_at_the_contacts_rim_and_a_balls_slope_too(shape):
    dent = Dent(shape, 0.0, 0.0, 0.3, 2.0)
    a, step = contact_radius_mm(shape, 0.3, 2.0), 1e-10
    mirror = Mirror((dent,))
    inside, outside = mirror.depth([a - step, a + step], 0.0)
    assert inside == pytest.approx(outside, abs=1e-9)  # slope x step
    if shape is Shape.BALL:
        (left, right), _ = mirror.slope([a - step, a + step], 0.0)
        assert left == pytest.approx(-a / 2.0, abs=1e-9)
        assert right == pytest.approx(left, abs=1e-4)  # falls like sqrt(step) beyond the rim


@pytest.mark.parametrize(("shape", "limit"), [(Shape.BALL, 4 / (3 * np.pi)), (Shape.CONE, 1 / np.pi)])
def test_far_field_falls_like_one_over_r(shape, limit):
    dent = Dent(shape, 0.0, 0.0, 0.3, 2.0)
    a = contact_radius_mm(shape, 0.3, 2.0)
    far = np.array([100.0, 200.0, 400.0]) * a
    # next term of the series is (a/r)^2 smaller: 1e-4; cancellation in float64 leaves 1e-9
    np.testing.assert_allclose(Mirror((dent,)).depth(far, 0.0) * far, limit * 0.3 * a, rtol=1e-4)


def test_hertz_contact_radius_and_profile_under_a_ball():
    mirror = Mirror((Dent(Shape.BALL, 0.0, 0.0, 0.2, 5.0),))
    assert contact_radius_mm(Shape.BALL, 0.2, 5.0) == pytest.approx(1.0)
    assert float(mirror.depth(1.0, 0.0)) == pytest.approx(0.1)  # d0 / 2 at the rim
    assert float(mirror.depth(0.4, 0.3)) == pytest.approx(0.2 - 0.25 / 10)


def test_edge_is_long_along_its_angle_from_x_towards_y():
    mirror = Mirror((Dent(Shape.EDGE, 0.0, 0.0, 0.1, 0.5, length_mm=8.0, angle_deg=90.0),))
    assert float(mirror.depth(0.0, 0.0)) == pytest.approx(0.1)
    assert float(mirror.depth(0.0, 2.0)) == pytest.approx(0.1, rel=1e-4)  # 4 sigma from its end
    assert float(mirror.depth(2.0, 0.0)) == pytest.approx(0.1 * np.exp(-8.0))
    tilted = Mirror((Dent(Shape.EDGE, 0.0, 0.0, 0.1, 0.5, length_mm=8.0, angle_deg=45.0),))
    assert float(tilted.depth(1.0, 1.0)) == pytest.approx(0.1, rel=1e-3)
    assert float(tilted.depth(1.0, -1.0)) == pytest.approx(0.1 * np.exp(-4.0))


def test_map_has_rows_along_y_and_gives_its_samples_back():
    samples = np.zeros((9, 11))
    samples[6, 3] = 1.0
    mirror = Mirror((Dent(Shape.MAP, 10.0, 20.0, 0.5, 0.25, map=samples),))
    assert float(mirror.depth(10 + (3 - 5) * 0.25, 20 + (6 - 4) * 0.25)) == pytest.approx(0.5)
    assert float(mirror.depth(10 + (4 - 5) * 0.25, 20 + (6 - 4) * 0.25)) == pytest.approx(0.0, abs=1e-9)
    turned = Mirror((Dent(Shape.MAP, 10.0, 20.0, 0.5, 0.25, angle_deg=90.0, map=samples),))
    assert float(turned.depth(10 - (6 - 4) * 0.25, 20 + (3 - 5) * 0.25)) == pytest.approx(0.5)
    assert float(turned.depth(30.0, 20.0)) == 0.0


def test_map_of_a_gaussian_reads_as_the_gaussian():
    at = np.arange(-24, 25) * 0.25
    sigma = 1.0
    mirror = Mirror((Dent(Shape.MAP, 0, 0, 0.2, 0.25, map=np.exp(-(at[:, None] ** 2 + at**2) / 2)),))
    truth = Mirror((Dent(Shape.GAUSSIAN, 0, 0, 0.2, sigma),))
    x, y = np.random.default_rng(1).uniform(-4, 4, (2, 500))
    # cubic spline: error about d'''' pitch^4 / 384 = 0.6 * 0.0039 / 384 = 6e-6
    np.testing.assert_allclose(mirror.depth(x, y), truth.depth(x, y), atol=1.2e-5)


def test_dents_add_up_and_no_dents_is_rest():
    a, b = DENTS[0], DENTS[5]
    x, y = np.linspace(-3, 4, 9), np.linspace(-4, 2, 7)[:, None]
    both = Mirror((a, b)).depth(x, y)
    np.testing.assert_allclose(both, Mirror((a,)).depth(x, y) + Mirror((b,)).depth(x, y), atol=1e-15)
    assert both.shape == (7, 9)
    assert not Mirror().depth(x, y).any()


def test_reflection_is_lost_only_where_a_pressed_object_touches():
    touching = Dent(Shape.BALL, 0.0, 0.0, 0.2, 5.0, contact_mm=1.0, touch_reflectance=0.1)
    factor = Mirror((touching,)).reflectance_factor([0.0, 0.99, 1.01], 0.0)
    np.testing.assert_array_equal(factor, [0.1, 0.1, 1.0])
    lifted = Dent(Shape.BALL, 0.0, 0.0, -0.1, 5.0, contact_mm=1.0)
    dry = Dent(Shape.GAUSSIAN, 0.0, 0.0, 0.2, 5.0)
    assert Mirror((lifted, dry)).reflectance_factor(0.0, 0.0) == 1.0
    edge = Dent(Shape.EDGE, 0.0, 0.0, 0.1, 0.5, 4.0, 90.0, contact_mm=0.3)
    np.testing.assert_array_equal(
        Mirror((edge,)).reflectance_factor([0.0, 0.0, 0.4], [1.9, 2.1, 0.0]), [0.05, 1.0, 1.0]
    )


def test_mirrors_with_equal_numbers_are_equal_so_that_ray_maps_can_be_kept():
    assert Mirror((Dent(Shape.CONE, 1, 2, 3, 4),)) == Mirror((Dent(Shape.CONE, 1, 2, 3, 4),))
    assert Mirror((Dent(Shape.CONE, 1, 2, 3, 4),)) != Mirror((Dent(Shape.CONE, 1, 2, 3, 4.1),))
    map_a, map_b = np.eye(4), np.eye(4)
    assert Dent(Shape.MAP, 0, 0, 1, 1, map=map_a) == Dent(Shape.MAP, 0, 0, 1, 1, map=map_a)
    assert Dent(Shape.MAP, 0, 0, 1, 1, map=map_a) != Dent(Shape.MAP, 0, 0, 1, 1, map=map_b)
