"""Planted faults of a display are found, named and sized; a sound one is not accused."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.calibration.panel_dithering import spatial_dithering, temporal_dithering
from zeromethod.calibration.panel_faults import Fault, FaultCheck, flicker, step_response, surround
from zeromethod.errors import InputError

Float = NDArray[np.float64]

SHAPE = (48, 64)
LIT = np.ones(SHAPE, dtype=np.bool_)
NOISE = 2.0
"""Grey levels: the camera's."""
STEP = 0.8
"""Grey levels per grey code of the LCD."""
FRAMES = 32


def assert_named(finding: FaultCheck, fault: Fault, advice: str) -> None:
    assert finding.found
    assert finding.fault is fault
    assert finding.words.startswith(f"{fault}: ")
    assert advice in finding.words


def assert_sound(finding: FaultCheck) -> None:
    assert not finding.found
    assert finding.words.startswith(f"{finding.fault}: none above")


# Surround


def patches(
    seed: int, dimmed: float = 0.0, glare: float = 0.0, tone: float = 0.0, noise: float = 0.05
) -> Float:
    """(repeats, surrounds black, grey, white; patch dark, middling, bright) grey."""
    around = np.array([0.0, 0.22, 1.0])[:, None]
    share = np.array([0.0, 0.22, 1.0])[None, :] + tone * (1 - around) * np.array([0.0, 1.0, 0.0])
    light = 180 * share * (1 - dimmed * (1 - around)) + 180 * glare * around + 6
    return light + noise * np.random.default_rng(seed).standard_normal((2, 3, 3))


def test_dynamic_contrast_is_found_and_sized():
    found = [surround(patches(seed, dimmed=0.2)) for seed in range(40)]
    assert_named(found[0][0], Fault.DYNAMIC_CONTRAST, "switch off dynamic contrast, local dimming")
    assert "-20.0 % of light on black" in found[0][0].words
    z = np.array([(gain.size + 0.2) / gain.sigma for gain, _ in found])
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.4  # 40 normal numbers 1 +- 0.11, sigma from 9 degrees of freedom
    for _, tone in found:
        assert_sound(tone)


def test_a_tone_curve_that_follows_the_picture_is_found():
    gain, tone = surround(patches(0, tone=0.06))
    assert_named(tone, Fault.ADAPTIVE_TONE, "switch off adaptive contrast")
    assert tone.size == pytest.approx(0.06, abs=4 * tone.sigma)
    assert_sound(gain)


# 1 % of a frame's light would show at 5 sigma only
@pytest.mark.parametrize("how", [{"glare": 0.05}, {"noise": 1.0}])
def test_glare_and_noise_are_neither(how):
    for seed in range(40):
        for finding in surround(patches(seed, **how)):
            assert_sound(finding)


# Flicker


def levels(seed: int, own: float = 0.0, room: float = 0.0, count: int = FRAMES) -> tuple[Float, Float, Float]:
    """Times, and mean grey of white and black frames; own and room: rms over the white's light."""
    rng = np.random.default_rng(seed)
    times = np.arange(count) / 60
    beat = np.sqrt(2) * 200 * room * np.sin(2 * np.pi * 7.3 * np.arange(2 * count) / 60 + seed)
    mean_noise = 0.02 * rng.standard_normal((2, count))
    white = 204 + 200 * own * rng.standard_normal(count) + beat[:count] + mean_noise[0]
    return times, white, 4 + beat[count:] + mean_noise[1]


def test_a_flickering_backlight_is_found_and_sized():
    found = [flicker(*levels(seed, own=0.02), noise_grey=0.02) for seed in range(40)]
    backlight, room = found[0]
    assert_named(backlight, Fault.BACKLIGHT_FLICKER, "set it to full brightness")
    assert_sound(room)
    z = np.array([(one[0].size - 0.02) / one[0].sigma for one in found])
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.4


def test_lamps_in_the_room_are_separated_from_the_backlight_with_their_rhythm():
    backlight, room = flicker(*levels(1, room=0.02), noise_grey=0.02)
    assert_named(room, Fault.ROOM_LIGHT, "lamps")
    assert room.size == pytest.approx(0.02, rel=0.1)
    assert "at 7.3 Hz" in room.words or "at 7.5 Hz" in room.words or "at 7 Hz" in room.words
    assert_sound(backlight)


def test_steady_light_and_slow_drift_are_no_flicker():
    for seed in range(40):
        times, white, black = levels(seed)
        drifting = white * np.linspace(1, 1.02, len(white))
        for finding in (*flicker(times, white, black, 0.02), *flicker(times, drifting, black, 0.02)):
            assert_sound(finding)


def test_too_few_frames_are_refused():
    times, white, black = levels(0)
    with pytest.raises(InputError, match="eight or more"):
        flicker(times[:5], white[:5], black, 0.02)


# Dithering


def series(
    seed: int, swing_codes: float = 0.0, period: int = 2, noise: float = NOISE, gain: float = 0.0
) -> Float:
    """(frames, rows, cols) of an even picture; pixels swing by that rms in codes, each with its own phase."""
    rng = np.random.default_rng(seed)
    phase = rng.integers(0, period, SHAPE)
    wave = np.sqrt(2) * np.cos(2 * np.pi * np.arange(period) / period + 0.3)
    wave = (wave - wave.mean()) / wave.std()
    number = np.arange(FRAMES)[:, None, None]
    grey = (
        100 * (1 + gain * rng.standard_normal((FRAMES, 1, 1)))
        + STEP * swing_codes * wave[(number + phase) % period]
    )
    return np.rint(grey + noise * rng.standard_normal((FRAMES, *SHAPE)))


