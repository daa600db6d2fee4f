"""A bench that stands otherwise than its rig file says, from first picture to verdict, unattended."""

import math

import numpy as np
import pytest
from crooked_bench import OFF

from zeromethod import DelayResult, MeasurementError, Optics, open_devices
from zeromethod.calibration import describe, judge
from zeromethod.calibration.shortfall import Lack, Part
from zeromethod.commissioning.calibration import Plan, procedure, record

from .conftest import DEPTHS_MM, PLACES_MM
from .planted import LATENCY_S, nominal, quarter, read_elsewhere, truth


def test_the_person_is_asked_in_order(hand):
    asked = [line for line in hand.lines if line.startswith("press")]
    assert asked == [
        "press 1 of 2: press 0.2 mm deep now, and hold still for 0.1 s",
        "press 1 of 2: taken; lift",
        "press 2 of 2: press 0.15 mm deep now, and hold still for 0.1 s",
        "press 2 of 2: taken; lift",
    ]
    assert "do not touch" in hand.lines[0]


def test_every_part_has_a_bar_that_comes_to_its_end(hand):
    assert list(hand.counts) == [
        "settling",
        "rest map",
        "decoding",
        "geometry from the rest map",
        "scan-out and rise",
        "delay",
        "rest and presses, by the loop",
    ]
    # how many frames come in the time of the delay is the camera's to say
    assert all(done == total for words, (done, total) in hand.counts.items() if words != "delay")


def test_pictures_are_held_until_they_stand(recorded):
    # delay, scan-out, and the rise of 4 ms (10 to 90 %) down to a hundredth: the least that is right
    least_s = LATENCY_S + 1 / 60 + np.log(100) / np.log(9) * 0.004
    assert least_s < recorded.settling.hold_s < least_s + 4 / 60


def test_delay_is_that_of_the_bench(recorded):
    # a fiftieth of a refresh
    assert recorded.delay.latency_s == pytest.approx(LATENCY_S, abs=3e-4)
    assert recorded.values["display.latency_s"] == pytest.approx(LATENCY_S, abs=3e-4)


def test_rest_map_is_that_of_the_bench(calibration):
    rig = truth(nominal())
    rest = calibration.rest.rest_map
    v, u = np.mgrid[: rig.camera.rows, : rig.camera.columns].astype(float)
    apart = (rest.lcd_px - Optics(rig).rest_map(u, v))[rest.valid]
    assert rest.valid.mean() > 0.98
    # sigma is 0.02 LCD px; the LCD's own pixels add as much
    assert np.sqrt(np.mean(apart**2)) < 0.05


def test_parameters_are_within_their_stated_sigma(calibration):
    given = describe(nominal())
    true = {name: value + OFF.get(name, 0.0) for name, value in given.items()}
    sigma = calibration.fitted.sigma
    away = [(value - true[name]) / sigma[name] for name, value in calibration.fitted.values.items()]
    # twenty of them, by chance: 3.3 sigma once in fifty such benches
    assert np.max(np.abs(away)) < 3.3


def test_known_presses_are_read_as_known(calibration):
    read = [peak.depth_mm for peak in calibration.peaks]
    assert read == pytest.approx(DEPTHS_MM, rel=0.004)
    for peak, (x, y) in zip(calibration.peaks, PLACES_MM, strict=True):
        # the place shares in what is not known of LCD and camera: about 1 mm
        assert np.hypot(peak.x_mm - x, peak.y_mm - y) < 3.0


def test_another_press_is_read_in_millimetres(calibration):
    """Elsewhere, of another depth and width, its warp by exact rays through the true bench."""
    read_mm, true_mm = read_elsewhere(calibration, nominal(), 41.0)
    assert read_mm == pytest.approx(true_mm, rel=0.01)
    # and what was believed before is worse than what is stated now
    assert calibration.depth_percent < 1.0


def test_nothing_but_what_was_left_out_speaks_against_it(calibration):
    assert calibration.verdict.level == "uncertain"
    left_out = "light: left out: the rig file's response and noise hold, unmeasured"
    assert calibration.verdict.findings == (left_out,)
    assert judge(calibration.fitted, calibration.error, shortfalls=()).level == "good"
    # loop and phase shifting, two ways to measure one warp; both know it to 0.02 LCD px
    assert calibration.drift_px < 0.05


