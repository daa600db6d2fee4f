import numpy as np
import pytest
from scipy.fft import idctn

from zeromethod.fine.summit import summit

X, Y = (
    one.astype(np.float32)
    for one in np.meshgrid(0.05 * (np.arange(300) - 150), 0.033 * (np.arange(240) - 110))
)
R = np.hypot(X - 0.7, Y - 0.4)
ALL = np.ones(R.shape, bool)


@pytest.mark.parametrize("sigma_mm", [0.3, 1.0, 2.0])
def test_a_dents_peak_is_within_a_few_ten_thousandths(sigma_mm):
    depth, x, y = summit(np.float32(-3e-3) * np.exp(-0.5 * (R / sigma_mm) ** 2), X, Y, ALL)
    # a quartic over 0.85 sigma is off by 3.3e-4, 4e-4 on the least square of the narrowest
    assert depth == pytest.approx(-3e-3, rel=4e-4)
    assert np.hypot(x - 0.7, y - 0.4) < 0.02


def test_noise_that_varies_slowly_is_averaged_over_the_dents_own_top():
    # as of integrated slopes: 1 over the wave number
    waves = np.hypot(*np.meshgrid(np.arange(300) / 300, np.arange(240) / 240)) + 0.02
    rng, errors = np.random.default_rng(0), []
    for _ in range(12):
        noise = idctn(rng.standard_normal(R.shape) / waves, norm="ortho")
        dent = 2e-3 * np.exp(-0.5 * (R / 2.0) ** 2) + 2e-5 * noise / noise.std()
        errors.append(summit(dent.astype(np.float32), X, Y, ALL)[0] / 2e-3 - 1)
    # 1 % at a pixel, alike within some 5 px; a quartic through 85 x 56 px leaves about a quarter of it
    assert np.sqrt(np.mean(np.square(errors))) < 0.004


def test_a_flat_top_is_not_bent_by_its_flank():
    punch = (2e-3 / (1.0 + np.exp(np.minimum((R - 2.0) / 0.05, 50.0)))).astype(np.float32)
    assert summit(punch, X, Y, ALL)[0] == pytest.approx(2e-3, rel=1e-3)


def test_nothing_known_has_no_summit():
    assert np.isnan(summit(X, X, Y, ~ALL)).all()
