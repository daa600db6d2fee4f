"""Measuring the light on the simulated bench: its gamma, its noise and what is wrong with it come back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from small_rigs import with_tables

from zeromethod import MeasurementError, load_rig, open_devices
from zeromethod.calibration.panel_faults import Fault
from zeromethod.commissioning.patterns import TimedPatterns
from zeromethod.commissioning.response import PICTURES, LightResult, measure_light
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame
from zeromethod.resources import resource
from zeromethod.rig.save import save_values

from .setting_up_benches import SMALL_RIG, Altered, failing

Float = NDArray[np.float64]

GAMMA = 1.9
BLACK = 9.0


BELIEVED = SMALL_RIG
"""What the rig file says: gamma 2.2, noise of 2, black of 4 grey levels."""

NOISE = BELIEVED.camera.noise.model_copy(
    update={"read_grey": 1.6, "electrons_per_grey": 25.0, "black_grey": BLACK}
)
TRUTH = with_tables(BELIEVED, display={"gamma": GAMMA, "latency_s": 0.02}, camera={"noise": NOISE})
RIG = with_tables(BELIEVED, display={"latency_s": 0.02})


@pytest.fixture(scope="module")
def shown() -> list[int]:
    return []


@pytest.fixture(scope="module")
def result(shown: list[int]) -> LightResult:
    with open_devices(TRUTH) as devices:
        return measure_light(RIG, devices, lambda: shown.append(1))


def test_planted_gamma_comes_back_with_its_sigma(result):
    whole = result.response.whole
    assert abs(whole.gamma - GAMMA) < 4 * whole.gamma_sigma
    assert whole.gamma_sigma < 0.002
    z = (whole.light - (result.response.codes / 255) ** GAMMA)[1:-1] / whole.sigma[1:-1]
    # 50 numbers that share the errors of black and white
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.7
    assert whole.misfit < 0.003
    assert result.response.falling == ()
    assert result.response.spread().max() < 0.005


def test_a_response_that_differs_over_the_panel_is_measured_and_drawn_away():
    planted = ((0.8, 1.0), (1.0, 1.2))
    truth = with_tables(TRUTH, display={"response_exponent": planted})
    with open_devices(truth) as devices:
        found = measure_light(RIG, devices)
    assert found.exponent is not None
    # all relative to the whole of the view, and to some percent at the panel's corners, which are not in it
    ratio = np.array(found.exponent) / planted
    assert np.ptp(ratio) < 0.1
    assert found.response.spread().max() > 0.015
    assert found.response.spread(found.exponents).max() < 0.005
    assert not any("over the view" in words for words in found.advice)
    display = RIG.replace(found.rig_values()).display
    assert np.array(display.response_exponent) == pytest.approx(np.array(found.exponent), abs=1e-4)


def test_planted_noise_comes_back_with_its_sigma(result):
    noise = result.noise
    assert abs(noise.black.grey - BLACK) < 2 * noise.black.sigma
    assert abs(noise.read_grey - 1.6) < 2.5 * noise.read_sigma
    # the panel's light at code 0 is none, so the black pictures show nothing but the camera's black
    assert float(noise.variance(BLACK)) == pytest.approx(1.6**2 + 1 / 12, rel=0.02)
    assert abs(noise.electrons_per_grey - 25.0) < 4 * noise.electrons_sigma
    assert noise.electrons_sigma < 1.0
    assert not result.bad_pixels.any()


def test_a_sound_bench_is_not_accused(result):
    assert {finding.fault for finding in result.findings} == set(Fault)
    assert [finding.words for finding in result.findings if finding.found] == []
    assert result.advice == result.noise.notes
    assert [note.partition(":")[0] for note in result.advice] == ["black level"]
    assert result.falloff.darkest > 0.9


def test_every_picture_is_counted_and_held(result, shown):
    assert len(shown) == PICTURES
    # latency, scan-out and twelve time constants of a rise of 4 ms
    assert result.hold_s > 0.02 + 1 / 60 + 0.021


def test_the_values_go_into_the_rig_file(result, tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(resource("calibration", "rigs", "simulated.toml").read_text())
    save_values(path, result.rig_values())
    rig = load_rig(path)
    assert rig.camera.noise.black_grey == pytest.approx(result.noise.black.grey, abs=1e-3)
    assert rig.display.response_light[0] == 0
    assert rig.display.response_light[-1] == 1
    assert "# The bench" in path.read_text()


def test_a_dimming_and_flickering_backlight_is_named_with_what_to_do():
    rng = np.random.default_rng(5)
    with open_devices(TRUTH) as devices:
        display, camera = devices.display, devices.camera

        def dimmed(image: NDArray[np.uint8]) -> int:
            light = (image / 255.0) ** GAMMA
            light *= 1 - 0.15 * (1 - light.mean())
            return int(display.show(np.rint(255 * light ** (1 / GAMMA)).astype(np.uint8)))

        def flickering(timeout_s: float) -> Frame:
            frame = camera.read(timeout_s)
            grey = BLACK + (1 + 0.01 * rng.standard_normal()) * (frame.image - BLACK)
            return replace(frame, image=np.clip(np.rint(grey), 0, 255).astype(np.uint8))

        devices.display, devices.camera = Altered(display, show=dimmed), Altered(camera, read=flickering)
        found = measure_light(RIG, devices)
    sizes = {finding.fault: finding for finding in found.findings if finding.found}
    assert {Fault.DYNAMIC_CONTRAST, Fault.BACKLIGHT_FLICKER} <= set(sizes)
    assert Fault.TEMPORAL_DITHERING not in sizes
    # in codes of 8 bits the patch comes as near as half a code, and flicker adds 1 %
    assert sizes[Fault.DYNAMIC_CONTRAST].size == pytest.approx(-0.14, abs=0.03)
    assert sizes[Fault.BACKLIGHT_FLICKER].size == pytest.approx(
        0.01, abs=4 * sizes[Fault.BACKLIGHT_FLICKER].sigma
    )
    assert any("switch off dynamic contrast" in line for line in found.advice)
    assert any("full brightness" in line for line in found.advice)
    # flicker is no noise of the camera
    assert abs(found.noise.read_grey - 1.6) < 4 * found.noise.read_sigma


def test_a_panel_far_slower_than_its_rig_file_says_is_waited_for():
    with open_devices(with_tables(TRUTH, display={"rise_s": 0.1})) as devices:
        found = measure_light(RIG, devices)
    assert found.hold_s > 0.4  # 4.6 time constants of 46 ms, twice, and latency
    assert abs(found.response.whole.gamma - GAMMA) < 4 * found.response.whole.gamma_sigma
    assert not any(finding.found for finding in found.findings)


@pytest.mark.parametrize("latency_s", [0.0, 0.05, 0.2])
def test_frames_that_could_have_seen_the_picture_before_are_never_used(latency_s):
    bench = with_tables(TRUTH, display={"latency_s": latency_s})
    with open_devices(bench) as devices:
        pictures = TimedPatterns(bench, devices, 0.0)
        means = []
        for code in (0, 255, 0, 128, 255, 0):
            picture = np.full((135, 240), code, np.uint8)
            means.append([float(frame.image.mean()) for frame in pictures.frames(picture, 2)])
    light = np.array(means) - BLACK
    whole = light[1].mean()
    expected = (np.array([0, 255, 0, 128, 255, 0]) / 255) ** GAMMA
    # noise of a mean over 5120 px is 0.05 of 195 grey levels at most
    assert np.max(np.abs(light / whole - expected[:, None])) < 0.002


def test_a_rig_file_that_knows_nothing_of_the_latency_is_saved_by_the_margin():
    with open_devices(with_tables(TRUTH, display={"latency_s": 0.08})) as devices:
        pictures = TimedPatterns(BELIEVED, devices, 0.1)
        for code in (0, 255):
            frames = pictures.frames(np.full((135, 240), code, np.uint8), 1)
            assert abs(frames[0].image.mean() - (BLACK if code == 0 else 204)) < 2


def test_a_camera_that_does_not_see_the_lcd_is_refused():
    faults = TRUTH.simulation.faults.model_copy(update={"light_off_frames": (0, 10_000)})
    with (
        open_devices(with_tables(TRUTH, simulation={"faults": faults})) as devices,
        pytest.raises(MeasurementError, match=r"^response: the white LCD is .* brighter than the black one"),
    ):
        measure_light(RIG, devices)


def test_a_silent_camera_is_refused_and_a_lost_one_passes():
    for raised, expected in ((CameraTimeout("none"), MeasurementError), (CameraLost("gone"), CameraLost)):
        with open_devices(TRUTH) as devices:
            devices.camera = Altered(devices.camera, read=failing(raised))
            with pytest.raises(expected):
                measure_light(RIG, devices)
