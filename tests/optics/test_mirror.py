"""Height fields and where rays meet them."""

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.optics import Cylinder, Dented, Flat, GridHeight, Sphere, rest_surface
from zeromethod.optics.mirror import distance_to, normal_of
from zeromethod.optics.vectors import dot, unit

from .optics_shapes import close, gaussian, small

X, Y = np.meshgrid(np.linspace(2.0, 70.0, 30), np.linspace(-25.0, 25.0, 20))


def rays(count=400, seed=5):
    """Rays that rise from z = -40..-5 towards points of the mirror's plane."""
    rng = np.random.default_rng(seed)
    origin = rng.uniform([50, -20, -40], [80, 20, -5], size=(count, 3))
    target = rng.uniform([5, -20, 0], [70, 20, 0], size=(count, 3))
    return origin, unit(target - origin)


def wavy(x, y):
    return 0.2 * np.sin(x / 7.0) * np.cos(y / 9.0)


def wavy_map(pitch):
    x, y = np.meshgrid(np.arange(-5.0, 85.0, pitch), np.arange(-35.0, 35.0, pitch))
    return GridHeight(wavy(x, y), pitch, (-5.0, -35.0))


@pytest.mark.parametrize(
    "mirror",
    [
        Flat(),
        Sphere(300.0, (40.0, 2.0)),
        Sphere(-250.0, (30.0, 0.0)),
        Cylinder(300.0, (40.0, 2.0), 30.0),
        Cylinder(-200.0, (35.0, 0.0), -75.0),
        wavy_map(1.0),
        Dented(Sphere(500.0, (40.0, 0.0)), gaussian(0.3, 5.0, 40.0, 1.0)),
    ],
    ids=["flat", "bulge", "hollow", "cylinder", "gutter", "map", "dented"],
)
def test_gradients_are_the_heights_derivatives(mirror):
    step = 1e-4
    by_x = (mirror.height(X + step, Y) - mirror.height(X - step, Y)) / (2 * step)
    by_y = (mirror.height(X, Y + step) - mirror.height(X, Y - step)) / (2 * step)
    # 1e-9: step^2 x third derivative, and rounding of 20 mm / step
    np.testing.assert_allclose(mirror.gradient(X, Y), [by_x, by_y], atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("radius", [300.0, -300.0])
def test_rays_meet_a_sphere_where_algebra_says(radius):
    sphere = Sphere(radius, (38.0, 3.0))
    centre = np.array([38.0, 3.0, -radius])
    origin, direction = rays()
    offset = origin - centre
    b, c = dot(offset, direction), dot(offset, offset) - radius**2
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - c)  # NaN where a flat ray passes under a hollow: no surface met
    expected = -b + root if radius > 0 else -b - root  # leaves a bulge from inside, enters a hollow's ball
    distance = distance_to(sphere, origin, direction)
    # 1e-11 mm: the quadratic formula cancels squares of 300 mm
    close(distance, expected, 1e-11)
    point = origin + distance[:, None] * direction
    normal = normal_of(sphere.gradient(point[:, 0], point[:, 1]))
    met = np.isfinite(distance)
    assert met.mean() > 0.9
    close(normal[met], ((point - centre) / radius)[met], 1e-13)


def test_a_cylinder_is_straight_along_its_axis_and_a_sphere_across_it():
    cylinder, sphere = Cylinder(300.0, (38.0, 3.0), 30.0), Sphere(300.0, (38.0, 3.0))
    way = np.linspace(-30.0, 30.0, 7)
    for turn_deg, expected in ((30.0, 0.0 * way), (120.0, sphere.height(38.0 + way, 3.0 + 0.0 * way))):
        x, y = 38.0 + way * np.cos(np.radians(turn_deg)), 3.0 + way * np.sin(np.radians(turn_deg))
        # mm: rounding of squares of 30 over 600
        np.testing.assert_allclose(cylinder.height(x, y), expected, atol=1e-13)


