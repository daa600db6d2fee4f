import numpy as np
import pytest
from scipy.integrate import quad

from zeromethod.paper.equations import (
    captured_distance,
    depth_step,
    elevation,
    expanded_angle_change,
    lean_between,
    mirror_distance,
    next_depth_step,
    pattern_angle,
    pattern_distance,
    reflected_angle,
)
from zeromethod.paper.needle import exact_picks, printed_picks

from .plane_rays import Press, traced

LENGTH = 80.0
BENCHES = [(np.pi / 4, np.pi / 4), (0.9, 0.7), (0.6, 0.8)]


PRESS = Press(0.8, 45.0, 12.0)


def _rays(alpha0, beta0, w=np.linspace(12.0, 40.0, 9)):  # noqa: B008
    bench = {"alpha0": alpha0, "beta0": beta0, "length": LENGTH}
    found = np.array([traced(float(at), PRESS.depth, PRESS.slope, **bench) for at in w])
    return w, *found.T


@pytest.mark.parametrize(("alpha0", "beta0"), BENCHES)
def test_equations_8_to_14_are_exact_on_traced_rays(alpha0, beta0):
    w, at, m, alpha = _rays(alpha0, beta0)
    d, theta = PRESS.depth(at), np.arctan(PRESS.slope(at))
    # rounding only: the tracing's root is good to 1e-13 of 80
    np.testing.assert_allclose(reflected_angle(beta0, -theta), alpha, atol=1e-12)
    np.testing.assert_allclose(lean_between(alpha, beta0), -theta, atol=1e-12)
    np.testing.assert_allclose(np.tan(elevation(d, at)), d / at, atol=1e-14)
    np.testing.assert_allclose(pattern_distance(at, d, alpha, alpha0), m, rtol=1e-11)
    np.testing.assert_allclose(captured_distance(LENGTH - at, d, beta0, beta0), w, rtol=1e-11)
    np.testing.assert_allclose(mirror_distance(w, d, beta0), LENGTH - at, rtol=1e-11)
    np.testing.assert_allclose(pattern_angle(m, at, d, alpha0), alpha, atol=1e-11)


def test_equation_14_without_gamma_is_undone_by_its_own_inverse():
    l_prime, d = np.array([5.0, 40.0]), np.array([0.4, -1.0])
    w = captured_distance(l_prime, d, 0.7, 0.7, gamma=0.0)
    np.testing.assert_allclose(mirror_distance(w, d, 0.7, keep_gamma=False), l_prime, rtol=1e-13)


@pytest.mark.parametrize("theta", [-0.3, 0.0, 0.2])
@pytest.mark.parametrize("turn", [-0.1, 1e-7, 0.0, 0.15])
@pytest.mark.parametrize("length", [3.0, -3.0])
def test_equation_5_is_the_integral_of_an_evenly_turning_slope(theta, turn, length):
    # equation 4, by quadrature
    expected, _ = quad(lambda at: np.tan(theta + turn * at / length), 0.0, length)
    assert depth_step(length, theta, turn) == pytest.approx(expected, abs=1e-12)


def test_equation_5_errs_by_the_third_power_of_the_interval():
    def error(h):
        a, b = np.arctan(PRESS.slope(40.0)), np.arctan(PRESS.slope(40.0 + h))
        return abs(float(depth_step(h, a, b - a)) - (PRESS.depth(40.0 + h) - PRESS.depth(40.0)))

    # slope is not linear in l: the remainder is h^3 d'''/12, so 8 per halving (next order: a few percent)
    assert error(1.0) / error(0.5) == pytest.approx(8.0, rel=0.1)


def test_equation_19_lags_by_one_interval_so_errs_by_the_second_power():
    def error(h):
        a, b = np.arctan(PRESS.slope(40.0 - h)), np.arctan(PRESS.slope(40.0))
        return abs(float(next_depth_step(h, a, b - a)) - (PRESS.depth(40.0 + h) - PRESS.depth(40.0)))

    # h^2 d'' per interval: 4 per halving
    assert error(0.5) / error(0.25) == pytest.approx(4.0, rel=0.1)


def test_at_rest_the_ray_is_normal_to_the_pattern():
    _, m, alpha = traced(20.0, lambda _: 0.0, lambda _: 0.0, alpha0=0.7, beta0=0.7, length=LENGTH)
    assert alpha == pytest.approx(0.7, abs=1e-13)
    assert m == pytest.approx((LENGTH - 20.0 / np.cos(0.7)) * np.cos(0.7), rel=1e-13)