def test_lcd_that_is_not_seen_is_said():
    rig = quarter()
    dark = rig.simulation.model_copy(update={"peak_grey_share": 0.02})
    with (
        open_devices(rig.model_copy(update={"simulation": dark})) as devices,
        pytest.raises(MeasurementError, match=r"^settling: the camera does not see the LCD"),
    ):
        record(rig, devices, Plan())


def test_what_was_measured_outlives_a_press_that_never_comes():
    rig = quarter()
    plan = Plan((0.2,), light=False, delay=False, rest_frames=1, press_frames=4, patience_s=0.3)
    with open_devices(rig) as devices:
        recorded, rest = record(rig, devices, plan)
    assert "no press 1 of 1" in recorded.failure
    assert recorded.presses is None
    assert recorded.plan.press_depths_mm == ()
    assert rest.rest_map.valid.mean() > 0.9


@pytest.mark.parametrize(
    ("outcome", "believed_s", "lack", "latency_s", "level"),
    [
        (MeasurementError("delay: it is not steady"), 0.0, Lack.FAILED, None, "bad"),
        ((0.0133, 0.0206), 0.0, Lack.BOUNDED, 0.01695, "uncertain"),
        ((0.0133, 0.0206), 0.015, Lack.BOUNDED, 0.015, "uncertain"),
    ],
)
def test_a_delay_that_was_not_measured_is_never_good(
    outcome, believed_s, lack, latency_s, level,
    calibration, monkeypatch
):  # fmt: skip
    """Neither codes nor changes of the picture time the panel; a range replaces what it contradicts."""

    def timed(*_: object) -> DelayResult:
        if isinstance(outcome, Exception):
            raise outcome
        middle_s = float(np.mean(outcome))
        return DelayResult(middle_s, 0.002, math.nan, 60.0, 60.0, 0.05, 180, 170, 0, outcome, "in step")

    def untimed(*_: object) -> None:
        raise MeasurementError("panel timing: the camera does not see the panel change")

    monkeypatch.setattr(procedure, "measure_delay", timed)
    monkeypatch.setattr(procedure, "measure_panel_timing", untimed)
    rig = quarter().replace({"display.latency_s": believed_s})
    with open_devices(rig.model_copy(update={"scenario": "none"})) as devices:
        recorded, _ = record(rig, devices, Plan(light=False, rest_frames=1))
    assert [(one.part, one.lack) for one in recorded.shortfalls[1:]] == [
        (Part.PANEL, Lack.FAILED),
        (Part.DELAY, lack),
    ]
    assert recorded.values.get("display.latency_s") == latency_s
    rig.replace(recorded.values)  # is a rig
    judged = judge(calibration.fitted, calibration.error, shortfalls=recorded.shortfalls)
    assert judged.level == level


def test_rest_map_outlives_ctrl_c_in_a_later_step(monkeypatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(procedure, "measure_panel_timing", interrupted)
    rig = quarter()
    with open_devices(rig) as devices:
        recorded, rest = record(rig, devices, Plan((0.2,), light=False, rest_frames=1))
    assert recorded.interrupted
    assert recorded.failure == "panel: interrupted"
    lacking = [(one.part, one.lack) for one in recorded.shortfalls]
    assert lacking == [(Part.LIGHT, Lack.SKIPPED), (Part.PRESSES, Lack.FAILED), (Part.DELAY, Lack.SKIPPED)]
    assert recorded.plan.press_depths_mm == ()
    assert rest.rest_map.valid.mean() > 0.9


def test_camera_lost_on_the_way_names_the_step():
    rig = quarter()
    faults = rig.simulation.faults.model_copy(update={"camera_lost_at_frame": 20})
    simulation = rig.simulation.model_copy(update={"faults": faults})
    with (
        open_devices(rig.model_copy(update={"simulation": simulation})) as devices,
        pytest.raises(MeasurementError, match=r"settling: the camera is lost"),
    ):
        record(rig, devices, Plan(light=False))
