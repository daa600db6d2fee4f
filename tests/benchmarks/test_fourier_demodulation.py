import numpy as np
import pytest

from benchmarks.against_peers.bound import bound_px
from benchmarks.against_peers.frames import CROSSED, SIGMA_GREY, Bump, noisy
from benchmarks.against_peers.methods import fourier_demodulation

SHAPE = (256, 320)
INSIDE = (slice(48, -48), slice(48, -48))


@pytest.mark.parametrize(
    ("peak_px", "width_px", "within_px"),
    # Eight bits alone make 3.6 mpx (the bound for s^2 = 1/12); the rest is what the sharp filter rings.
    [(0.6, 60.0, 0.006), (12.0, 45.0, 0.02)],
)
def test_a_planted_displacement_comes_back_with_its_sign(peak_px, width_px, within_px):
    bump = Bump(SHAPE, peak_px, width_px)
    planted = bump.everywhere()
    read = fourier_demodulation(SHAPE).read(CROSSED.frames(planted))
    assert read.dtype == np.float32
    assert np.sqrt(np.mean((read - planted)[INSIDE] ** 2)) < within_px


def test_its_noise_is_that_of_the_bound_of_its_filter():
    # The filter's impulse response has sum w^2 = its share of the spectrum, pi (f / sqrt 2)^2 at f = 1/16.
    contender = fourier_demodulation(SHAPE)
    light, rng = CROSSED.light_grey(np.zeros((*SHAPE, 2))), np.random.default_rng(0)
    reads = [contender.read(noisy(light, SIGMA_GREY, rng))[INSIDE] for _ in range(8)]
    noise = np.sqrt(np.mean(np.var(reads, axis=0, ddof=1)))
    # 160 x 224 px x 7 degrees of freedom, correlated over 160 px: 1 in 1500 independent ones, 2 % rms.
    assert noise / bound_px(np.pi / 512, CROSSED) == pytest.approx(1.0, abs=0.06)
