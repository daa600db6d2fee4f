"""Image correlation against planted displacements: every texture, sign, size, noise."""

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.passive import Displacement, PointFlag, correlate

from . import planted


def matched(texture, field, noise_grey: float = 0.0, **options) -> Displacement:
    """What is found between a texture's reference and image."""
    return correlate(*planted.pair(texture, field, noise_grey), **options)


def errors(found: Displacement, field) -> np.ndarray:
    """(du, dv) minus the planted one at the valid points, (n, 2)."""
    du, dv = field(found.u, found.v)
    return np.stack([found.du - du, found.dv - dv], axis=-1)[found.valid]


@pytest.mark.parametrize(
    ("texture", "share"), [(planted.speckle(), 0.9), (planted.lattice(), 0.85), (planted.checker(), 0.85)]
)
def test_any_texture_gives_a_planted_bump_below_a_hundredth_of_a_pixel(texture, share):
    field = planted.bump(2.5, 40.0)
    found = matched(texture, field)
    # The border's points, whose pixels may have left the image, are the rest.
    assert found.valid.mean() > share
    # No noise: what is left is what quadratics under the windows do not follow of the bump.
    assert np.sqrt(np.mean(errors(found, field) ** 2)) < 0.01


def test_what_moved_right_and_down_is_positive():
    found = matched(planted.speckle(), lambda u, v: (0 * u + 3.25, 0 * v + 1.75))
    assert np.median(found.du[found.valid]) == pytest.approx(3.25, abs=0.002)
    assert np.median(found.dv[found.valid]) == pytest.approx(1.75, abs=0.002)


def test_points_are_centres_of_squares_on_whole_pixels():
    found = matched(planted.speckle(), planted.lens(0.0), spacing_px=7)
    np.testing.assert_array_equal(found.u[0, :3], [3.0, 10.0, 17.0])
    np.testing.assert_array_equal(found.v[:3, 0], [3.0, 10.0, 17.0])


def test_speckle_is_found_again_tens_of_pixels_away():
    field = planted.bump(3.0, 50.0)

    def far(u, v):
        du, dv = field(u, v)
        return du - 31.3, dv + 17.6

    found = matched(planted.speckle(), far)
    # 31 of 260 columns and 18 of 200 rows have left the image.
    assert found.valid.mean() > 0.7
    assert np.sqrt(np.mean(errors(found, far) ** 2)) < 0.01


@pytest.mark.parametrize("texture", [planted.lattice(), planted.checker()])
def test_a_regular_texture_is_followed_over_more_than_a_period_from_where_it_rests(texture):
    # Half of a period is 8 px (lattice) and 10 px (checker's diagonal); the corners move by 16 px.
    field = planted.lens(0.1)
    found = matched(texture, field)
    length = np.hypot(found.du, found.dv)[found.valid]
    assert length.max() > 11.0
    assert found.valid.mean() > 0.6
    assert np.abs(errors(found, field)).max() < 0.2


def test_the_frame_before_carries_a_regular_texture_over_any_number_of_periods():
    before = None
    texture = planted.lattice()
    for height in (6.0, 12.0, 18.0, 24.0):
        # A bump alone: the rim stays where it is, the middle moves by one and a half periods.
        field = planted.bump(height, 30.0)
        before = matched(texture, field, guess=before)
    middle = before.valid & (np.hypot(before.u - 130, before.v - 100) < 15)
    assert middle.any()
    du, dv = field(before.u, before.v)
    assert np.abs(before.du - du)[middle].max() < 0.1
    assert np.abs(before.dv - dv)[middle].max() < 0.1


def test_brightness_and_contrast_may_change_smoothly():
    field = planted.bump(2.0, 40.0)
    reference, image = planted.pair(planted.speckle(), field)
    ramp = np.linspace(0.8, 1.1, image.shape[1])
    found = correlate(reference, 30.0 + ramp * image)
    inner = np.abs(found.u - 130) < 110
    du, dv = field(found.u, found.v)
    error = np.hypot(found.du - du, found.dv - dv)[found.valid & inner]
    # Contrast is held constant over a cell: 0.6 % of 40 grey remain, like noise of 0.2 grey.
    assert np.sqrt(np.mean(error**2)) < 0.02


