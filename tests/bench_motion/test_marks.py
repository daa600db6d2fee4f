"""Places of printed marks: right to a hundredth of a pixel, not feigned by what covers them."""

import numpy as np
import pytest
from scipy.special import erf

from zeromethod.arrays import Image
from zeromethod.bench_motion.mark import MOST_SIGMA_PX, Mark
from zeromethod.bench_motion.marks import MarkWatch
from zeromethod.bench_motion.watch import FRAMES, LEAST_LCD_PX

NOISE_GREY = 2.0
PLACE = (60, 71)
CAMERA_PX = 1.75
LEAST_PX = LEAST_LCD_PX * CAMERA_PX


class Printed:
    """A cross, blurred as by the packaged lens, in front of a camera with noise."""

    def __init__(self, seed: int, psf_px: float = 0.7, contrast_grey: float = 100.0) -> None:
        self.noise = np.random.default_rng(seed)
        self.psf_px, self.contrast_grey = psf_px, contrast_grey

    def image(
        self, u_px: float = 0.0, v_px: float = 0.0, covered_from: int = 200, grey: float = 60.0
    ) -> Image:
        at = np.arange(160.0)

        def bar(centre: float, half: float) -> np.ndarray:
            low, high = ((at - centre + side) / (self.psf_px * np.sqrt(2.0)) for side in (-half, half))
            return np.asarray(0.5 * (erf(high) - erf(low)))

        u, v = PLACE[0] + 0.3 + u_px, PLACE[1] - 0.2 + v_px
        one, other = np.outer(bar(v, 2.0), bar(u, 9.0)), np.outer(bar(v, 9.0), bar(u, 2.0))
        light = 20.0 + self.contrast_grey * (one + other - one * other)
        light[:, covered_from:] = grey
        light += NOISE_GREY * self.noise.standard_normal(light.shape)
        return np.asarray(np.rint(np.clip(light, 0.0, 255.0)), np.uint8)

    def mark(self) -> Mark:
        return Mark(*PLACE, np.stack([Mark.window(self.image(), *PLACE) for _ in range(FRAMES)]))


def resting(printed: Printed) -> MarkWatch:
    watch = MarkWatch((PLACE,), CAMERA_PX)
    for _ in range(2 * FRAMES):
        assert watch.look(printed.image(), True) == ""
    return watch


@pytest.mark.parametrize("psf_px", [0.7, 1.5])
def test_shifts_below_a_pixel_are_unbiased_and_their_noise_is_known(psf_px):
    printed = Printed(0, psf_px)
    mark, still = printed.mark(), Printed(1, psf_px)
    zero = np.mean([mark.see(still.image()).shift_px for _ in range(60)], axis=0)  # type: ignore[union-attr]
    # the mean of eight frames is the reference, and has its noise
    assert np.abs(zero).max() < 4.0 * mark.sigma_px / np.sqrt(FRAMES)
    for by_px in np.linspace(-0.9, 0.9, 7):
        seen = [mark.see(still.image(by_px, -0.6 * by_px)) for _ in range(40)]
        shifts = np.array([one.shift_px for one in seen if one is not None])
        assert len(shifts) == 40
        assert np.abs(shifts.mean(axis=0) - zero - (by_px, -0.6 * by_px)).max() < 0.01
        # scatter of 80 values of noise is known to 8 %; three times that, and what the fit leaves out
        assert np.sqrt(np.mean(np.var(shifts, axis=0, ddof=1))) == pytest.approx(mark.sigma_px, rel=0.4)


@pytest.mark.parametrize("by_px", [0.15, 0.5, 3.0, 12.0])
def test_a_mark_that_moved_is_named_within_ten_frames_by_how_much(by_px):
    printed = Printed(2)
    watch = resting(printed)
    for _ in range(10):
        watch.look(printed.image(by_px), False)
    said_px = float(watch.moved.removeprefix("camera against prism moved by ").removesuffix(" px (marks)"))
    assert said_px == pytest.approx(by_px, abs=0.05 * by_px + 0.02)
    watch.forget()
    assert watch.moved == ""


def test_less_than_the_least_is_no_motion_and_a_single_frame_neither():
    printed = Printed(3)
    watch = resting(printed)
    for frame in range(60):
        watch.look(printed.image(1.0 if frame == 30 else 0.5 * LEAST_PX), True)
    assert watch.moved == ""


@pytest.mark.parametrize("grey", [0.0, 60.0, 200.0])
@pytest.mark.parametrize("px_per_frame", [0.5, 3.0])
def test_what_slides_over_a_mark_and_stays_or_goes_is_no_motion(grey, px_per_frame):
    printed = Printed(4)
    watch = resting(printed)
    way = np.arange(90, 40, -px_per_frame)
    for column in (*way, *[64.0] * FRAMES, *way[::-1]):
        watch.look(printed.image(covered_from=int(column), grey=grey), True)
    assert watch.moved == ""
    for _ in range(10):
        watch.look(printed.image(1.0), True)
    assert watch.moved


def test_two_marks_that_part_are_said_to():
    printed = Printed(5)
    watch = MarkWatch((PLACE, PLACE), CAMERA_PX)
    for _ in range(2 * FRAMES):
        watch.look(printed.image(), True)
    first, second = watch._marks
    assert first is not None
    assert second is not None
    for _ in range(FRAMES):
        images = printed.image(0.5), printed.image(-0.5)
        for mark, seen, image in zip((first, second), watch._seen, images, strict=True):
            seen.append(mark.see(image))  # type: ignore[arg-type]
    watch._judge()
    assert watch.moved.endswith("not all alike: rolled, or nearer or farther")


def test_a_place_with_too_little_contrast_is_not_watched_and_said_once():
    watch = MarkWatch((PLACE,), CAMERA_PX)
    blank = Printed(6, contrast_grey=0.0)
    said = [watch.look(blank.image(), True) for _ in range(4 * FRAMES)]
    assert [words for words in said if words] == ["not watched, too little contrast: the mark at (60, 71) px"]
    assert Printed(7).mark().sigma_px < 0.1 * MOST_SIGMA_PX
