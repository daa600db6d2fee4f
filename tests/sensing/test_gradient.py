import numpy as np
import pytest

from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.warp.validity import Flag

from .sensing_scenes import GRID, INNER, SHAPE, exposed, observed


def texture():
    """Forty plane waves of 0.5 to 1.25 cycles per 16 px, all directions: band-limited, no period."""
    rng = np.random.default_rng(7)
    angle, cycles = rng.uniform(0, 2 * np.pi, 40), rng.uniform(0.5, 1.25, 40) / 16
    phase = rng.uniform(0, 2 * np.pi, 40)

    def light(u, v):
        waves = [
            np.cos(2 * np.pi * f * (np.cos(a) * u + np.sin(a) * v) + p)
            for a, f, p in zip(angle, cycles, phase, strict=True)
        ]
        return 0.5 + 0.4 * np.sum(waves, axis=0) / 16

    return light


LIGHT = texture()
NOISE = Noise(read_grey=2.0, electrons_per_grey=50.0)


@pytest.fixture(scope="module")
def sensor():
    return ResidualSensor(GRID, "noise", NOISE, 8, light=LIGHT)


@pytest.fixture(scope="module")
def exact():
    return ResidualSensor(GRID, "noise", Noise(), 16, light=LIGHT)


def test_one_step_converges_quadratically(exact):
    errors = []
    for scale in (0.4, 0.2):
        d = exact.measure(exposed(observed(LIGHT, 0.5 * scale, -scale))).d[INNER]
        errors.append(np.sqrt(np.mean((d - (0.5 * scale, -scale)) ** 2)))
    # curvature of the texture: error ~ d^2; halving d leaves at most 0.3 of it (0.25 and rounding)
    assert errors[0] < 0.03
    assert errors[1] < 0.35 * errors[0]


def test_brightness_and_contrast_do_not_matter(exact):
    light = observed(LIGHT, 0.1, 0.05)
    one = exact.measure(exposed(light)).copy()
    two = exact.measure(exposed(0.1 + 0.7 * light))
    assert np.median(np.abs(one.d[INNER] - two.d[INNER])) < 2e-5  # quantisation


def test_sigma_matches_monte_carlo(sensor):
    rng = np.random.default_rng(2)
    light = observed(LIGHT)
    frames = [sensor.measure(exposed(light, 8, rng=rng, noise=NOISE)).copy() for _ in range(150)]
    spread = np.std([f.d[INNER] for f in frames], axis=0, ddof=1)
    ratio = np.median(spread / np.median([f.sigma[INNER] for f in frames], axis=0))
    # 70 independent nodes of 150 frames: 1 %
    assert 0.95 < ratio < 1.05
    assert np.mean([f.valid[INNER].mean() for f in frames]) > 0.98


def test_another_part_of_the_texture_is_not_trusted(sensor):
    residual = sensor.measure(exposed(observed(LIGHT, 57.0, 33.0), 8))
    assert residual.valid[INNER].mean() < 0.2
    assert (residual.flags[INNER] & Flag.AMBIGUOUS > 0).mean() > 0.5


def test_dark_frame_is_flagged(sensor):
    residual = sensor.measure(np.zeros(SHAPE, np.uint8))
    assert (residual.flags[INNER] & Flag.MODULATION).all()
    assert np.isfinite(residual.d).all()
