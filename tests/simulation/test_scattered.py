"""Depths at scattered points as a smooth map, against closed forms."""

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.scattered import FADE_PITCHES, ScatteredMap

PITCH_MM = 0.8
PRESS = Mirror((Dent(Shape.GAUSSIAN, 42.0, 1.0, 0.2, 5.0),))


def nodes() -> tuple[np.ndarray, np.ndarray]:
    """Points as a camera at an angle sees them: closer together along y, further apart towards one end."""
    s, t = np.meshgrid(np.linspace(0, 1, 60), np.linspace(-1, 1, 50))
    return (25 + 34 * s + 4 * s**2).ravel(), (13 * t * (1 + 0.15 * s)).ravel()


@pytest.fixture(scope="module")
def scattered() -> ScatteredMap:
    return ScatteredMap(*nodes(), PITCH_MM)


def mirror(scattered: ScatteredMap, coefficients: np.ndarray) -> Mirror:
    place = *scattered.centre_mm, 1.0, scattered.pitch_mm
    return Mirror((Dent(Shape.MAP, *place, map=coefficients, map_coefficients=coefficients),))


def inside() -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.linspace(27, 61, 90), np.linspace(-11, 11, 70))


def test_a_press_between_the_points_is_what_it_was_at_them(scattered):
    x_mm, y_mm = nodes()
    found = mirror(scattered, scattered.fit(x_mm, y_mm, PRESS.depth(x_mm, y_mm)))
    # a cubic spline of pitch h is off by some (h / sigma)^4 of a Gaussian: 1e-4 of 0.2 mm; ten times that
    assert np.abs(found.depth(*inside()) - PRESS.depth(*inside())).max() < 2e-4
    off = np.array(found.slope(*inside())) - np.array(PRESS.slope(*inside()))
    assert np.sqrt(np.mean(off**2)) < 3e-5


def test_points_that_moved_are_fitted_where_they_are(scattered):
    x_mm, y_mm = nodes()
    moved_x, moved_y = x_mm + 0.2 * np.sin(x_mm), y_mm - 0.15
    found = mirror(scattered, scattered.fit(moved_x, moved_y, PRESS.depth(moved_x, moved_y)))
    assert np.abs(found.depth(moved_x, moved_y) - PRESS.depth(moved_x, moved_y)).max() < 1e-4


def test_what_is_pressed_at_the_border_fades_to_rest_without_a_kink(scattered):
    x_mm, y_mm = nodes()
    found = mirror(scattered, scattered.fit(x_mm, y_mm, np.full(x_mm.shape, 0.1)))
    beyond = x_mm.max() + np.linspace(0.0, (FADE_PITCHES + 3) * PITCH_MM, 400)
    depth = found.depth(beyond, np.zeros(400))
    assert depth[0] == pytest.approx(0.1, rel=0.05)
    assert np.all(np.diff(depth) < 1e-4)  # no wave of more than a thousandth of the edge on its way
    assert depth[-1] == 0.0
    step_mm = beyond[1] - beyond[0]
    slope = found.slope(beyond, np.zeros(400))[0]
    assert np.abs(np.diff(slope)).max() < 0.1 * step_mm  # curvature stays below 0.1 / mm: no kink


def test_no_depth_is_rest_everywhere(scattered):
    assert not scattered.fit(*nodes(), np.zeros(nodes()[0].shape)).any()


def test_a_handful_of_points_is_no_mirror():
    with pytest.raises(InputError, match="15 points"):
        ScatteredMap(np.arange(15.0), np.arange(15.0), 1.0)
