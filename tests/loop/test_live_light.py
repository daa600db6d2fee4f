"""Light that is off, too bright, or beats: found where planted, and not found where there is none."""

import numpy as np
import pytest

from zeromethod.devices.protocols import Frame
from zeromethod.loop.events import Event
from zeromethod.loop.light_quality import (
    EVERY_FRAMES,
    FEWEST_FRAMES,
    FLICKER_FRAMES,
    LightQuality,
    LightWatch,
    beat,
)
from zeromethod.sensing.residual import Residual
from zeromethod.warp.validity import Flag

RATE_HZ = 60.0
SEEN = np.ones((6, 8), bool)
IMAGE = np.zeros((48, 64), np.uint8)
EXPOSURE_NS = 8_000_000


def frame_at(number: int, longer: int = 1) -> Frame:
    return Frame(IMAGE, round(1e9 * number / RATE_HZ), longer * EXPOSURE_NS, number)


def frames(count: int = FLICKER_FRAMES) -> np.ndarray:
    return np.arange(count) / RATE_HZ


def noise(count: int, size: float = 0.002) -> np.ndarray:
    return size * np.random.default_rng(3).standard_normal(count)


# from three cycles in the window to half the frame rate, where every other frame is brighter
@pytest.mark.parametrize("hz", [1.6, 3.0, 7.3, 17.0, 29.0, 30.0])
@pytest.mark.parametrize("size", [0.02, 0.2])
def test_a_planted_beat_is_found_with_its_frequency_and_size(hz, size):
    t = frames()
    # at half the frame rate a sine is sampled at its zeros, a cosine at its peaks
    light = 100 * (1 + size * np.cos(2 * np.pi * hz * t) + noise(len(t)))
    found_hz, found = beat(t, light)
    # frequencies are tried a quarter of a cycle in the window apart, the last one just above half the rate
    assert found_hz == pytest.approx(hz, abs=0.26 * RATE_HZ / (FLICKER_FRAMES - 1))
    # where every frame is a peak, the swing is that of a sine of the same rms, whose peaks are higher
    assert found == pytest.approx(size * (2**0.5 if hz == RATE_HZ / 2 else 1), rel=0.15)


def test_a_beat_is_found_across_gaps_and_on_top_of_drift():
    t = np.delete(frames(), [5, 6, 7, 40, 41, 77])
    light = 80 * (1 + 0.3 * t + 0.05 * np.sin(2 * np.pi * 5.2 * t))
    found_hz, found = beat(t, light)
    assert found_hz == pytest.approx(5.2, abs=0.2)
    # relative to the mean, which the drift has raised by 0.3 s of it
    assert found == pytest.approx(0.05 / (1 + 0.3 * t.mean()), rel=0.1)


QUIET = {
    "steady": np.zeros_like,
    "noise": lambda t: noise(len(t), 0.02),
    "drift": lambda t: -0.4 * t / t[-1],
    "warming up": lambda t: -0.3 * np.exp(-t / 0.5),
    "press and hold": lambda t: -0.1 * np.clip((t - 0.5) / 0.3, 0, 1),
    "press and release": lambda t: -0.1 * np.exp(-(((t - 1.0) / 0.3) ** 2)),
    "switched once": lambda t: 0.2 * (t > 0.7),
    "one dark frame": lambda t: -1.0 * (np.abs(t - 1.0) < 1e-6),
    "weak beat": lambda t: 0.005 * np.sin(2 * np.pi * 5 * t),
}


@pytest.mark.parametrize("kind", QUIET)
@pytest.mark.parametrize("count", [FEWEST_FRAMES, FLICKER_FRAMES])
def test_other_changes_of_the_light_are_not_called_a_beat(kind, count):
    t = frames(count)
    hz, size = beat(t, 100 * (1 + QUIET[kind](t) + noise(count, 1e-4)))
    assert size == 0
    assert np.isnan(hz)