@pytest.mark.parametrize("alpha0", [np.pi / 4, 0.6, 0.9])
def test_equation_17_is_a_root_of_the_second_order_expansion_and_zero_at_rest(alpha0):
    at, d = 30.0, 0.5
    r2 = at * at + d * d
    c, s = np.cos(alpha0), np.sin(alpha0)
    assert expanded_angle_change(np.sqrt(r2) * c, at, d, alpha0) == pytest.approx(0.0, abs=1e-15)
    m = 1.05 * np.sqrt(r2) * c
    x = float(expanded_angle_change(m, at, d, alpha0))
    # equation 16 with cos^2(x) -> 1 - x^2, cos^2(alpha0 + x) -> c^2 - 2 c s x - (c^2 - s^2) x^2
    expansion = m * m * (1 - x * x) - r2 * (c * c - 2 * c * s * x - (c * c - s * s) * x * x)
    assert expansion == pytest.approx(0.0, abs=1e-10 * r2)
    # and the printed form, one root over the product, with the plus sign
    a, b = -m * m + r2 * (c * c - s * s), r2 * c * s
    printed = (-b + np.sqrt(b * b - (m * m - r2 * c * c) * a)) / a
    assert x == pytest.approx(printed, abs=1e-14)


@pytest.mark.parametrize(("alpha0", "lead"), [(np.pi / 4, 2.0 / 3.0), (0.6, None)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_equation_17_errs_by_the_third_power_of_the_angle(alpha0, lead, sign):
    def error(x):
        # a point that has not left the mirror's plane: gamma = 0 is exact, m traced from the bare triangle
        alpha = alpha0 + x
        m = 50.0 * np.sin(np.pi / 2 - alpha) / np.sin(np.pi / 2 + alpha - alpha0)
        return x - float(expanded_angle_change(m, 50.0, 0.0, alpha0))

    big, small = error(sign * 0.02), error(sign * 0.01)
    assert big / small == pytest.approx(8.0, rel=0.1)  # the next order is x = 2 % of this one, times a few
    if lead is not None:
        assert small == pytest.approx(lead * (sign * 0.01) ** 3, rel=0.05)


def test_gamma_zero_makes_the_angle_too_small_by_d_over_l():
    def shortfall(scale):
        bench = {"alpha0": np.pi / 4, "beta0": np.pi / 4, "length": LENGTH}
        at, m, alpha = traced(
            30.0, lambda at: scale * PRESS.depth(at), lambda at: scale * PRESS.slope(at), **bench
        )
        missed = alpha - np.pi / 4 - float(expanded_angle_change(m, at, scale * PRESS.depth(at), np.pi / 4))
        return missed, scale * PRESS.depth(at) / at

    missed, gamma = shortfall(0.01)
    assert missed == pytest.approx(gamma, rel=0.02)
    # first order in depth: halving the press halves it
    assert shortfall(0.02)[0] / missed == pytest.approx(2.0, rel=0.02)


def test_equation_17_is_real_for_every_m():
    m = np.geomspace(1e-3, 1e3, 301)
    for alpha0 in np.linspace(0.1, 1.5, 29):
        assert np.isfinite(expanded_angle_change(m, 1.0, 0.1, alpha0)).all()


BENCH = {"alpha0": 0.8, "beta0": 0.7, "length": 60.0}
SMALL = Press(0.5, 35.0, 8.0)


def test_exact_picks_agree_with_rays_traced_from_the_camera():
    w = np.linspace(8.0, 30.0, 12)
    at, m, _ = np.array([traced(float(at), SMALL.depth, SMALL.slope, **BENCH) for at in w]).T
    found_m, found_w = exact_picks(at, SMALL.depth(at), np.arctan(SMALL.slope(at)), **BENCH)
    np.testing.assert_allclose(found_w, w, rtol=1e-12)
    np.testing.assert_allclose(found_m, m, rtol=1e-12)


def test_at_rest_both_models_are_the_same():
    at = np.linspace(5.0, 55.0, 11)
    rest = np.zeros_like(at)
    for exact, printed in zip(
        exact_picks(at, rest, rest, **BENCH), printed_picks(at, rest, rest, **BENCH), strict=True
    ):
        np.testing.assert_allclose(exact, printed, rtol=1e-13)


def test_the_printed_model_differs_in_first_order_of_the_depth():
    at = np.array([35.0])

    def difference(scale):
        d, theta = scale * SMALL.depth(at), np.zeros(1)
        return exact_picks(at, d, theta, **BENCH)[0] - printed_picks(at, d, theta, **BENCH)[0]

    # at beta0 = 0.7 the ray leaves at alpha = 0.7: m grows by d sin(alpha) / cos(alpha - alpha0)
    small = 1e-3 * 0.5 * np.sin(0.7) / np.cos(0.1)
    assert difference(1e-3)[0] == pytest.approx(small, rel=1e-3)
