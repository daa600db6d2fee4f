import numpy as np
import pytest

from benchmarks.against_peers.bound import bound_px
from benchmarks.against_peers.frames import SIGMA_GREY, Bump, noisy, stepped
from benchmarks.against_peers.methods import phase_shifting

SHAPE = (128, 160)


@pytest.mark.parametrize("steps", [3, 4, 8])
@pytest.mark.parametrize(("peak_px", "width_px"), [(0.6, 40.0), (12.0, 30.0)])
def test_a_planted_displacement_comes_back_pixel_by_pixel(steps, peak_px, width_px):
    planted = Bump(SHAPE, peak_px, width_px).everywhere()
    read = phase_shifting(steps)(SHAPE).read(stepped(steps).frames(planted))
    # Rounding to whole grey levels is all that is wrong: the bound at sigma 0, but for pictures half a period
    # apart, which round in opposite directions: up to sqrt 2 more.
    assert np.sqrt(np.mean((read - planted) ** 2)) < 1.5 * bound_px(1.0, stepped(steps), sigma_grey=0.0)


@pytest.mark.parametrize("steps", [4, 8])
def test_its_noise_is_the_bound_of_a_single_pixel(steps):
    light = stepped(steps).light_grey(np.zeros((*SHAPE, 2)))
    rng = np.random.default_rng(0)
    reads = [phase_shifting(steps)(SHAPE).read(noisy(light, SIGMA_GREY, rng)) for _ in range(4)]
    noise = np.sqrt(np.mean(np.var(reads, axis=0, ddof=1)))
    # 20480 px x 2 components x 3: 0.2 % rms.
    assert noise / bound_px(1.0, stepped(steps)) == pytest.approx(1.0, abs=0.015)
