"""Textures that determine little, nothing, or several displacements equally well."""

import cv2
import numpy as np
import pytest

from zeromethod.passive import PointFlag, correlate

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
def test_a_picture_has_not_moved_against_itself(texture):
    reference = seen(texture, shift(0.0, 0.0), noise_grey=0.0)[0]
    # Of this size, the coarsest level has a size that OpenCV transforms in place.
    reference = cv2.resize(reference, (320, 240))
    found = correlate(reference, reference)
    assert np.abs(found.field[found.valid]).max(initial=0.0) < 0.001


@pytest.mark.parametrize("texture", [grating, ramp, lambda u, v: 120.0 + 0.0 * u])
def test_what_determines_nothing_along_one_direction_is_not_valid(texture):
    # The noise of two pictures has gradients, too, but they do not move with the picture.
    found = correlate(*seen(texture, shift(1.3, 0.6)))
    assert found.valid.mean() < 0.02


def test_a_regular_texture_that_moved_as_a_whole_is_doubtful():
    for texture, moved in ((planted.lattice(), 13.0), (planted.lattice(), 3.0), (dots(24.0), 22.0)):
        found = correlate(*seen(texture, shift(moved, 1.0)))
        assert not found.valid.any()
        assert np.mean((found.doubts & PointFlag.ORDER) > 0) > 0.5


@pytest.mark.parametrize(("texture", "period_px"), [(planted.lattice(), 16.0), (dots(24.0), 24.0)])
def test_the_largest_shift_says_by_how_many_periods_a_regular_texture_moved(texture, period_px):
    images = seen(texture, shift(3.0, 1.0))
    found = correlate(*images, largest_shift_px=0.45 * period_px)
    assert found.valid.mean() > 0.75
    # Between dots and at the border sigma reaches 0.25 px; another order would be off by the period.
    assert np.abs(found.du - 3.0)[found.valid].max() < 0.75
    # Two of the matches are nearer than this.
    assert not correlate(*images, largest_shift_px=1.2 * period_px).valid.any()
    # And all of them farther than this.
    assert correlate(*images, largest_shift_px=1.0).valid.mean() < 0.01


@pytest.mark.parametrize("moved", [0.0, 0.3])
def test_a_regular_texture_near_rest_is_read_as_such(moved):
    # Nearer to rest than 3 % of the square root of the period's area: 0.47 and 0.70 px.
    for texture in (planted.lattice(), dots(24.0)):
        found = correlate(*seen(texture, shift(moved, 0.0)))
        assert found.valid.mean() > 0.75
        # 0.3 % by chance; one of about 40 independent windows more.
        assert np.mean(np.abs(found.du - moved)[found.valid] > 3.0 * found.sigma_u[found.valid]) < 0.03


@pytest.mark.parametrize("pitch_px", [24.0, 40.0])
def test_sigma_holds_for_few_dots(pitch_px):
    pulls = []
    for seed in range(3):
        images = planted.pair(dots(pitch_px), shift(0.2, 0.1), 2.0, seed)
        found = correlate(*(np.clip(np.rint(g), 0, 255).astype(np.uint8) for g in images))
        assert found.valid.mean() > 0.3
        pulls.append(((found.du - 0.2) / found.sigma_u)[found.valid])
    # The bar of 0.9 to 1.1, and the scatter of 3 draws of about 8 independent windows each (15 %).
    assert 0.75 < np.sqrt(np.mean(np.concatenate(pulls) ** 2)) < 1.3


def test_few_dots_have_few_points_beyond_three_sigma():
    wrong, valid, sigma = 0, 0, []
    for seed in range(4):
        images = planted.pair(dots(40.0), shift(0.4, 0.2), 1.0, seed)
        found = correlate(*(np.clip(np.rint(g), 0, 255).astype(np.uint8) for g in images))
        pull = np.maximum(np.abs(found.du - 0.4) / found.sigma_u, np.abs(found.dv - 0.2) / found.sigma_v)
        wrong += np.count_nonzero(found.valid & (pull > 3.0))
        valid += np.count_nonzero(found.valid)
        sigma.append(np.median(found.sigma[found.valid]))
    # 0.5 % by chance; with the noise between the dots taken for texture it was 6 %.
    assert wrong < 0.02 * valid
    # Not by a large sigma.
    assert np.median(sigma) < 0.05


@pytest.mark.parametrize("texture", [planted.speckle(), dots(24.0)])
@pytest.mark.parametrize("moved", [0.1, 0.4, 1.3])
def test_a_frame_that_stands_still_does_not_pull_valid_points_towards_rest(texture, moved):
    inside = (slice(45, 155), slice(50, 210))
    images = seen(texture, shift(moved, 0.0))
    framed = [np.full_like(image, 10) for image in images]
    for image, frame in zip(images, framed, strict=True):
        frame[inside] = image[inside]
    found = correlate(*framed, largest_shift_px=10.0)
    wrong = found.valid & (np.abs(found.du - moved) > 3.0 * found.sigma_u)
    assert found.valid.mean() > 0.2
    # 0.3 % by chance, a few of about 50 independent windows at most; dots that moved by 0.4 px have 4 % with
    # the frame's edges in the fit.
    assert wrong.sum() < 0.03 * found.valid.sum()


def test_a_mark_in_a_regular_texture_says_by_how_many_periods_it_moved():
    def marked(u, v):
        near = np.hypot(u - 130, v - 100) < 60
        return np.where(near, planted.speckle()(u, v), planted.lattice()(u, v))

    found = correlate(*seen(marked, shift(3.0, 1.0)))
    assert found.valid.mean() > 0.7
    assert np.percentile(np.abs(found.du - 3.0)[found.valid], 99) < 0.1


def test_the_middle_of_a_dark_hole_is_not_valid():
    for noise in (0.0, 1.0):
        found = correlate(*seen(holed, shift(2.3, 1.1), noise))
        inside = np.hypot(found.u - 131, found.v - 100) < 30
        assert not found.valid[inside].any()
        assert found.valid.mean() > 0.6
