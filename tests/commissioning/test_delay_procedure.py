"""Measuring the delay on the simulated bench: planted ones come back; bad benches are refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from zeromethod import MeasurementError, Rig, open_devices
from zeromethod.commissioning.delay import LEAST_FRAMES, DelayResult, measure_delay
from zeromethod.devices.protocols import CameraLost, CameraTimeout, DisplayLost, Frame

from .setting_up_benches import RIG, Altered, failing, planted

FRAME_S = 1 / RIG.camera.rate_hz


def measured(
    truth: Rig, seconds: float = 0.4, believed: Rig = RIG, alter: Callable[[Frame], Frame] = replace
) -> DelayResult:
    """What is measured of a bench that truly stands as `truth`, by one who believes `believed`."""
    with open_devices(truth) as devices:
        camera = devices.camera
        devices.camera = Altered(camera, read=lambda timeout_s: alter(camera.read(timeout_s)))
        return measure_delay(believed, devices, seconds)


def stamped(frame: Frame, late_s: float) -> Frame:
    """The same frame with a stamp that is late."""
    return replace(frame, time_ns=frame.time_ns + round(1e9 * late_s))


@pytest.mark.parametrize("frames", [0.0, 0.3, 0.75, 1.0, 2.4, 4.0])
def test_a_planted_delay_comes_back_within_a_tenth_of_a_frame(frames):
    result = measured(planted(display={"latency_s": frames * FRAME_S}))
    # bar: 0.1 frame. Noise of the strips is some 10 us; what is left is the clocks' jitter, 0.1 ms a frame.
    assert result.latency_s == pytest.approx(frames * FRAME_S, abs=0.01 * FRAME_S)
    assert result.sigma_s < 0.01 * FRAME_S
    assert result.used >= LEAST_FRAMES


@pytest.mark.parametrize("stamp_s", [-0.011, 0.004])
def test_wrong_stamps_of_the_camera_are_part_of_the_delay(stamp_s):
    result = measured(planted(display={"latency_s": 0.006}), alter=lambda frame: stamped(frame, stamp_s))
    assert result.latency_s == pytest.approx(0.006 + stamp_s, abs=0.01 * FRAME_S)


def test_what_the_rig_file_said_before_does_not_matter():
    truth = planted(display={"latency_s": 0.02})
    for believed_s in (0.0, 0.02, 0.09):
        believed = planted(display={"latency_s": believed_s})
        assert measured(truth, believed=believed).latency_s == pytest.approx(0.02, abs=0.01 * FRAME_S)


def in_step(phase: float, exposure_s: float) -> Rig:
    """Equal rates without jitter and a panel that changes at once: every exposure sees the same."""
    return planted(
        display={"rise_s": 0.0, "scanout_s": 0.0},
        camera={"exposure_s": exposure_s},
        simulation={"display_refresh_hz": 60.0, "camera_jitter_s": 0.0, "camera_phase": phase},
    )


@pytest.mark.parametrize("phase", [0.05, 0.12, 0.3, 0.6])
def test_a_panel_in_step_with_the_camera_is_timed_as_well_as_its_exposures_allow(phase):
    """Exposures of 13.5 of 16.7 ms that see one picture alone leave 3.2 ms open, 1.6 to either side."""
    bench = in_step(phase, 0.0135)
    result = measured(bench, believed=bench)
    assert abs(result.latency_s) < 0.1 * FRAME_S
    assert abs(result.latency_s) < 3 * result.sigma_s + 1e-4


def test_exposures_that_all_see_one_picture_alone_give_the_range_that_they_leave_open():
    bench = in_step(phase=0.1, exposure_s=0.008)  # 8.7 ms of delays are as good
    result = measured(bench, believed=bench)
    assert result.range_s is not None
    low_s, high_s = result.range_s
    assert low_s < 0.0 < high_s
    # the frame time less the exposure, and at either end three sigma of noise: 0.03 of the exposure each
    assert FRAME_S - 0.008 < high_s - low_s < FRAME_S - 0.008 + 6 * 0.03 * 0.008
    assert result.why.startswith("a longer exposure")
    assert result.rig_values(0.0) == {
        "display.latency_s": 0.0,
        "display.latency_range_s": [round(low_s, 6), round(high_s, 6)],
    }
    # a file's value outside is contradicted
    assert result.rig_values(0.03)["display.latency_s"] == round(result.latency_s, 6)


def test_clocks_that_drift_past_each_other_are_waited_for():
    """Half a frame a second apart, the first look sees a fifth of a refresh, and each picture alone."""
    bench = in_step(phase=0.3, exposure_s=0.008)
    drifting = planted_again(bench, camera_rate_hz=59.5)
    result = measured(drifting, believed=bench)
    assert result.range_s is None
    assert result.latency_s == pytest.approx(0.0, abs=0.01 * FRAME_S)
    # it ends as soon as enough is known, at the latest once round: 2 s
    assert 0.4 * 59.5 < result.frames < 2.4 * 59.5


def planted_again(bench: Rig, **simulation: float) -> Rig:
    """The bench with other clocks."""
    return bench.model_copy(update={"simulation": bench.simulation.model_copy(update=simulation)})


def test_the_rates_and_the_loops_delay_are_measured_with_it():
    result = measured(RIG, seconds=1.0)
    # RIG's clocks: a refresh of 59.94 Hz is a thousandth off what the rig file says
    assert result.refresh_hz == pytest.approx(59.94, abs=0.01)
    assert result.camera_rate_hz == pytest.approx(60.0, abs=0.01)
    # exposure 8 ms, arrival 4 ms after its end, to the next refresh, scan-out and rise, and exposed again
    assert 1.5 < result.delay_frames < 4
    assert result.frames >= result.read >= result.used > 0


def test_a_delay_that_scatters_is_a_range():
    """Stamps that are off by 0 to 25 ms: as on a busy computer."""
    rng = np.random.default_rng(3)
    result = measured(RIG, 1.0, alter=lambda frame: stamped(frame, -float(rng.uniform(0, 0.025))))
    assert result.range_s is not None
    assert result.why.startswith("it is not steady: it scatters by")
    # the middle nine tenths, and three sigma of their ends by some 60 frames
    assert result.range_s == pytest.approx((-0.02375, -0.00125), abs=0.003)


def test_a_delay_that_comes_and_goes_is_not_measured():
    """Stamps that are off by 0 to 80 ms: as on a computer that is too busy."""
    rng = np.random.default_rng(3)
    with pytest.raises(MeasurementError, match=r"^delay: it is not steady: .* computer too busy\?$"):
        measured(RIG, 1.0, alter=lambda frame: stamped(frame, -float(rng.uniform(0, 0.08))))


def test_codes_that_cannot_be_read_are_refused():
    with pytest.raises(MeasurementError, match=r"^delay: the codes of 0 of \d+ frames could be read, 8 are"):
        measured(RIG, alter=lambda frame: replace(frame, image=np.zeros_like(frame.image)))


def test_frames_that_fit_no_order_of_pictures_are_not_blamed_on_focus():
    """Legible codes of pictures that were never next to each other: of a display that skips and repeats."""
    with pytest.raises(
        MeasurementError,
        match=r"^delay: the codes of \d of \d+ frames fit what was shown when: does the display",
    ):
        measured(RIG, alter=Skipping())


class Skipping:
    """Every frame saw half of the picture three frames ago, and half of the one eight frames ago."""

    def __init__(self) -> None:
        self._images: list[np.ndarray[Any, Any]] = []

    def __call__(self, frame: Frame) -> Frame:
        self._images.append(frame.image.astype(float))
        older, old = self._images[-9:][0], self._images[-4:][0]
        return replace(frame, image=(0.5 * (old + older)).astype(np.uint8))


def test_a_view_without_room_for_codes_is_refused():
    with pytest.raises(MeasurementError, match=r"^delay: .* no room for codes$"):
        measured(RIG, believed=planted(display={"centre_mm": (30.0, 34.0)}))


def test_a_silent_camera_is_refused():
    with pytest.raises(MeasurementError, match=r"^delay: the camera gave no frame for 3 s$"):
        measured(RIG, 5, alter=failing(CameraTimeout("none")))


@pytest.mark.parametrize("lost", [CameraLost("gone"), DisplayLost("gone")])
def test_a_lost_device_passes(lost):
    with pytest.raises(type(lost)):
        measured(RIG, alter=failing(lost))


def test_frames_are_counted_and_windows_polled(monkeypatch):
    counted: list[int] = []
    polled: list[int] = []
    with open_devices(RIG) as devices:
        monkeypatch.setattr(devices.display, "poll", lambda: polled.append(1), raising=False)
        result = measure_delay(RIG, devices, 0.5, lambda: counted.append(1))
    assert len(counted) == result.frames
    # a picture at every refresh, with the window looked after in between; up to 20 before any frame counts
    assert 0.5 * RIG.display.refresh_hz - 2 <= len(polled) <= 0.5 * RIG.display.refresh_hz + 2 + 20
