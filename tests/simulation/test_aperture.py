"""Aperture integrals, with and without a lens, against brute-force supersampling."""

import numpy as np
import pytest
from scipy.special import ndtr

from zeromethod.simulation.aperture import gather


def gathered(light, q, by_u, by_v, fill, stripes, psf_px=0.0) -> np.ndarray:
    out = np.zeros((1, len(q)))
    gain = np.ones((1, len(q)))
    gather(light, q[None], by_u[None], by_v[None], gain, fill, stripes, psf_px, out)
    return out[0]


def response(count: int, psf_px: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(s, t, weights) of a pixel's response, box * Gaussian out to 4.5 sigma, at `count` points.

    Spread by Roberts' R2 sequence: a grid of points would beat with the apertures.
    """
    reach = 0.5 + 4.5 * psf_px
    number = np.arange(count)[:, None]
    place = ((0.5 + number * [0.7548776662466927, 0.5698402909980532]) % 1 * 2 - 1) * reach
    weight = np.ones(count)
    if psf_px > 0:
        weight = (ndtr((place + 0.5) / psf_px) - ndtr((place - 0.5) / psf_px)).prod(axis=1)
    return place[:, 0], place[:, 1], weight / weight.sum()


def supersampled(light, q, by_u, by_v, fill, stripes, count: int, psf_px=0.0) -> np.ndarray:
    """Mean of lit / (fill x fill) over `count` points of the pixel's response."""
    s, t, weight = response(count, psf_px)
    point = q[:, None] + s[:, None] * by_u[:, None] + t[:, None] * by_v[:, None]
    pixel = np.floor(point + 0.5).astype(int)
    inner = point + 0.5 - pixel
    lit_x = np.abs((inner[..., 0] * stripes) % 1.0 - 0.5) < fill[0] / 2
    lit_y = np.abs(inner[..., 1] - 0.5) < fill[1] / 2
    rows, cols = light.shape
    on = (pixel >= 0).all(-1) & (pixel[..., 0] < cols) & (pixel[..., 1] < rows)
    value = light[np.clip(pixel[..., 1], 0, rows - 1), np.clip(pixel[..., 0], 0, cols - 1)]
    return (value * lit_x * lit_y * on) @ weight / (fill[0] * fill[1])


@pytest.fixture
def light() -> np.ndarray:
    return np.random.default_rng(0).uniform(size=(20, 30))


@pytest.mark.parametrize("stripes", [1, 3])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("psf_px", [0.0, 0.7])
def test_footprints_along_the_axes_are_exact(light, stripes, turned, psf_px):
    rng = np.random.default_rng(1)
    q = rng.uniform([-1, -1], [30, 20], (60, 2))  # some reach beyond the panel
    zero = np.zeros(60)
    by_u = np.stack((rng.uniform(0.3, 3.5, 60), zero), axis=-1)
    by_v = np.stack((zero, rng.uniform(-3.5, -0.3, 60)), axis=-1)
    if turned:
        by_u, by_v = by_v, by_u
    got = gathered(light, q, by_u, by_v, (0.8, 0.6), stripes, psf_px)
    expected = supersampled(light, q, by_u, by_v, (0.8, 0.6), stripes, 40_000, psf_px)
    # 40000 points leave a few 1e-4 per aperture's edge, 1/fill^2 = 2; fewer of them count with a lens
    doubt = 1 if psf_px == 0 else 2
    np.testing.assert_allclose(got, expected, atol=0.005 * doubt)
    assert np.abs(got - expected).mean() < 1e-3 * doubt


@pytest.mark.parametrize("psf_px", [0.05, 0.3, 0.7, 2.0])
def test_an_edge_on_the_lcd_gives_box_times_gaussian(psf_px):
    light = np.zeros((40, 80))
    light[:, 40:] = 1.0
    u = np.linspace(-4, 4, 33)
    q = np.stack((39.5 + 0.9 * u, np.full(33, 20.0)), axis=-1)
    by_u, by_v = np.tile([0.9, 0.0], (33, 1)), np.tile([0.0, 0.9], (33, 1))
    got = gathered(light, q, by_u, by_v, (1.0, 1.0), 1, psf_px)
    box = (np.arange(2000) + 0.5) / 2000 - 0.5
    expected = ndtr((u[:, None] + box) / psf_px).mean(axis=1)
    # a Gaussian cut at 4 sigma past the pixel lacks at most 2 sigma 7e-6 along either axis
    np.testing.assert_allclose(got, expected, atol=6e-5)


@pytest.mark.parametrize(
    ("by_u", "by_v", "tolerance"),
    [
        # what CUTS, or moments alone, cost on white noise, the worst that a panel can show: see `gather`
        ((0.866, 0.5), (-0.5, 0.866), 0.001),
        ((1.0, 0.1), (0.1, 1.0), 0.006),
        ((1.0, 0.0), (0.35, 1.0), 0.02),
    ],
    ids=["turned by 30 deg", "sheared by 0.1", "sheared by 0.35"],
)
def test_lens_on_turned_and_sheared_footprints(light, by_u, by_v, tolerance):
    q = np.random.default_rng(3).uniform([4, 4], [25, 15], (60, 2))
    sides = [np.tile(0.6 * np.array(side), (60, 1)) for side in (by_u, by_v)]
    got = gathered(light, q, *sides, (0.9, 0.85), 1, 0.7)
    expected = supersampled(light, q, *sides, (0.9, 0.85), 1, 40_000, 0.7)
    assert np.sqrt(np.mean((got - expected) ** 2)) < tolerance
    assert expected.std() > 0.1


def test_turned_footprints_are_close(light):
    rng = np.random.default_rng(2)
    q = rng.uniform([3, 3], [26, 16], (60, 2))
    angle = rng.uniform(0, 2 * np.pi, 60)
    by_u = 0.84 * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    by_v = 0.84 * np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
    got = gathered(light, q, by_u, by_v, (0.9, 0.85), 1)
    expected = supersampled(light, q, by_u, by_v, (0.9, 0.85), 1, 40_000)
    # boxes with the parallelogram's second moments: a few per cent of the pixel-to-pixel contrast of 0.29
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.03


@pytest.mark.parametrize(
    ("psf_px", "beyond", "cells", "rel"),
    [(0.0, 0, (37, 23), 1e-12), (0.9, 6, (40, 24), 5e-5)],  # with a lens, cut at 4 sigma, also around it
)
def test_light_is_shared_out_without_loss_or_gain(light, psf_px, beyond, cells, rel):
    """Footprints that tile the panel gather all of its light, whatever the fill."""
    step = np.array([30, 20]) / cells
    u, v = np.meshgrid(*(np.arange(-beyond, count + beyond) for count in cells))
    q = np.stack((u.ravel(), v.ravel()), axis=-1) * step + step / 2 - 0.5
    by_u, by_v = np.tile([step[0], 0.0], (len(q), 1)), np.tile([0.0, step[1]], (len(q), 1))
    got = gathered(light, q, by_u, by_v, (0.7, 0.9), 3, psf_px)
    assert got.sum() * step.prod() == pytest.approx(light.sum(), rel=rel)


def test_full_fill_on_a_pixel_grid_gives_the_pixels_back(light):
    u, v = np.meshgrid(np.arange(30.0), np.arange(20.0))
    q = np.stack((u.ravel(), v.ravel()), axis=-1)
    ones = np.tile([1.0, 0.0], (len(q), 1))
    got = gathered(light, q, ones, ones[:, ::-1].copy(), (1.0, 1.0), 1)
    np.testing.assert_allclose(got, light.ravel(), atol=1e-12)
