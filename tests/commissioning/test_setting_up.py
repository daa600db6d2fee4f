"""Setting up by eye on the simulated bench: every planted fault brings its own advice, and nothing else."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from zeromethod import Devices, MeasurementError, open_devices
from zeromethod.commissioning.advice import GOOD
from zeromethod.commissioning.setting_up import FlickerMeter, SettingUp, Sight
from zeromethod.devices.protocols import CameraLost, CameraTimeout, DisplayLost, Frame

from .setting_up_benches import RIG, Altered, look, planted

FOCAL_PX = 1125.0
MIRRORED, BOTH = {"mirrored": True}, "the picture is seen mirrored and turned"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({}, GOOD),
        ({"camera": {"psf_px": 2.0}}, "out of focus (blur of about 2.0 px)"),
        ({"simulation": {"peak_grey_share": 0.15}}, "too dark: 54 ms would be wanted, a frame lasts 16.7 ms"),
        ({"simulation": {"ambient": 0.2}}, "stray light, 20% of the LCD's"),
        ({"display": MIRRORED}, "the picture is seen mirrored: set display.mirrored"),
        ({"display": {"turn_deg": 90.0}}, "the picture is seen turned by 90 degrees clockwise"),
        ({"display": {"turn_deg": -90.0}}, "the picture is seen turned by 90 degrees anticlockwise"),
        ({"display": {"turn_deg": 180.0}}, "the picture is seen turned by 180 degrees"),
        ({"display": MIRRORED | {"turn_deg": 90.0}}, f"{BOTH} by 90 degrees clockwise"),
        ({"display": MIRRORED | {"turn_deg": -90.0}}, f"{BOTH} by 90 degrees anticlockwise"),
        ({"display": MIRRORED | {"turn_deg": 180.0}}, f"{BOTH} by 180 degrees"),
        ({"display": {"turn_deg": 2.0}}, "the picture is turned by 2.0 degrees clockwise"),
        ({"camera": {"roll_deg": 3.0}}, "the picture is turned by 3.0 degrees anticlockwise"),
        ({"camera": {"focal_px": (0.975 * FOCAL_PX,) * 2}}, "the picture is -2.5% wide and -2.5% high"),
        ({"camera": {"centre_px": (85.5, 63.5)}}, "the picture lies 6 px right of where"),
    ],
)  # fmt: skip
def test_a_planted_fault_brings_its_own_advice_and_no_other(fault, words):
    (said,) = look(planted(**fault)).lines
    assert said.startswith(words)


def test_over_exposure_is_reported_first_and_what_it_spoils_is_not():
    sight = look(planted(simulation={"peak_grey_share": 1.0, "ambient": 0.3}))
    assert sight.advice[0].startswith("saturated (")
    assert "shorten the exposure (now 8 ms)" in sight.advice[0]
    assert not any("focus" in said or "usable" in said for said in sight.advice)
    assert sight.report.saturated_share == pytest.approx(np.mean(sight.frame.image == 255))


def test_no_light_is_reported_before_what_follows_from_it():
    sight = look(planted(simulation={"peak_grey_share": 0.002 + 4 / 255}))
    assert sight.advice[0].startswith("no light: lens cap, aperture")


def test_an_lcd_out_of_view_is_not_seen():
    sight = look(planted(display={"centre_mm": (30.0, 200.0)}))
    assert any("the LCD is not seen" in said for said in sight.advice)
    assert not any("flickers" in said or "focus" in said for said in sight.advice)
    assert sight.place is None


def test_where_the_picture_lies_is_known_to_a_tenth_of_a_pixel():
    sight = look(planted(camera={"centre_px": (81.5, 60.5)}))
    # noise of a node 0.01 px, some hundred nodes; the view's middle sees another part of the keystone
    assert (sight.place.right_px, sight.place.down_px) == pytest.approx((2, -3), abs=0.1)


def test_a_picture_too_far_off_for_the_target_is_placed_by_plain_pictures():
    # edges of the plain pictures lie on whole LCD px, 0.6 camera px here: of 64 px of picture, 1 %
    far = look(planted(camera={"centre_px": (79.5, 43.5)}))  # the target looks the same 16 px further on
    assert (far.place.right_px, far.place.down_px) == pytest.approx((0, -20), abs=1)
    assert any("px above of where the rig file expects it" in said for said in far.advice)
    large = look(planted(camera={"focal_px": (1.09 * FOCAL_PX,) * 2}))
    assert (large.place.wider, large.place.higher) == pytest.approx((0.09, 0.09), abs=0.015)
    assert len(large.advice) == 1


def test_without_the_lcd_only_the_camera_is_judged():
    """The simulated display shows an even grey before its first picture: a camera that looks at a wall."""
    sight = look(RIG, with_lcd=False)
    assert sight.seen is None
    assert sight.place is None
    assert len(sight.advice) == 1
    assert sight.advice[0].startswith("no target is seen: is it on the LCD")


def test_far_out_of_focus_the_lcd_is_seen_but_its_pattern_is_not():
    with open_devices(RIG) as devices:
        camera = devices.camera

        def blurred(timeout_s: float) -> Frame:  # quicker than tracing the rays of a lens out of focus
            frame = camera.read(timeout_s)
            return replace(frame, image=cv2.GaussianBlur(frame.image, None, 6.0))

        devices.camera = Altered(camera, read=blurred)
        (sight,) = SettingUp(RIG, devices, with_lcd=True).sights(0.01)
    assert sight.advice[0].startswith("far out of focus: the LCD is seen, its pattern is not")


def test_the_lcd_is_looked_for_again_while_it_is_not_seen_as_it_should_be(monkeypatch):
    monkeypatch.setattr("zeromethod.commissioning.setting_up.LOOK_AGAIN_S", 0.1)
    shown: list[int] = []

    def sights(devices: Devices, seconds: float | None) -> Iterator[Sight]:
        show = devices.display.show
        devices.display = Altered(devices.display, show=lambda image: (shown.append(1), show(image))[1])
        return SettingUp(RIG, devices, with_lcd=True).sights(seconds)

    with open_devices(planted(display={"mirrored": True})) as devices:
        mirrored = sights(devices, None)
        next(mirrored)
        assert len(shown) == 6
        while len(shown) < 12:
            next(mirrored)
    shown.clear()
    with open_devices(RIG) as devices:
        assert len(list(sights(devices, 0.3))) > 10
        assert len(shown) == 6


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CameraTimeout("none"), "the camera gave no frame for 3 s"),
        (CameraLost("cable"), "the camera is lost: cable"),
        (DisplayLost("unplugged"), "the display is lost: unplugged"),
    ],
)
def test_a_device_that_fails_ends_it_with_the_reason(error, words):
    with open_devices(RIG) as devices:
        camera, left = devices.camera, iter(range(20))

        def read(timeout_s: float) -> Frame:
            if next(left, None) is None:
                raise error
            return camera.read(timeout_s)

        devices.camera = Altered(camera, read=read)
        with pytest.raises(MeasurementError) as ended:
            list(SettingUp(RIG, devices, with_lcd=False).sights(10))
    assert str(ended.value) == words


def test_flicker_is_the_lights_swing_less_its_drift():
    greys = 4 + 100 * (1 + 0.03 * np.sin(np.arange(16) * 1.9)) + np.arange(16)
    flicker = FlickerMeter(black_grey=4.0)
    shares = [flicker.note(float(grey)) for grey in greys]
    assert np.isnan(shares[:7]).all()
    # a sine's rms is its amplitude over sqrt(2); 16 frames of it hold no whole number of cycles: 10 %
    assert shares[-1] == pytest.approx(0.03 / np.sqrt(2) * 100 / 107.5, rel=0.1)
    steady = FlickerMeter(black_grey=4.0)
    assert [steady.note(100.0 + n) for n in range(16)][-1] < 1e-9
