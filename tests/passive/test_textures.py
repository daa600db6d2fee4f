"""Textures that determine little, nothing, or several displacements equally well."""

import cv2
import numpy as np
import pytest

from zeromethod.passive import Doubt, correlate

from . import planted


def dots(pitch_px: float):
    """Bright dots of 1.7 px on a dark ground, in a square grid."""

    def grey(u, v):
        x, y = ((w + 0.5 * pitch_px) % pitch_px - 0.5 * pitch_px for w in (u, v))
        return 30.0 + 170.0 * np.exp(-0.5 * (x**2 + y**2) / 1.7**2)

    return grey


def ramp(u, v):
    return 40.0 + 0.4 * u + 0.3 * v


def grating(u, v):
    return 120.0 + 60.0 * np.cos(0.5 * u + 0.15 * v)


def holed(u, v):
    return np.where(np.hypot(u - 130, v - 100) < 50, 12.0, planted.speckle()(u, v))


def shift(du: float, dv: float):
    return lambda u, v: (0 * u + du, 0 * v + dv)


def seen(texture, field, noise_grey: float = 1.0):
    """(reference, image) in 8 bits."""
    return [np.clip(np.rint(g), 0, 255).astype(np.uint8) for g in planted.pair(texture, field, noise_grey)]


@pytest.mark.parametrize(
    "texture", [dots(24.0), dots(40.0), grating, ramp, planted.lattice(), planted.checker()]
)
def test_a_picture_has_not_moved_against_itself(texture) -> None:
    reference = seen(texture, shift(0.0, 0.0), noise_grey=0.0)[0]
    # Of this size, the coarsest level has a size that OpenCV transforms in place.
    reference = cv2.resize(reference, (320, 240))
    found = correlate(reference, reference)
    assert np.abs(found.field[found.valid]).max(initial=0.0) < 0.001


@pytest.mark.parametrize("texture", [grating, ramp, lambda u, v: 120.0 + 0.0 * u])
def test_what_determines_nothing_along_one_direction_is_not_valid(texture) -> None:
    # The noise of two pictures has gradients, too, but they do not move with the picture.
    found = correlate(*seen(texture, shift(1.3, 0.6)))
    assert found.valid.mean() < 0.02


def test_a_regular_texture_that_moved_as_a_whole_is_doubtful() -> None:
    for texture, moved in ((planted.lattice(), 13.0), (planted.lattice(), 3.0), (dots(24.0), 22.0)):
        found = correlate(*seen(texture, shift(moved, 1.0)))
        assert not found.valid.any()
        assert np.mean((found.doubts & Doubt.ORDER) > 0) > 0.5


def test_a_mark_in_a_regular_texture_tells_by_how_many_periods_it_moved() -> None:
    def marked(u, v):
        near = np.hypot(u - 130, v - 100) < 60
        return np.where(near, planted.speckle()(u, v), planted.lattice()(u, v))

    found = correlate(*seen(marked, shift(3.0, 1.0)))
    assert found.valid.mean() > 0.7
    assert np.percentile(np.abs(found.du - 3.0)[found.valid], 99) < 0.1


def test_the_middle_of_a_dark_hole_is_not_valid() -> None:
    for noise in (0.0, 1.0):
        found = correlate(*seen(holed, shift(2.3, 1.1), noise))
        inside = np.hypot(found.u - 131, found.v - 100) < 30
        assert not found.valid[inside].any()
        assert found.valid.mean() > 0.6
