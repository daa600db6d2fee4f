"""Figures of one frame against what was drawn into it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.commissioning.focus import FocusMeter
from zeromethod.errors import InputError

from .setting_up_benches import RIG

PERIOD_PX = 16
BLACK, FULL = 4.0, 255.0
SIGMA_GREY = 2.0


@pytest.fixture(scope="module")
def meter() -> FocusMeter:
    return FocusMeter(RIG)


def seen(
    blur_px: float = 0.0,
    peak: float = 196.0,
    stray: float = 0.0,
    scale: tuple[float, float] = (1.0, 1.0),
    turn_deg: float = 0.0,
    shift_px: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.uint8]:
    """The rig's target through a lens of that blur, with the camera's noise: white is `peak` above black.

    scale, turn_deg, shift_px: of the picture about the view's middle.
    """
    rows, columns = RIG.camera.rows, RIG.camera.columns
    v, u = np.mgrid[:rows, :columns].astype(float)
    middle = (columns - 1) / 2, (rows - 1) / 2
    angle = np.deg2rad(turn_deg)
    x, y = u - middle[0] - shift_px[0], v - middle[1] - shift_px[1]
    x, y = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
    u, v = x / scale[0] + middle[0], y / scale[1] + middle[1]
    transfer = np.exp(-2 * (np.pi * blur_px / PERIOD_PX) ** 2)
    wave = 2 * np.pi / PERIOD_PX
    light = 0.5 * (1 + 0.45 * transfer * (np.cos(wave * u) + np.cos(wave * v)))
    noise = SIGMA_GREY * np.random.default_rng(5).standard_normal(light.shape)
    return np.clip(np.rint(BLACK + stray + peak * light + noise), 0, FULL).astype(np.uint8)


@pytest.mark.parametrize("blur_px", [0.0, 1.0, 2.0, 3.5])
def test_score_and_blur_are_those_of_the_lens(meter, blur_px):
    report = meter.look(seen(blur_px))
    # noise of a node's modulation: 2 grey levels over 45 and some hundred pixels; the median of 100 nodes
    assert report.score == pytest.approx(np.exp(-2 * (np.pi * blur_px / PERIOD_PX) ** 2), abs=0.01)
    assert report.blur_px == pytest.approx(blur_px, abs=0.3 if blur_px == 0 else 0.06)
    assert report.modulation == pytest.approx(np.full((3, 3), report.score), abs=0.02)


@pytest.mark.parametrize(
    ("scale", "shift_px"), [((1.0, 1.0), (7.0, 5.0)), ((1.06, 0.95), (0.0, 0.0)), ((0.92, 1.09), (71.0, 3.0))]
)
def test_focus_is_judged_wherever_the_picture_lies_and_whatever_its_size(meter, scale, shift_px):
    report = meter.look(seen(1.0, scale=scale, shift_px=shift_px))
    # of another size the picture spans parts of periods: 0.03 at a tenth more
    assert report.score == pytest.approx(np.exp(-2 * (np.pi / PERIOD_PX) ** 2), abs=0.03)


def test_focus_is_given_region_by_region(meter):
    image = seen(0.0)
    image[:, 110:] = seen(3.0)[:, 110:]
    report = meter.look(image)
    assert report.modulation[:, 0] == pytest.approx(1.0, abs=0.02)
    assert report.modulation[:, 2] == pytest.approx(np.exp(-2 * (np.pi * 3 / PERIOD_PX) ** 2), abs=0.06)


def test_stray_light_lowers_the_score_unless_it_is_known(meter):
    image = seen(stray=40.0)
    assert meter.look(image).score == pytest.approx(98 / 138, abs=0.01)
    assert meter.look(image, stray_grey=40.0).score == pytest.approx(1.0, abs=0.01)


def test_greys_are_those_of_the_image(meter):
    image = seen()
    report = meter.look(image)
    assert report.mean_grey == pytest.approx(image.mean())
    assert report.full_grey == FULL
    assert report.bright_grey == pytest.approx(np.percentile(image, 99), abs=3)
    assert report.histogram.sum() == pytest.approx(1)
    assert report.histogram == pytest.approx(np.bincount(image.ravel() // 8, minlength=32) / image.size)
    assert (report.saturated_share, report.dark_share, report.usable_share, report.seen_share) == (0, 0, 1, 1)


def test_saturated_and_dark_parts_are_not_usable(meter):
    bright = seen(peak=320.0)
    report = meter.look(bright)
    assert report.saturated_share == pytest.approx(np.mean(bright == 255))
    assert report.usable_share < 0.1
    hidden = seen()
    hidden[:, 80:] = 4
    report = meter.look(hidden)
    # windows of the nodes next to the edge reach 15 px: two or three of 18 columns
    assert report.dark_share == pytest.approx(0.5, abs=0.15)
    assert report.usable_share == pytest.approx(0.45, abs=0.15)
    assert report.score == pytest.approx(1.0, abs=0.05)


def test_no_light_has_no_score(meter):
    report = meter.look(np.full((RIG.camera.rows, RIG.camera.columns), 4, np.uint8))
    assert np.isnan(report.score)
    assert np.isnan(report.blur_px)
    assert (report.dark_share, report.usable_share, report.alignment) == (1, 0, None)


@pytest.mark.parametrize(
    ("scale", "turn_deg", "shift_px"),
    [((1.0, 1.0), 0.0, (0.0, 0.0)), ((1.02, 0.98), 0.0, (0.0, 0.0)), ((1.0, 1.0), 1.5, (2.0, -3.0))],
)
def test_size_turn_and_place_are_those_of_the_picture(meter, scale, turn_deg, shift_px):
    found = meter.look(seen(scale=scale, turn_deg=turn_deg, shift_px=shift_px)).alignment
    # a node's noise of 0.01 px over a view of 140 px; the linear fit leaves the square of a turn: 0.03 %
    assert (found.wider, found.higher) == pytest.approx((scale[0] - 1, scale[1] - 1), abs=1e-3)
    assert found.turn_deg == pytest.approx(turn_deg, abs=0.03)
    assert (found.right_px, found.down_px) == pytest.approx(shift_px, abs=0.1)


def test_a_picture_of_another_shape_is_refused(meter):
    with pytest.raises(InputError):
        meter.look(np.zeros((64, 64), np.uint8))
