import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from zeromethod.sensing import ResidualSensor
from zeromethod.warp.validity import Flag

from .sensing_scenes import (
    GRID,
    INNER,
    NOISE,
    QUIET,
    SHAPE,
    at_nodes,
    bump,
    camera,
    cosines,
    exposed,
    observed,
    pixels,
)


@pytest.fixture
def sensor():
    return ResidualSensor(GRID, "cosines", NOISE, 8)


def window_share(mask):
    """Share of the +-P px round each node that `mask` covers."""
    return at_nodes(uniform_filter(mask.astype(float), 32))


def test_dark_frame_is_flagged_everywhere(sensor):
    for image in (np.zeros(SHAPE, np.uint8), camera(np.zeros(SHAPE))):
        residual = sensor.measure(image)
        assert not residual.valid.any()
        assert (residual.flags[INNER] & Flag.MODULATION).all()
        assert np.isfinite(residual.d).all()


def test_uniform_light_has_no_modulation(sensor):
    residual = sensor.measure(camera(np.full(SHAPE, 0.5)))
    assert (residual.flags[INNER] & Flag.MODULATION).all()


def test_noise_alone_is_hardly_ever_taken_for_a_carrier(sensor):
    image = np.random.default_rng(5).integers(0, 256, SHAPE).astype(np.uint8)
    assert sensor.measure(image).valid.mean() < 0.001


def test_saturation_flags_the_windows_that_hold_it(sensor):
    image = camera(observed(cosines))
    clipped = np.zeros(SHAPE, bool)
    clipped[100:130, 150:190] = True
    image[clipped] = 255
    flagged = sensor.measure(image).flags[INNER] & Flag.SATURATED > 0
    share = window_share(clipped)
    assert flagged[share > 0.011].all()
    assert not flagged[share < 0.009].any()


def test_a_hot_pixel_is_not_saturation(sensor):
    image = camera(observed(cosines))
    image[100, 100] = 255
    assert sensor.measure(image).flags[INNER].max() == 0


def test_saturation_is_the_cameras_ceiling_not_the_words():
    sensor = ResidualSensor(GRID, "cosines", QUIET, 12)
    light = observed(cosines)
    assert (sensor.measure(exposed(light, 12, full=1.3)).flags[INNER] & Flag.SATURATED).all()
    assert not (sensor.measure(exposed(light, 12, full=1.0)).flags[INNER] & Flag.SATURATED).any()


def test_light_lost_against_the_reference(sensor):
    rest = observed(cosines)
    u, _ = pixels()
    smooth = 1 - 0.9 / (1 + np.exp(-(u - 200) / 60.0))
    dim = camera(smooth * rest)
    before = sensor.measure(dim).flags[INNER] & Flag.LIGHT_LOST > 0
    assert not before.any()
    sensor.set_reference(sensor.measure(camera(rest)))
    flagged = sensor.measure(dim).flags[INNER] & Flag.LIGHT_LOST > 0
    left = at_nodes(smooth)
    assert flagged[left < 0.28].all()
    assert not flagged[left > 0.32].any()
    sensor.set_reference(None)
    assert not (sensor.measure(dim).flags[INNER] & Flag.LIGHT_LOST).any()


def test_no_valid_node_beside_a_contact_is_wrong(sensor):
    """A hard dark patch: what is not flagged is right, what does not see it is not flagged."""
    light = observed(cosines, 0.4, -0.2)
    patch = np.zeros(SHAPE, bool)
    patch[90:150, 120:200] = True
    light[patch] = 0.0
    residual = sensor.measure(camera(light))
    valid = residual.valid[INNER]
    error = np.abs(residual.d[INNER] - (0.4, -0.2)).max(axis=-1)
    # noise is 0.008 px; 0.1 allows a window whose outermost weights touch the patch
    assert error[valid].max() < 0.1
    wider = np.zeros(SHAPE, bool)
    wider[82:158, 112:208] = True  # the bend of the mean looks one node (8 px) further
    assert valid[window_share(wider) == 0].all()
    assert valid.mean() > 0.75


@pytest.mark.parametrize("drop", [0.05, 0.15, 0.3, 0.5, 0.8])
def test_partial_loss_of_light_at_an_edge(sensor, drop):
    light = observed(cosines)
    light[:, 160:] *= 1 - drop
    residual = sensor.measure(camera(light))
    # what may stay unflagged is a step of 8 to 10 %: 2.5 px x 0.08, or its like further off
    assert np.abs(residual.d[INNER][residual.valid[INNER]]).max() < 0.2
    assert (residual.flags[INNER] & Flag.LIGHT_LOST).any() == (drop > 0.1)


def test_strain_of_a_sudden_press_is_not_an_edge_of_light(sensor):
    residual = sensor.measure(camera(observed(cosines, 20 * bump(45.0), -15 * bump(45.0))))
    assert (residual.flags[INNER] & Flag.LIGHT_LOST > 0).mean() < 0.01


def test_strain_beyond_the_last_nodes_is_not_an_edge_of_light(sensor):
    """Nulled as far as nodes are measured, and strained by 0.3 px per px beyond, as a press at the view's end
    is: that bends the mean by 3 %, where an edge of the light shows from 2 % on.
    """
    u, v = pixels()
    beyond = 0.3 * np.maximum(u - GRID.u_px[GRID.inner[1]][-1], 0) * np.exp(-((v - 128) ** 2) / (2 * 30.0**2))
    residual = sensor.measure(camera(cosines(u + beyond, v)))
    assert not (residual.flags[INNER] & Flag.LIGHT_LOST).any()


def test_no_valid_node_beside_a_dark_end_of_the_view_is_far_off(sensor):
    """An edge within the windows of the last nodes: strain that goes straight on is no excuse for it."""
    largest = 0.0
    for left_px in range(270, 318, 3):
        light = observed(cosines, 0.2, -0.1)
        light[:, left_px:] *= 0.2
        residual = sensor.measure(camera(light, seed=left_px))
        error = np.abs(residual.d[INNER] - (0.2, -0.1)).max(axis=-1)
        largest = max(largest, float(error[residual.valid[INNER]].max()))
    assert largest < 1.0  # px: edges that bend the mean by less than the limit do not show at the last node
