"""Aperture integrals against brute-force supersampling."""

import numpy as np
import pytest

from zeromethod.simulation.aperture import gather, summed_light


def gathered(light, q, by_u, by_v, fill, stripes) -> np.ndarray:
    out = np.zeros((1, len(q)))
    gain = np.ones((1, len(q)))
    gather(summed_light(light), q[None], by_u[None], by_v[None], gain, fill, stripes, out)
    return out[0]


def supersampled(light, q, by_u, by_v, fill, stripes, count: int) -> np.ndarray:
    """Mean over count x count points of each parallelogram of lit / (fill x fill)."""
    at = (np.arange(count) + 0.5) / count - 0.5
    s, t = np.meshgrid(at, at)
    point = q[:, None, None] + s[..., None] * by_u[:, None, None] + t[..., None] * by_v[:, None, None]
    pixel = np.floor(point + 0.5).astype(int)
    inner = point + 0.5 - pixel
    lit_x = np.abs((inner[..., 0] * stripes) % 1.0 - 0.5) < fill[0] / 2
    lit_y = np.abs(inner[..., 1] - 0.5) < fill[1] / 2
    rows, cols = light.shape
    on = (pixel >= 0).all(-1) & (pixel[..., 0] < cols) & (pixel[..., 1] < rows)
    value = light[np.clip(pixel[..., 1], 0, rows - 1), np.clip(pixel[..., 0], 0, cols - 1)]
    return (value * lit_x * lit_y * on).mean((1, 2)) / (fill[0] * fill[1])


@pytest.fixture
def light() -> np.ndarray:
    return np.random.default_rng(0).uniform(size=(20, 30))


@pytest.mark.parametrize("stripes", [1, 3])
@pytest.mark.parametrize("turned", [False, True])
def test_footprints_along_the_axes_are_exact(light, stripes: int, turned: bool) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform([-1, -1], [30, 20], (60, 2))  # some reach beyond the panel
    zero = np.zeros(60)
    by_u = np.stack((rng.uniform(0.3, 3.5, 60), zero), axis=-1)
    by_v = np.stack((zero, rng.uniform(-3.5, -0.3, 60)), axis=-1)
    if turned:
        by_u, by_v = by_v, by_u
    got = gathered(light, q, by_u, by_v, (0.8, 0.6), stripes)
    expected = supersampled(light, q, by_u, by_v, (0.8, 0.6), stripes, 250)
    # a 250-point rule misplaces each aperture edge by at most 1/500 of the footprint; 1/fill^2 = 2
    np.testing.assert_allclose(got, expected, atol=0.02)
    assert np.abs(got - expected).mean() < 3e-3


def test_turned_footprints_are_close(light) -> None:
    rng = np.random.default_rng(2)
    q = rng.uniform([3, 3], [26, 16], (60, 2))
    angle = rng.uniform(0, 2 * np.pi, 60)
    by_u = 0.84 * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    by_v = 0.84 * np.stack((-np.sin(angle), np.cos(angle)), axis=-1)
    got = gathered(light, q, by_u, by_v, (0.9, 0.85), 1)
    expected = supersampled(light, q, by_u, by_v, (0.9, 0.85), 1, 200)
    # boxes with the parallelogram's second moments: a few per cent of the pixel-to-pixel contrast of 0.29
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.03


def test_light_is_shared_out_without_loss_or_gain(light) -> None:
    """Footprints that tile the panel gather all of its light, whatever the fill."""
    step = np.array([30 / 37, 20 / 23])
    u, v = np.meshgrid(np.arange(37), np.arange(23))
    q = np.stack((u.ravel(), v.ravel()), axis=-1) * step + step / 2 - 0.5
    by_u = np.tile([step[0], 0.0], (len(q), 1))
    by_v = np.tile([0.0, step[1]], (len(q), 1))
    got = gathered(light, q, by_u, by_v, (0.7, 0.9), 3)
    assert got.sum() * step.prod() == pytest.approx(light.sum(), rel=1e-12)


def test_full_fill_on_a_pixel_grid_gives_the_pixels_back(light) -> None:
    u, v = np.meshgrid(np.arange(30.0), np.arange(20.0))
    q = np.stack((u.ravel(), v.ravel()), axis=-1)
    ones = np.tile([1.0, 0.0], (len(q), 1))
    got = gathered(light, q, ones, ones[:, ::-1].copy(), (1.0, 1.0), 1)
    np.testing.assert_allclose(got, light.ravel(), atol=1e-12)
