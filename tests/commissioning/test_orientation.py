"""Plain pictures: how the LCD lies, from images that are its pictures themselves, turned over and moved."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.commissioning.orientation import Orientation, PlainPictures
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest import Rest

SIZE = 256
BLACK, FULL = 4.0, 255.0
Image = NDArray[Any]


@pytest.fixture(scope="module")
def plain() -> PlainPictures:
    """A view of 256 x 256 px of an LCD of 400 x 400, pixel for pixel, 72 px from its corner."""
    grid = NodeGrid((SIZE, SIZE), 16)
    return PlainPictures(Rest.from_map(grid, np.stack(grid.mesh(), axis=-1) + 72, (400, 400)))


def judged(
    plain: PlainPictures,
    see: Callable[[Image], Image] = lambda lcd: lcd,
    light: float = 0.6,
    stray: float = 0.0,
) -> Orientation:
    """What is made of the LCD seen as `see` turns its pictures, cut to the view."""
    noise = np.random.default_rng(2)
    images = []
    for picture in plain.pictures:
        seen = see(picture)[72 : 72 + SIZE, 72 : 72 + SIZE]
        grey = BLACK + stray + light * seen + 2 * noise.standard_normal(seen.shape)
        images.append(np.clip(np.rint(grey), 0, FULL).astype(np.uint8))
    return plain.judge(images, BLACK, FULL)


def test_pictures_light_the_right_and_lower_half_and_the_middle_of_the_view(plain):
    black, white, right, lower, width, height = plain.pictures
    assert (black.min(), black.max(), white.min(), white.max()) == (0, 0, 255, 255)
    assert not right[:, :199].any()
    assert right[:, 201:].all()
    assert not lower[:199].any()
    assert lower[201:].all()
    # the measurable view is 224 px wide: 16 to 240
    for picture in (width, height.T):
        assert picture[:, 200 - 55 : 200 + 55].all()
        assert not picture[:, : 200 - 57].any()
        assert not picture[:, 200 + 57 :].any()


def test_stray_light_is_what_stays_when_the_lcd_is_black(plain):
    seen = judged(plain, light=0.5, stray=30.0)
    assert seen.stray_grey == pytest.approx(30, abs=0.1)
    assert seen.stray_share == pytest.approx(30 / (0.5 * 255), abs=0.002)


def test_an_lcd_seen_in_a_corner_only_is_not_placed(plain):
    corner = np.zeros((400, 400))
    corner[72:152, 72:152] = 1
    seen = judged(plain, lambda lcd: (lcd * corner).astype(np.uint8))
    assert seen.seen_share == pytest.approx(80 * 80 / SIZE**2, abs=0.01)
    assert seen.place is None
