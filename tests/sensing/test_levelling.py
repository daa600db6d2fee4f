"""Light that the optics predict, taken out of the image before the carrier is read."""

import numpy as np
import pytest

from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.sensing.shading import level, noise_factor
from zeromethod.warp.validity import Flag

from .sensing_scenes import GRID, INNER, NOISE, SHAPE, at_nodes, camera, cosines, observed, pixels


@pytest.fixture
def sensor() -> ResidualSensor:
    return ResidualSensor(GRID, "cosines", NOISE, 8)


def kinked() -> np.ndarray:
    """Share of the light across u: from 0.45 up to 1 with infinite slope, as at the critical angle."""
    u, _ = pixels()
    return np.clip(1 - 0.05 * np.sqrt(np.clip(150 - u, 0, None)), 0.45, 1).astype(np.float32)


def test_a_kink_of_the_light_costs_nothing_when_it_was_predicted(sensor):
    image, share = camera(kinked() * observed(cosines, 0.4, -0.2)), kinked()
    unlevelled = sensor.measure(image).copy()
    predicted = sensor.measure(image, light_share=share)
    assert (unlevelled.flags[INNER] & Flag.LIGHT_LOST > 0).mean() > 0.05
    assert predicted.valid[INNER].all()
    wrong = np.abs((predicted.d[INNER] - (0.4, -0.2)) / predicted.sigma[INNER])
    assert wrong.max() < 5  # of 2000 numbers, at a bias below one sigma


def test_sigma_is_that_of_the_light_there_was(sensor):
    share = kinked()
    light = share * observed(cosines)
    frames = [sensor.measure(camera(light, seed), light_share=share).copy() for seed in range(40)]
    spread = np.std([f.d[INNER] for f in frames], axis=0, ddof=1)
    sigma = frames[0].sigma[INNER]
    dim = at_nodes(share) < 0.5
    for there in (dim, ~dim):
        # 40 frames and over a hundred nodes that share pixels with 8 others: 3 %
        assert np.sqrt(np.mean((spread[there] / sigma[there]) ** 2)) == pytest.approx(1, abs=0.06)
    assert np.median(sigma[dim]) > 1.5 * np.median(sigma[~dim])


@pytest.mark.parametrize("left", [0.05, 0.1, 0.2])
def test_a_touch_in_dim_and_in_bright_places_is_still_light_lost(sensor, left):
    rest, share = observed(cosines), kinked()
    sensor.set_reference(sensor.measure(camera(rest)))
    u, v = pixels()
    for at in (60, 240):
        touch = np.hypot(u - at, v - 128) < 40
        residual = sensor.measure(camera(np.where(touch, left, 1.0) * share * rest), light_share=share)
        inside = at_nodes(np.hypot(u - at, v - 128)) < 24
        assert inside.sum() > 10
        assert (residual.flags[INNER][inside] & Flag.LIGHT_LOST > 0).all()
        beyond = at_nodes(np.hypot(u - at, v - 128)) > 40 + 40
        assert residual.valid[INNER][beyond].all()


def test_dimming_by_fresnel_alone_is_not_light_lost(sensor):
    rest = observed(cosines)
    sensor.set_reference(sensor.measure(camera(rest)))
    dim = np.full(SHAPE, 0.25, np.float32)
    assert (sensor.measure(camera(dim * rest)).flags[INNER] & Flag.LIGHT_LOST > 0).all()
    assert sensor.measure(camera(dim * rest), light_share=dim).valid[INNER].all()


def test_levelled_grey_is_that_of_full_light_and_clipping_stays_clipping():
    image = np.array([[4, 54, 255, 204]], np.uint8)
    out = np.empty((1, 4), np.float32)
    level(image, np.array([[0.5, 0.5, 0.5, 0.5]], np.float32), 4.0, 255, out)
    assert out.tolist() == [[4.0, 104.0, 255.0, 254.0]]


def test_read_noise_counts_inversely_and_shot_noise_by_the_root():
    share, grey = np.array([0.25], np.float32), np.array([104.0], np.float32)
    assert noise_factor(grey, share, Noise(read_grey=2.0, electrons_per_grey=None)) == pytest.approx(4.0)
    faint = Noise(read_grey=0.0, electrons_per_grey=0.01)
    # the rounding of grey levels is all that does not go by the root: 1/12 against 10,400
    assert noise_factor(grey, share, faint) == pytest.approx(2.0, rel=1e-4)
