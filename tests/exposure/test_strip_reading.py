"""Reading coded strips: what they say, and when nothing is read."""

import numpy as np
import pytest
from coded_frames import BLACK, SHAPE, STRIPS, WHITE, noisy, picture, reader

from zeromethod.pattern.strips import CODES, bits_of

READER = reader()


def _bits(code: int) -> np.ndarray:
    return np.array(bits_of(code), dtype=float)


def _mixed(older: int, newer: int, weight: float) -> np.ndarray:
    return (1 - weight) * _bits(older) + weight * _bits(newer)


def test_every_code_is_read():
    for code in range(CODES):
        other = (code + 3) % CODES
        found = READER.read(noisy(picture(_bits(code), _bits(other)), code))
        assert [reading.code for reading in found] == [code, other]


@pytest.mark.parametrize("weight", [0.1, 0.25, 0.5, 0.9])
def test_grey_bit_and_check_give_the_weight_of_the_newer_picture(weight):
    first, last = READER.read(noisy(picture(_mixed(6, 7, weight), _bits(7))))
    # 2 grey of noise on 186 of swing, over some 80 px a cell: 0.001; four times that, and a grey's rounding
    np.testing.assert_allclose(first.levels, _mixed(6, 7, weight), atol=0.006)
    assert first.code is None
    assert last.code == 7


def test_brightness_along_the_strip_and_stray_light_do_not_matter():
    gradient = np.linspace(0.5, 1.1, SHAPE[1])
    first, _ = READER.read(noisy(4 + gradient * (picture(_mixed(2, 3, 0.3), _bits(3)) - 4) + 15))
    # the light is linear along the strip, 2.4 % of it per cell; what stray light adds to a contrast that is
    # taken as one for all bits differs by a tenth from end to end
    np.testing.assert_allclose(first.levels, _mixed(2, 3, 0.3), atol=0.05)


def test_displacement_along_the_strip_by_a_fifth_of_a_cell_does_not_matter():
    moved = np.roll(picture(_bits(9), _bits(9)), round(STRIPS.first.unit_px / 5), axis=1)
    assert [reading.code for reading in READER.read(noisy(moved))] == [9, 9]


def test_target_pulled_into_a_strip_makes_it_unread_and_leaves_the_other():
    grey = picture(_bits(4), _bits(4))
    grey[:16] = np.roll(grey, -10, axis=0)[:16]
    found = READER.read(noisy(grey))
    assert len(found) == 1
    assert found[0].panel_rows is STRIPS.last.panel_rows


def test_clipped_faint_and_dark_strips_are_not_read():
    grey = picture(_bits(4), _bits(4))
    assert len(READER.read(noisy(grey))) == 2
    assert READER.read(noisy(grey * 1.4)) == ()
    assert READER.read(noisy(4 + (grey - 4) * 0.02)) == ()
    assert READER.read(noisy(BLACK + 0 * grey)) == ()
    # stray light of five times the pattern's swing
    assert READER.read(noisy(grey * 0.15 + 150)) == ()


def test_sixteen_bit_frames_are_read_alike():
    grey = np.rint(picture(_mixed(12, 13, 0.4), _bits(13)) * 16).astype(np.uint16)
    found = reader(12).read(grey)
    # black is taken as 4 of 4095 and not 64: that only lowers the contrast, which is measured
    np.testing.assert_allclose(found[0].levels, _mixed(12, 13, 0.4), atol=0.006)
    assert WHITE * 16 < 4095