@pytest.mark.parametrize("period", [2, 4, 8])
def test_temporal_dithering_far_below_the_noise_is_found_and_sized(period):
    sizes = []
    for seed in range(8):
        found = temporal_dithering(
            [series(seed), series(seed + 50, 0.5, period)], [124, 126], [STEP, STEP], LIT
        )
        assert_named(found, Fault.TEMPORAL_DITHERING, "switch off dithering")
        assert "code 126" in found.words
        sizes.append((found.size - 0.5) / found.sigma)
    assert np.sqrt(np.mean(np.square(sizes))) < 2  # 8 normal numbers: below 1.7 in 99 of 100


def test_noise_and_flicker_are_no_dithering():
    for seed in range(20):
        assert_sound(temporal_dithering([series(seed, gain=0.02)], [126], [STEP], LIT))


def fine(
    seed: int, pattern_codes: float, codes: tuple[int, ...] = (120, 126)
) -> tuple[list[Float], Float, Float]:
    """Halves of uniform pictures, white and black; the last code has a pattern of that rms, grey codes."""
    rng = np.random.default_rng(seed)
    gain = 1 + 0.03 * rng.standard_normal(SHAPE)
    shade = np.linspace(0.7, 1.0, SHAPE[1]) * gain
    checker = np.where(np.add.outer(np.arange(SHAPE[0]), np.arange(SHAPE[1])) % 2, 1.0, -1.0)

    def pair(light: float, pattern: float = 0.0) -> Float:
        mean = 5 + light * shade * np.linspace(1.0, 1.02, SHAPE[0])[:, None] + STEP * pattern * checker
        return mean + NOISE / 4 * rng.standard_normal((2, *SHAPE))

    halves = [pair(90.0, pattern_codes if code == codes[-1] else 0.0) for code in codes]
    return halves, pair(200.0), pair(0.0)


def test_spatial_dithering_is_found_among_pixels_of_unequal_gain():
    errors = []
    for seed in range(10):
        halves, white, black = fine(seed, 0.6)
        found = spatial_dithering(halves, [120, 126], [STEP, STEP], white, black, LIT)
        assert_named(found, Fault.SPATIAL_DITHERING, "switch off dithering")
        assert "code 126" in found.words
        errors.append(found.size - 0.6)
    # a mean over 5 x 5 takes 1/25 of a checkerboard with it
    assert np.abs(np.mean(errors)) < 0.03


def test_pixels_of_unequal_gain_and_shading_are_no_dithering():
    for seed in range(20):
        halves, white, black = fine(seed, 0.0)
        assert_sound(spatial_dithering(halves, [120, 126], [STEP, STEP], white, black, LIT))


# Steps


def step(seed: int, overshoot: float, tau_s: float = 0.003, noise: float = 0.002) -> tuple[Float, Float]:
    """Frames of 8 ms that follow a step; regions one after another in 16 ms, overshooting for a refresh."""
    rng = np.random.default_rng(seed)
    starts = np.concatenate([rng.uniform(0, 0.0167) + np.arange(24) / 60 for _ in range(3)])
    fine_s = np.linspace(0, 0.008, 33)
    time = starts[:, None, None] + fine_s - np.linspace(0, 0.016, 4)[None, :, None]
    light = np.where(time > 0, 1 - np.exp(-np.maximum(time, 0) / tau_s), 0)
    light += overshoot * ((time > 0.004) & (time < 0.004 + 1 / 60))
    return starts + 0.004, light.mean(axis=-1) + noise * rng.standard_normal((len(starts), 4))


def test_overdrive_is_found_and_sized():
    for seed in range(10):
        found = step_response(*step(seed, 0.15), "from code 64 to 192")
        assert_named(found.overdrive, Fault.OVERDRIVE, "switch off overdrive")
        assert "from code 64 to 192" in found.overdrive.words
        # exposures at three phases take a mean of the overshoot and of the rise's tail: 0.15 is seen in part
        # only, but some exposure of 8 ms lies within the 16.7 ms that overshoot; noise adds 2.5 sigma at most
        assert 0.11 < found.overdrive.size < 0.155


def test_a_slow_rise_is_no_overdrive():
    for seed in range(20):
        found = step_response(*step(seed, 0.0, tau_s=0.006), "")
        assert_sound(found.overdrive)
        # last region at 16 ms, 5 time constants to 0.7 %, a frame's length either way
        assert 0.02 < found.settled_s < 0.075
        # the first region moves at once: what is waited for is twice the rise, and no delay before it twice
        assert found.began_s < 0.012
        assert found.settled_s < found.stands_s <= 2 * found.settled_s


def test_a_delay_is_waited_for_once_and_the_rise_twice():
    for seed in range(10):
        times, light = step(seed, 0.0, tau_s=0.006)
        at_once = step_response(times, light, "")
        before = np.arange(0.004, 0.1, 0.0055)
        still = np.zeros((len(before), light.shape[1]))
        late = step_response(np.concatenate([before, times + 0.1]), np.concatenate([still, light]), "")
        assert late.settled_s == pytest.approx(at_once.settled_s + 0.1)
        # the last frame before the light moves is 6 ms earlier at most
        assert late.stands_s < 0.1 + 2 * at_once.settled_s + 0.006


def test_light_that_never_settles_is_reported():
    times, light = step(0, 0.0)
    found = step_response(times, light + 0.3 * times[:, None], "")
    assert np.isnan(found.settled_s)
