"""A contact smaller than a node's window: what its lost light does to the phase goes into sigma."""

import numpy as np
import pytest

from tests.sensing.sensing_scenes import (
    GRID,
    INNER,
    NOISE,
    PERIOD,
    QUIET,
    SHAPE,
    camera,
    cosines,
    exposed,
    pixels,
)
from zeromethod.loop.lost_light import FRAMES, LostLight
from zeromethod.sensing.sensor import ResidualSensor

LIGHT = cosines(*pixels())


def sensor(noise, bits):
    return ResidualSensor(GRID, "cosines", noise, bits)


def touched(u, v, radius, light=LIGHT):
    """Light without that of a disc."""
    across, down = pixels()
    return light * (np.hypot(across - u, down - v) > radius)


def test_the_phase_error_of_a_small_contact_anywhere_in_the_window_is_as_large_as_sigma_says() -> None:
    sense = sensor(QUIET, 16)
    lost = LostLight(GRID.shape, PERIOD, 0.0)
    lost.learn(sense.measure(exposed(LIGHT)))
    draw, ratios = np.random.default_rng(5), []
    for _ in range(40):
        u, v = draw.uniform(100, 200), draw.uniform(90, 170)
        found = sense.measure(exposed(touched(u, v, 1.6)))
        lost.widen_sigma(found)
        near = found.valid & (found.sigma.max(axis=-1) > 0.01)
        assert np.count_nonzero(near) >= 4
        ratios.append((found.d[near] / found.sigma[near]).ravel())
    # whichever phase the light had that is lost: rms by the rule 1; its share is known to a tenth or so
    assert np.sqrt(np.mean(np.concatenate(ratios) ** 2)) == pytest.approx(1.0, abs=0.25)


def test_before_any_rest_the_edge_of_a_lamps_image_is_in_sigma() -> None:
    sense, ratios = sensor(QUIET, 16), []
    across, down = pixels()
    for place in range(40):
        beyond = across * np.cos(0.1 * place) + down * np.sin(0.1 * place) > 90 + place
        more = 0.02 * beyond  # 4 % of the mean light, as of a ring light's image
        found = sense.measure(exposed(LIGHT + more))
        LostLight(GRID.shape, PERIOD, 0.0).widen_sigma(found)
        near = found.valid & (found.sigma[..., 0] > 0.02)
        ratios.append((found.d[near] / found.sigma[near]).ravel())
    # a bend says how large a step is, not where in the window it lies: 1.5 where that does most harm
    assert 0.8 < np.abs(np.concatenate(ratios)).max() < 2
    assert np.concatenate(ratios).size > 5000


def test_noise_and_light_that_changes_smoothly_add_nothing() -> None:
    sense = sensor(NOISE, 8)
    lost = LostLight(GRID.shape, PERIOD, NOISE.black_grey)
    first = sense.measure(camera(LIGHT))
    before = first.sigma.copy()
    lost.widen_sigma(first)
    # three deviations of noise of the larger of two bends, at a node or one of eight next to it
    assert np.mean(first.sigma[INNER] > 1.001 * before[INNER]) < 0.03
    for seed in range(2 * FRAMES):
        lost.learn(sense.measure(camera(LIGHT, seed)))
    u, v = pixels()
    dimmer = 0.8 + 0.1 * u / SHAPE[1] - 0.1 * v / SHAPE[0]
    seen = sense.measure(camera(LIGHT * dimmer, seed=99))
    before = seen.sigma.copy()
    lost.widen_sigma(seen)
    opened = seen.sigma[INNER] > 1.001 * before[INNER]
    # three deviations of noise to one side, of the larger of two
    assert np.mean(opened) < 0.006
