"""A response that differs over the panel: planted exponents come back, and what is even stays even."""

import numpy as np
import pytest

from zeromethod.calibration.response import RAMP_CODES, MeasuredResponse, measure_response
from zeromethod.calibration.viewing_angle import at_places, exponent_of, panel_exponents, spread_left

SIZE = (1920, 1080)
SHARE = np.array(RAMP_CODES) / 255.0
GAMMA, SWING, DARK, NOISE = 2.2, 180.0, 5.0, 0.1
TILES = (4, 5)


def places() -> np.ndarray:
    """The view: 60 % of the panel, off its middle."""
    row, column = np.meshgrid(
        np.linspace(300, 950, TILES[0]), np.linspace(500, 1650, TILES[1]), indexing="ij"
    )
    return np.stack([column, row], axis=-1)


def planted(slope_x: float, slope_y: float, seed: int = 0) -> MeasuredResponse:
    """Two passes of tiles whose exponent changes over the panel by these, from its middle to its border."""
    x, y = places()[..., 0] / 959.5 - 1, places()[..., 1] / 539.5 - 1
    exponent = GAMMA * (1 + slope_x * x + slope_y * y)
    light = SHARE[:, None, None] ** exponent
    rng = np.random.default_rng(seed)
    grey = DARK + SWING * light + NOISE * rng.standard_normal((2, *light.shape))
    times_s = 0.25 * np.arange(2 * len(SHARE), dtype=float).reshape(2, -1)
    return measure_response(RAMP_CODES, grey, times_s)


@pytest.mark.parametrize("slopes", [(0.15, 0.0), (-0.05, 0.1), (0.1, -0.2)])
def test_planted_exponents_come_back(slopes):
    found = planted(*slopes)
    corners = panel_exponents(found, places(), SIZE)
    # the whole's curve belongs to the mean exponent of the view, to which all are relative
    x, y = places()[..., 0] / 959.5 - 1, places()[..., 1] / 539.5 - 1
    mean = 1 + slopes[0] * x.mean() + slopes[1] * y.mean()
    for row, at_y in enumerate((-1, 1)):
        for column, at_x in enumerate((-1, 1)):
            wanted = (1 + slopes[0] * at_x + slopes[1] * at_y) / mean
            # a mean of powers is no power: that is 1 % here; the corners lie outside of the view
            assert corners[row][column] == pytest.approx(wanted, abs=0.03)


def test_within_the_view_the_light_comes_out_even():
    slopes = (0.1, -0.15)
    found = planted(*slopes)
    corners = np.array(panel_exponents(found, places(), SIZE))
    x, y = places()[..., 0] / 959.5 - 1, places()[..., 1] / 539.5 - 1
    p = 0.25 * (
        (1 - x) * (1 - y) * corners[0, 0]
        + (1 + x) * (1 - y) * corners[0, 1]
        + (1 - x) * (1 + y) * corners[1, 0]
        + (1 + x) * (1 + y) * corners[1, 1]
    )
    true = SHARE[:, None, None] ** (GAMMA * (1 + slopes[0] * x + slopes[1] * y))
    by_one_curve = np.abs(true - found.whole.light[:, None, None]).max()
    by_place = np.abs(true - found.whole.light[:, None, None] ** p).max()
    assert by_one_curve > 0.03
    # what is left is that a mean of powers is no power
    assert by_place < 0.1 * by_one_curve


def test_what_the_drawing_cannot_mend_is_left():
    found = planted(0.2, 0.0)
    assert spread_left(found, None) > 0.02
    corners = panel_exponents(found, places(), SIZE)
    assert corners is not None
    assert spread_left(found, at_places(corners, places(), SIZE)) == 0
    assert spread_left(planted(0.0, 0.0), None) == 0


@pytest.mark.parametrize("seed", range(10))
def test_an_even_panel_is_left_alone(seed):
    assert panel_exponents(planted(0.0, 0.0, seed), places(), SIZE) is None


def test_tiles_of_unknown_place_and_too_few_tiles_give_nothing():
    found, at = planted(0.2, 0.0), places()
    at[:, 1:] = np.nan
    assert panel_exponents(found, at, SIZE) is None


def test_sigma_of_an_exponent_holds():
    z = []
    for seed in range(20):
        found = planted(0.0, 0.0, seed)
        pairs = [exponent_of(curve, found.whole) for curve in found.tiles.ravel()]
        z += [(p - 1) / sigma for p, sigma in pairs]
    # the tiles' sigma is judged from two passes each, to some 20 %
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.3
