"""Falloff of light over the view: planted shading comes back; what does not see the LCD does not count."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.calibration.falloff import lit_pixels, measure_falloff, tile_means
from zeromethod.errors import MeasurementError

SHAPE = (90, 120)
SIGMA = 1.5


def shading(corner: float) -> NDArray[np.float64]:
    """cos^4 law with `corner` of the middle's light in the corners."""
    v, u = np.meshgrid(np.linspace(-1, 1, SHAPE[0]), np.linspace(-1, 1, SHAPE[1]), indexing="ij")
    return np.asarray((1 + (corner**-0.5 - 1) * (u**2 + v**2) / 2) ** -2.0)


def pictures(light: NDArray[np.float64], seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    noise = SIGMA / np.sqrt(2) * rng.standard_normal((2, *SHAPE))
    return 6 + 180 * light + noise[0], 6 + noise[1]


def test_planted_shading_comes_back_per_region():
    light = shading(0.5)
    lit = np.ones(SHAPE, dtype=np.bool_)
    found = measure_falloff(*pictures(light, 0), lit)
    # noise of 1.5 in 180 grey levels over 660 px: 16 normal numbers, five sigma
    assert np.abs(found.light * light.mean() - tile_means(light, lit)).max() < 5 * SIGMA / 180 / np.sqrt(660)
    assert found.darkest == pytest.approx(
        np.min(tile_means(light, lit)) / np.max(tile_means(light, lit)), abs=0.01
    )
    # fourth order leaves 2 % at the corners of a cos^4 of this depth
    assert np.max(np.abs(found.smooth - light / light.mean())) < 0.025
    assert np.sqrt(np.mean((found.smooth - light / light.mean()) ** 2)) < 0.005
    assert found.weak_tile is None


def test_a_region_in_the_dark_is_named():
    white, black = pictures(shading(0.08), 0)
    found = measure_falloff(white, black, np.ones(SHAPE, dtype=np.bool_))
    assert found.darkest < 0.3
    assert found.weak_tile is not None
    assert set(found.weak_tile) <= {0, 3}


def test_only_pixels_that_follow_the_lcd_are_lit():
    mirror = np.zeros(SHAPE)
    mirror[20:70, 30:100] = 1
    lit = lit_pixels(*pictures(mirror, 1))
    assert np.array_equal(lit, mirror > 0)
    tiles = measure_falloff(*pictures(mirror, 1), lit).light
    assert np.isnan(tiles[0, 0])
    assert np.nanmax(np.abs(tiles - 1)) < 0.01


def test_nothing_lit_is_refused():
    white, black = pictures(np.zeros(SHAPE), 2)
    with pytest.raises(MeasurementError, match=r"^falloff"):
        measure_falloff(white, black, np.zeros(SHAPE, dtype=np.bool_))
