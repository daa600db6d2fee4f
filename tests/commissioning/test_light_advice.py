"""Exposure, brightness and what to shade, from frames of benches under other lights."""

import math

import numpy as np
import pytest

from zeromethod.commissioning.advice import GOOD
from zeromethod.commissioning.light_advice import mains_hz

from .setting_up_benches import look, planted


def test_the_mains_are_known_by_how_frames_see_their_light_swing():
    rng = np.random.default_rng(3)
    times_s = np.arange(16) / 60 + 1e-4 * rng.standard_normal(16)
    slow = np.arange(16) / 49.7  # at 60 Hz the mains' 120 stand still
    for hz, seen in ((100.0, times_s), (120.0, slow)):
        light = 100 + 2 * np.cos(2 * np.pi * hz * seen + 0.7) + 0.1 * rng.standard_normal(16)
        assert mains_hz(seen, light) == hz
    assert math.isnan(mains_hz(times_s, 100 + 2 * np.cos(2 * np.pi * 227.0 * times_s)))
    assert math.isnan(mains_hz(times_s, 100 + rng.standard_normal(16)))


def test_lamps_on_the_mains_are_named_and_whole_periods_advised():
    # of the mains' light 10 % reaches the camera, a quarter of whose swing 8 ms leave; 11 ms have room for 10
    sight = look(planted(light={"mains": 0.6, "brightness": 0.7}), seconds=0.3)
    assert sight.mains_hz == 100.0
    assert sight.advised_exposure_s == pytest.approx(0.01)
    (said,) = (line for line in sight.lines if line.startswith("lamps on the mains flicker by "))
    assert said.endswith("expose for whole periods (10, 20 ms ...)")


def test_weak_lamps_on_the_mains_are_known_and_no_reason_for_another_exposure():
    # 1.5 % of the light, of whose swing 8 ms leave a quarter: below 1 % from frame to frame
    sight = look(planted(light={"mains": 0.1, "brightness": 0.7}), seconds=0.3)
    assert sight.mains_hz == 100.0
    assert 0.001 < sight.flicker_share < 0.01
    assert not any("flicker" in line for line in sight.lines)


def test_light_of_the_room_is_measured_with_the_lcd_black():
    # a room adds 0.098 of the white LCD per unit; at the view's borders the way back misses the mirror
    sight = look(planted(light={"room": 1.5}))
    assert sight.seen.stray_share == pytest.approx(1.5 * 0.0979, rel=0.05)
    assert sight.lines[0].startswith("stray light, 14% of the LCD's: darken the room, shade the prism")
    assert sight.seen.glare is None


def test_a_ring_light_is_found_by_its_image_with_the_lcd_black():
    sight = look(planted(light={"ring": 1.0}))
    glare = sight.seen.glare
    # both images overlap at their brightest: 2.9 and 6.9 % of it; outer radius 482 of 1280 px, binned by 8,
    # smoothed over 5
    assert glare.share == pytest.approx(0.098, rel=0.1)
    assert glare.size_px == pytest.approx(2 * 482 / 8, abs=3)
    assert sight.advice[0].startswith("with the LCD black a lamp's image is seen, 10% of the LCD's light")


@pytest.mark.parametrize(("brightness", "wanted_ms"), [(1.0, 9.4), (0.7, 13.4), (1.15, 8.1)])
def test_the_advised_exposure_takes_the_targets_peaks_near_full_scale(brightness, wanted_ms):
    """Peaks at 0.95 of white, white at 0.8 of full scale at 8 ms: 0.88 wants 8 x 0.88 / 0.76 ms."""
    sight = look(planted(light={"brightness": brightness}))
    # black and noise in the brightest percentile
    assert 1e3 * sight.advised_exposure_s == pytest.approx(wanted_ms, rel=0.04)
    within = wanted_ms < 8 * 1.3
    assert (sight.lines == (GOOD,)) is within
    assert within or sight.lines[0].startswith("set the exposure from 8 to about 13 ms")
