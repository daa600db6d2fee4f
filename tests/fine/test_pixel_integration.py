import numpy as np
import pytest
from scipy.fft import dct, dctn, idctn

from zeromethod.errors import MeasurementError
from zeromethod.fine.integrate import PixelIntegrator, sources, step_weights, take_out
from zeromethod.fine.noise import wave_variance
from zeromethod.surface.differences import depth_differences

SHAPE = (90, 130)
STEP_MM = (0.05, 0.033)


def points():
    x, y = np.meshgrid(np.arange(SHAPE[1]) * STEP_MM[0], np.arange(SHAPE[0]) * STEP_MM[1])
    return x, y


def dent(x, y):
    depth = 1e-3 * np.exp(-((x - 4.0) ** 2 + (y - 1.2) ** 2) / (2 * 0.3**2))
    return depth, np.stack([-(x - 4.0) / 0.09 * depth, -(y - 1.2) / 0.09 * depth])


def solved(slope, slope2, valid):
    x, y = points()
    across, down = depth_differences(np.moveaxis(slope, 0, -1), x, y, valid)
    steps = across.astype(np.float32), np.ascontiguousarray(down, dtype=np.float32)
    integrator = PixelIntegrator(SHAPE)
    weights = step_weights(slope2.astype(np.float32), x, y, np.ones(SHAPE, np.float32), valid)
    x = np.zeros(SHAPE, np.float32)
    integrator.solve(sources(steps, weights), weights, x)
    return x, integrator.iterations


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("holes", [False, True])
def test_a_narrow_dent_comes_back_to_a_ten_thousandth(uneven, holes):
    x, y = points()
    depth, slope = dent(x, y)
    valid = np.ones(SHAPE, bool)
    if holes:
        valid[20:34, 60:74] = valid[60:70, 10:40] = False
    slope2 = np.full((2, *SHAPE), 1e-8) * (1 + 3 * uneven * x / x.max())
    found, iterations = solved(np.where(valid, slope, 0.0), slope2, valid)
    error = (found - depth)[valid]
    # next to holes the stencils are one-sided: 4 points
    assert np.abs(error - error.mean()).max() < (4e-4 if holes else 5e-5) * depth.max()
    assert iterations <= 15


def test_contradictory_slopes_are_shared_out_by_the_noise_of_depth():
    rows, cols = 9, 14
    rng, (y, x) = np.random.default_rng(1), np.mgrid[:rows, :cols].astype(np.float32)
    # the scale grows as the mirror's distance from the LCD, fivefold
    scale = np.linspace(0.5, 2.5, cols, dtype=np.float32) * np.ones((rows, 1), np.float32)
    slope2, valid = np.ones((2, rows, cols), np.float32), np.ones((rows, cols), bool)
    across, down = (rng.standard_normal(s).astype(np.float32) for s in ((rows, cols - 1), (rows - 1, cols)))
    here, beyond = np.zeros(0, int), np.zeros(0, int)
    at = np.arange(rows * cols).reshape(rows, cols)
    for one, two in ((at[:, :-1], at[:, 1:]), (at[:-1], at[1:])):
        here, beyond = np.append(here, one), np.append(beyond, two)
    size = np.sqrt(scale.ravel()[here] * scale.ravel()[beyond])
    steps = np.zeros((len(here), at.size))
    steps[np.arange(len(here)), beyond], steps[np.arange(len(here)), here] = size, -size
    least = np.linalg.lstsq(steps, np.append(across, down), rcond=None)[0].reshape(rows, cols)
    weights = step_weights(slope2, x, y, scale, valid)
    take_out(np.zeros((rows, cols), np.float32), scale, across, down)
    found = np.zeros((rows, cols), np.float32)
    PixelIntegrator((rows, cols)).solve(sources((across, down), weights), weights, found)
    off = found - found.mean() - (least - least.mean())
    # what the iterations leave in single precision; with weights of the slopes alone 7 %
    assert np.abs(off).max() < 1e-5 * np.ptp(least)


def stated_variance(wave, anchor):
    """Variance of depth less its mean with the anchor's weights: sum v (c - a)^2 over all cosines c."""
    of_anchor = dctn(anchor, norm="ortho")
    rows, cols = (dct(np.eye(count), norm="ortho", axis=0) ** 2 for count in SHAPE)
    shared = idctn(wave * of_anchor, norm="ortho")
    return rows.T @ wave @ cols - 2.0 * shared + (wave * of_anchor**2).sum()


def test_noise_of_depth_is_that_of_drawn_slopes():
    anchor = np.zeros(SHAPE)
    anchor[:, :10] = 1.0 / anchor[:, :10].size
    sigma = np.array([1e-4, 2e-4])
    stated = stated_variance(wave_variance(SHAPE, STEP_MM, tuple(sigma**2)), anchor)
    rng, total, draws = np.random.default_rng(0), np.zeros(SHAPE), 60
    slope2 = np.broadcast_to((sigma**2)[:, None, None], (2, *SHAPE))
    for _ in range(draws):
        slope = sigma[:, None, None] * rng.standard_normal((2, *SHAPE))
        found, _ = solved(slope, slope2, np.ones(SHAPE, bool))
        total += (found - (found * anchor).sum()) ** 2 / draws
    # variance from 60 draws of a field with some ten independent parts
    assert np.mean(total / stated) == pytest.approx(1.0, abs=0.15)


def test_steps_without_weight_count_nothing_whatever_they_are():
    valid = np.ones(SHAPE, bool)
    valid[:, :30] = False
    x, y = points()
    weights = step_weights(np.ones((2, *SHAPE), np.float32), x, y, np.ones(SHAPE, np.float32), valid)
    across, down = (np.ones(one.shape, np.float32) for one in weights)
    plain = sources((across, down), weights)
    across[weights[0] == 0.0] = down[weights[1] == 0.0] = np.nan  # as beyond P0, where the scale is negative
    np.testing.assert_array_equal(sources((across, down), weights), plain)


def test_a_depth_that_is_not_found_is_refused():
    weights = np.ones((90, 129), np.float32), np.ones((89, 130), np.float32)
    with pytest.raises(MeasurementError, match="not solved"):
        PixelIntegrator(SHAPE).solve(np.full(SHAPE, np.nan, np.float32), weights, np.zeros(SHAPE, np.float32))
