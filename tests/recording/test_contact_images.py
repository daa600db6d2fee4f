"""Images of contacts in tiles and back."""

import numpy as np
import pytest

from zeromethod.contact import ContactImage
from zeromethod.recording.columns import CONTACT_IMAGES, row_dtype
from zeromethod.recording.contact_images import MOST_TILES, TILE_PX, images, tiles


class WithImage:
    def __init__(self, number, light, mm_per_px=0.03):
        self.id = number
        self.image = None if light is None else ContactImage(light, mm_per_px, 40.0, -2.0)


def table(*contacts):
    rows = [{"step": 7, **tile} for contact in contacts for tile in tiles(contact)]
    found = np.zeros(len(rows), row_dtype(CONTACT_IMAGES))
    for row, values in zip(found, rows, strict=True):
        for name, value in values.items():
            row[name] = value
    return found


def test_images_come_back_to_half_precision_with_their_places():
    draw = np.random.default_rng(0)
    one, two = draw.uniform(0, 2, (150, 90)).astype(np.float32), np.full((20, 30), 0.26, np.float32)
    one[:5] = np.nan
    back = images(table(WithImage(3, one), WithImage(4, two), WithImage(5, None)))
    assert set(back) == {3, 4}
    assert back[3].light == pytest.approx(one, rel=2**-11, nan_ok=True)
    assert back[4].light == pytest.approx(two, rel=2**-11)
    assert (back[3].mm_per_px, back[3].x_mm, back[3].y_mm) == (0.03, 40.0, -2.0)


def test_a_large_image_is_kept_coarser_in_its_place():
    rows, cols = 900, 1000
    x, y = 40.0 + 0.03 * np.arange(cols), -2.0 + 0.03 * np.arange(rows)
    light = (1 + 0.01 * (x[None, :] - 40) + 0.02 * (y[:, None] + 2)).astype(np.float32)
    kept = table(WithImage(1, light))
    assert len(kept) <= MOST_TILES
    back = images(kept)[1]
    assert max(back.light.shape) <= 4 * TILE_PX
    at_x = back.x_mm + back.mm_per_px * np.arange(back.light.shape[1])
    at_y = back.y_mm + back.mm_per_px * np.arange(back.light.shape[0])
    # means of a plane are those of its middle
    expected = 1 + 0.01 * (at_x[None, :] - 40) + 0.02 * (at_y[:, None] + 2)
    assert back.light == pytest.approx(expected, rel=2**-10)


def test_what_is_missing_of_an_image_is_not_a_number():
    light = np.ones((100, 100), np.float32)
    back = images(table(WithImage(1, light))[1:])[1].light
    assert np.isnan(back[:64, :64]).all()
    assert (back[64:] == 1).all()