@pytest.mark.parametrize(
    ("times", "light"),
    [
        (np.zeros(50), np.ones(50)),
        (np.arange(50.0), np.zeros(50)),
        (np.arange(50.0), np.ones(50)),
        (np.arange(3.0), np.array([1.0, 2.0, 1.0])),
    ],
)
def test_light_without_variation_has_no_beat(times, light):
    assert beat(times, light)[1] == 0


def residual(mean_grey: float, saturated: int = 0) -> Residual:
    flags = np.zeros(SEEN.shape, np.uint16)
    flags.ravel()[:saturated] = Flag.SATURATED
    d = np.zeros((*SEEN.shape, 2))
    return Residual(
        d, d, flags, np.ones_like(d, dtype=np.float32), np.full(SEEN.shape, mean_grey, np.float32)
    )


def test_a_beat_is_reported_once_enough_frames_show_it_until_it_is_gone():
    quality = LightQuality(SEEN, black_grey=4)
    said = []
    for k in range(4 * FLICKER_FRAMES):
        swing = 0.1 * np.sin(2 * np.pi * 4 * k / RATE_HZ) if k < 2 * FLICKER_FRAMES else 0.0
        frame = frame_at(k)
        said.append(quality.look(residual(4 + 90 * (1 + swing)), frame))
    first = next(k for k, one in enumerate(said) if one)
    assert FEWEST_FRAMES <= first + 1 <= FEWEST_FRAMES + EVERY_FRAMES
    assert {notice.event for one in said for notice in one} == {Event.FLICKER}
    assert said[2 * FLICKER_FRAMES - 1]
    assert not any(said[3 * FLICKER_FRAMES :])
    assert "4 Hz" in said[2 * FLICKER_FRAMES - 1][0].words


def test_light_that_follows_the_exposure_is_no_beat():
    """As of a camera that is exposed twice as long for every other 15 frames: 2 Hz."""
    quality = LightQuality(SEEN, black_grey=4)
    for k in range(2 * FLICKER_FRAMES):
        longer = 1 + (k // 15) % 2
        frame = frame_at(k, longer)
        assert not quality.look(residual(4 + 50 * longer), frame)


def test_saturation_is_reported_above_a_twentieth_of_the_view():
    quality = LightQuality(SEEN, black_grey=4)
    assert quality.look(residual(100, saturated=2), frame_at(0)) == []
    (notice,) = quality.look(residual(100, saturated=12), frame_at(1))
    assert notice.event is Event.SATURATED
    assert notice.words.startswith("25 % of the view is too bright")


def test_where_no_node_is_visible_nothing_is_reported():
    assert LightQuality(np.zeros_like(SEEN), 4).look(residual(100, saturated=48), frame_at(0)) == []


@pytest.mark.parametrize(
    ("black_grey", "levels", "off"),
    [
        (4, (100, 100, 5, 4, 98), [False, False, True, True, False]),
        (0, [100 * 0.99**k for k in range(300)], [False] * 300),  # slow change is followed
    ],
)
def test_light_that_goes_out_is_noticed_and_its_return_too(black_grey, levels, off):
    watch = LightWatch(SEEN, black_grey)
    assert [watch.is_off(np.full(SEEN.shape, level, np.float32)) for level in levels] == off


def test_what_covers_nearly_all_of_the_view_is_not_the_light():
    watch = LightWatch(SEEN, black_grey=4)
    touched = np.full(SEEN.shape, 100, np.float32)
    assert not watch.is_off(touched)
    touched[1:] = 5
    assert np.mean(touched[SEEN]) < 25
    assert not watch.is_off(touched)
    assert watch.is_off(np.full(SEEN.shape, 5, np.float32))


def test_a_touch_in_a_part_of_the_view_is_not_the_light():
    watch = LightWatch(SEEN, black_grey=4)
    touched = np.full(SEEN.shape, 100, np.float32)
    assert not watch.is_off(touched)
    touched[:4] = 4
    assert not watch.is_off(touched)
