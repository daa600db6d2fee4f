"""Which periods confuse places: the union bound against a Monte Carlo of the decoder itself."""

import numpy as np
import pytest
from scipy.optimize import brentq

from zeromethod.decoding.decoding import decode_phasors
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import SEPARATION_RAD, choose_periods, order_error, rivals, unambiguous_range
from zeromethod.decoding.unwrapping import Waves, unwrap

SIZE = 1000


def wrong_share(periods: tuple[float, ...], phase_sigma: float, seed: int = 0) -> float:
    """Share of 200 x 200 pixels, places at random, given another order; phase noise planted."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, SIZE - 1, (200, 200))
    sequence = FringeSequence(periods, equal_shifts(4))
    amplitude = 100.0
    sigma_grey = phase_sigma * amplitude * np.sqrt(2.0)  # sigma_phase = sqrt(2 / N) sigma / amplitude
    frames = [
        120
        + amplitude * np.cos(2 * np.pi * x / periods[fringes.period] - shift)
        + sigma_grey * rng.normal(size=x.shape)
        for fringes in sequence.sets()
        for shift in sequence.shifts_rad
    ]
    phasors = decode_phasors(frames, sequence)
    every = np.ones(x.shape, dtype=bool)
    noise = NoiseModel(sigma_grey**2, 0.0)
    found = unwrap(Waves.of(phasors, 0, noise, np.full(x.shape, 120, np.float32)), SIZE, every)
    # The decoder's own sigma is far below half the shortest period, so this counts wrong orders, not noise.
    assert np.nanmedian(found.phase_sigma_rad) == pytest.approx(phase_sigma, rel=0.05)
    return float(np.mean(np.abs(found.x_px - x) > 4))


def test_close_periods_confuse_places_and_spread_ones_do_not():
    near, spread = (127.0, 128.0), (9.0, 64.0, 128.0)
    sigma = brentq(lambda s: order_error(near, s, SIZE) - 0.22, 0.005, 0.03)
    assert order_error(spread, sigma, SIZE) < 1e-3
    # 40,000 pixels know 22 % to 0.2 %; the union bound counts a pixel twice whose both neighbours are rivals,
    # and the search reaches half a period past the panel.
    assert wrong_share(near, sigma) == pytest.approx(0.22, abs=0.03)
    assert wrong_share(spread, sigma) < 1e-3


@pytest.mark.parametrize(
    ("periods", "sigma"),
    [((9.0, 64.0, 128.0), 0.025), ((16.0, 18.0, 19.0), 0.11), ((24.0, 25.0, 26.0, 27.0), 0.1)],
)
def test_the_bound_predicts_the_share_of_wrong_orders(periods, sigma):
    predicted, found = order_error(periods, sigma, SIZE), wrong_share(periods, sigma)
    assert 0.005 < predicted < 0.1  # rare enough for the union bound, common enough for 40,000 draws
    # 0.005 of 40,000 draws is known to 7 %. The bound counts rivals twice that are confused together; phases
    # of a tenth of a radian have tails a little wider than Gaussian.
    assert 0.7 * predicted < found < 1.25 * predicted


def test_rivals_of_two_periods_lie_at_their_multiples():
    # D = 127: period 127 is off by 0, period 128 by one px, 2 pi / 128; a compromise halves the square.
    offset, distance = rivals((127, 128), 1.0, 300)
    assert offset == pytest.approx([127.5, 255.0], abs=0.01)
    assert distance == pytest.approx(np.array([1, 2]) * 2 * np.pi / np.hypot(127, 128), rel=1e-3)


@pytest.mark.parametrize("size", [800, 1280, 1920, 2560, 3840])
def test_default_periods_keep_every_place_apart(size):
    periods = choose_periods(size)
    assert len(periods) == 4
    assert rivals(periods, 1.0, size)[1].min() > SEPARATION_RAD
    # 0.05 rad is three times the noise of two grey levels at an amplitude of 80, six shifts.
    assert order_error(periods, 0.05, size) < 1e-15
    assert unambiguous_range(periods, 0.05) > size


def test_the_longest_side_that_two_sine_waves_can_settle_is_their_beat():
    # Without noise 9 and 10 px coincide again at 90 px; the range ends where the best compromise lies.
    assert unambiguous_range((9, 10), 1e-4) == pytest.approx(89, abs=0.2)
