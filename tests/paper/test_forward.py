import numpy as np
import pytest

from zeromethod.paper.needle import exact_picks, printed_picks

from .plane_rays import traced

BENCH = {"alpha0": 0.8, "beta0": 0.7, "length": 60.0}


def _depth(at):
    return 0.5 * np.exp(-(((at - 35.0) / 8.0) ** 2))


def _slope(at):
    return -2 * (at - 35.0) / 64.0 * _depth(at)


def test_exact_picks_agree_with_rays_traced_from_the_camera():
    w = np.linspace(8.0, 30.0, 12)
    at, m, _ = np.array([traced(float(at), _depth, _slope, **BENCH) for at in w]).T
    found_m, found_w = exact_picks(at, _depth(at), np.arctan(_slope(at)), **BENCH)
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
        d, theta = scale * _depth(at), np.zeros(1)
        return exact_picks(at, d, theta, **BENCH)[0] - printed_picks(at, d, theta, **BENCH)[0]

    # at beta0 = 0.7 the ray leaves at alpha = 0.7: m grows by d sin(alpha) / cos(alpha - alpha0)
    small = 1e-3 * 0.5 * np.sin(0.7) / np.cos(0.1)
    assert difference(1e-3)[0] == pytest.approx(small, rel=1e-3)
