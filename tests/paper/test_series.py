import numpy as np
import pytest

from zeromethod.errors import InputError, MeasurementError
from zeromethod.paper.needle import exact_picks, printed_picks
from zeromethod.paper.series import reconstruct

from .plane_rays import Press

LENGTH, PEAK, WIDTH = 85.0, 0.2, 6.0
BENCH = {"alpha0": np.pi / 4, "beta0": np.pi / 4, "length": LENGTH}


PRESS = Press(PEAK, 45.0, WIDTH * np.sqrt(2))
_depth = PRESS.depth


def _theta(at):
    return np.arctan(PRESS.slope(at))


def _error(spacing, **options):
    at = np.arange(4.0, 82.0, spacing)
    m, w = exact_picks(at, _depth(at), _theta(at), **BENCH)
    return reconstruct(m, w, **BENCH, rim=0.0, **options), at


def _worst(series, at):
    return max(np.abs(series.depth_rises - _depth(at)).max(), np.abs(series.depth_drops - _depth(at)).max())


def test_exact_inversion_converges_to_the_press_as_points_get_closer():
    coarse, fine = (_worst(*_error(h, invert="equation 12", step="centred")) for h in (0.5, 0.25))
    # the interval's rule is of second order: 4 per halving, and below 0.1 % of the press
    assert coarse / fine == pytest.approx(4.0, rel=0.25)
    assert fine < 1e-3 * PEAK


def test_the_printed_sum_lags_by_one_interval_and_the_average_of_both_series_cancels_it():
    series, at = _error(0.25, invert="equation 12", step="printed")
    steepest = np.abs(np.tan(_theta(at))).max()
    rises, drops = series.depth_rises - _depth(at), series.depth_drops - _depth(at)
    # one spacing times the slope, with opposite signs
    assert np.abs(drops).max() == pytest.approx(0.25 * steepest, rel=0.2)
    assert np.corrcoef(rises, drops)[0, 1] < -0.9
    assert np.abs(rises + drops).max() / 2 < 0.3 * np.abs(drops).max()


def test_a_closed_rim_finds_the_slope_that_a_straight_start_cannot():
    # a wedge that starts steep at P0: exact geometry leaves a multiple of l open there
    at = np.arange(1.0, LENGTH)
    d = 1.5 * np.sin(np.pi * at / LENGTH)
    theta = np.arctan(1.5 * np.pi / LENGTH * np.cos(np.pi * at / LENGTH))
    m, w = exact_picks(at, d, theta, **BENCH)
    closed = reconstruct(m, w, **BENCH, invert="equation 12", step="centred", rim="closed")
    straight = reconstruct(m, w, **BENCH, invert="equation 12", step="centred")
    assert np.abs(closed.depth_rises - d).max() < 2e-3 * 1.5
    assert np.abs(straight.depth_rises - d).max() > 0.1 * 1.5


def test_equation_17_recovers_a_shallow_press_of_its_own_model():
    at = np.arange(4.0, 82.0, 0.25)
    m, w = printed_picks(at, _depth(at), _theta(at), **BENCH)
    series = reconstruct(m, w, **BENCH, step="centred", rim=0.0, keep_gamma=False)
    # theta is short by (8/3) theta^3: at 20 mrad 0.1 % of the slope
    assert np.abs(series.theta - _theta(at)).max() < 4 * np.abs(_theta(at)).max() ** 3
    assert np.abs(series.depth - _depth(at)).max() < 2e-3 * PEAK


def test_positions_follow_the_depth():
    series, at = _error(0.25, invert="equation 12", step="centred")
    np.testing.assert_allclose(series.l, at, atol=2e-3 * PEAK)
    assert series.depth == pytest.approx((series.depth_rises + series.depth_drops) / 2)


@pytest.mark.parametrize(
    ("m", "w", "length", "words"),
    [
        ([1.0], [2.0], 10.0, "shapes"),
        ([1.0, 2.0], [2.0], 10.0, "shapes"),
        ([1.0, np.nan], [2.0, 1.0], 10.0, "not finite"),
        ([1.0, 2.0], [1.0, 2.0], 10.0, "not falling"),
        ([1.0, 2.0], [2.0, 1.0], 0.0, "length"),
        ([-1.0, 2.0], [2.0, 1.0], 10.0, "above 0"),
    ],
)
def test_what_cannot_be_picks_is_refused(m, w, length, words):
    with pytest.raises(InputError, match=words):
        reconstruct(m, w, alpha0=0.8, beta0=0.8, length=length)


def test_picks_that_no_closed_profile_explains_fail():
    # every ray would land at P0 itself, whatever the mirror
    w, m = np.linspace(50.0, 5.0, 24), np.full(24, 1e-3)
    with pytest.raises(MeasurementError, match="no slope at P0"):
        reconstruct(m, w, **{**BENCH, "length": 80.0}, invert="equation 12", rim="closed")