def test_rays_meet_a_steep_dent_where_a_dense_search_does():
    """A dent of 1.3 mm, its walls 38 deg against the ray's 40: Newton's first steps stray."""
    mirror = Dented(Flat(), gaussian(1.3, 1.0, 40.0, 0.0))
    target = np.linspace(36.0, 46.0, 101)
    direction = unit(np.array([-0.766, 0.0, 0.643]))
    origin = np.stack([target, np.zeros(101), np.zeros(101)], axis=-1) - 40.0 * direction
    distance = distance_to(mirror, origin, direction + np.zeros_like(origin))
    point = origin + distance[:, None] * direction
    close(mirror.height(point[:, 0], point[:, 1]), point[:, 2], 1e-12)
    dense = np.linspace(30.0, 45.0, 15001)
    path = origin[:, None, :] + dense[:, None] * direction
    above = path[..., 2] > mirror.height(path[..., 0], path[..., 1])
    # 0.002 mm: twice the step of the dense search
    close(distance, dense[above.argmax(axis=1)], 0.002)


def test_rays_that_do_not_rise_or_know_nothing_are_nan():
    origin = np.array([[40.0, 0.0, -10.0]] * 3)
    direction = np.array([[0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [np.nan] * 3])
    for mirror in (Flat(), Sphere(300.0), wavy_map(1.0)):
        assert np.isnan(distance_to(mirror, origin, direction)).all()


def test_a_map_passes_its_points_and_converges_with_the_fourth_power():
    grid = wavy_map(1.0)
    points = wavy(np.arange(-5.0, 85.0), -20.0)
    close(grid.height(np.arange(-5.0, 85.0), np.full(90, -20.0)), points, 1e-14)
    coarse, fine = (np.abs(wavy_map(p).height(X, Y) - wavy(X, Y)).max() for p in (1.0, 0.5))
    assert coarse < 1e-5
    assert coarse / fine > 12  # 16 for h^4, less what the sampling of the maximum takes


def test_a_map_goes_on_flat_beyond_its_border():
    grid = wavy_map(1.0)
    x, y = np.array([-9.0, 84.5, 20.0]), np.array([3.0, 90.0, -80.0])
    close(grid.height(x, y), wavy(np.clip(x, -5, 84), np.clip(y, -35, 34)), 1e-5)
    zx, zy = grid.gradient(x, y)
    assert zx[0] == zx[1] == zy[1] == zy[2] == 0.0
    assert zy[0] != 0.0


def test_a_rigs_rest_surface_is_what_it_says(tmp_path):
    heights = wavy(X, Y)
    np.save(tmp_path / "rest.npy", heights)
    rest = small().prism.rest
    sphere = rest.model_copy(update={"shape": "sphere", "radius_mm": 400.0, "centre_mm": (38.0, 0.0)})
    cylinder = sphere.model_copy(update={"shape": "cylinder", "axis_deg": 90.0})
    height_map = rest.model_copy(update={"shape": "map", "file": tmp_path / "rest.npy", "pitch_mm": 2.0})
    assert rest_surface(small()) == Flat()
    assert rest_surface(small(prism={"rest": sphere})) == Sphere(400.0, (38.0, 0.0))
    assert rest_surface(small(prism={"rest": cylinder})) == Cylinder(400.0, (38.0, 0.0), 90.0)
    surface = rest_surface(small(prism={"rest": height_map}))
    assert surface.height(np.array([6.0]), np.array([4.0]))[0] == pytest.approx(heights[2, 3])


@pytest.mark.parametrize("content", [None, b"not an array", "flat"])
def test_an_unusable_height_map_is_refused_in_one_line(tmp_path, content):
    file = tmp_path / "rest.npy"
    if content == "flat":
        np.save(file, np.zeros(9))
    elif content is not None:
        file.write_bytes(content)
    rest = small().prism.rest.model_copy(update={"shape": "map", "file": file, "pitch_mm": 2.0})
    with pytest.raises(InputError, match=r"prism\.rest\.file.*rest\.npy") as refused:
        rest_surface(small(prism={"rest": rest}))
    assert "\n" not in str(refused.value)
