import numpy as np
import pytest

from zeromethod.sensing.window import curvature_bias_px2, transfer, triangle


@pytest.mark.parametrize("period", [8, 10, 16])
def test_double_zero_at_every_harmonic_of_the_carrier(period):
    offset = np.arange(1 - period, period)
    w = triangle(period)
    assert w.sum() == pytest.approx(1, abs=1e-14)
    for n in range(1, period):
        wave = np.exp(2j * np.pi * n * offset / period)
        # value and first derivative vanish: rounding only
        assert abs(np.sum(w * wave)) < 1e-14
        assert abs(np.sum(w * offset * wave)) < 1e-12


def test_transfer_is_the_windows_spectrum():
    offset, f = np.arange(-15, 16), 0.03
    assert transfer(16, f) == pytest.approx(np.sum(triangle(16) * np.cos(2 * np.pi * f * offset)), abs=1e-14)
    assert transfer(16, 0.0) == 1.0


def test_second_moment_is_twice_the_curvature_bias():
    offset = np.arange(-15, 16)
    assert np.sum(triangle(16) * offset**2) / 2 == pytest.approx(curvature_bias_px2(16), rel=1e-13)