def test_a_hole_is_not_valid_and_does_not_harm_its_neighbours():
    field = planted.bump(2.0, 40.0)
    reference, image = planted.pair(planted.speckle(), field, noise_grey=1.0)
    image[80:120, 110:150] = 30.0 + np.random.default_rng(2).normal(size=(40, 40))
    found = correlate(reference, image)
    inside = (np.abs(found.u - 130) < 12) & (np.abs(found.v - 100) < 12)
    assert not found.valid[inside].any()
    assert np.all(found.doubts[inside] & (PointFlag.MISMATCH | PointFlag.TEXTURE))
    assert found.valid.mean() > 0.8
    # Only the few points whose square the rim crosses are off by more than the noise allows.
    assert np.percentile(np.abs(errors(found, field)), 99) < 0.1


def test_an_even_image_and_another_scene_give_nothing():
    reference, image = planted.pair(planted.speckle(), planted.lens(0.0), noise_grey=1.0)
    other, _ = planted.pair(planted.speckle(seed=9), planted.lens(0.0), noise_grey=1.0)
    assert not correlate(reference, np.full_like(image, 90.0)).valid.any()
    assert correlate(reference, other).valid.mean() < 0.02


@pytest.mark.parametrize("noise_grey", [2.0, 6.0])
def test_sigma_is_the_scatter_of_repeated_measurements(noise_grey):
    field = planted.lens(0.004)
    texture = planted.speckle()
    deviations, variances = [], []
    for seed in range(6):
        reference, image = planted.pair(texture, field, noise_grey, seed)
        found = correlate(reference, image)
        inner = found.valid & (np.abs(found.u - 130) < 115) & (np.abs(found.v - 100) < 85)
        du, dv = field(found.u, found.v)
        deviations.append(np.concatenate([(found.du - du)[inner], (found.dv - dv)[inner]]))
        variances.append(np.concatenate([found.sigma_u[inner] ** 2, found.sigma_v[inner] ** 2]))
        # Both images' noise together; 3 % of it goes into the fit itself or is quantised away.
        assert found.noise_grey == pytest.approx(np.sqrt(2.0) * noise_grey, rel=0.05)
    ratio = np.sqrt(np.mean(np.concatenate(deviations) ** 2) / np.mean(np.concatenate(variances)))
    # Six draws of about 30 independent windows each: 4 % scatter, on top of the bar of 0.9 to 1.1.
    assert 0.88 < ratio < 1.15


def test_more_bits_of_the_same_picture_change_nothing():
    reference, image = planted.pair(planted.speckle(), planted.bump(2.0, 40.0), noise_grey=2.0)
    eight = correlate(*(np.clip(np.rint(g), 0, 255).astype(np.uint8) for g in (reference, image)))
    sixteen = correlate(*(np.clip(np.rint(257 * g), 0, 65535).astype(np.uint16) for g in (reference, image)))
    both = eight.valid & sixteen.valid
    # 8-bit rounding adds 0.29 grey to a noise of 2 grey (a seventh of sigma), and may turn a window's choice.
    # Against each point's own sigma: at the border, one that is hardly determined may differ by 0.1 px.
    assert np.sqrt(np.mean(((eight.du - sixteen.du) / eight.sigma_u)[both] ** 2)) < 0.5
    assert np.median(sixteen.sigma[both]) == pytest.approx(np.median(eight.sigma[both]), rel=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"image": np.zeros((50, 60))}, "shape"),
        ({"reference": np.zeros((20, 60)), "image": np.zeros((20, 60))}, "at least"),
        ({"reference": np.zeros((60, 60, 3))}, "shape"),
        ({"image": np.full((60, 60), np.nan)}, "finite"),
        ({"spacing_px": 0}, "spacing"),
        ({"window_px": 1.0}, "window"),
    ],
)
def test_what_cannot_be_compared_is_refused(change, words):
    given = {"reference": np.zeros((60, 60)), "image": np.zeros((60, 60))} | change
    with pytest.raises(InputError, match=words):
        correlate(**given)
