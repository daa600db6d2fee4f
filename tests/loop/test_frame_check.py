from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from zeromethod import Event, binned, load_rig
from zeromethod.devices.protocols import Frame
from zeromethod.loop.frame_check import SEAM_FRAMES, FrameCheck
from zeromethod.rig.model import CameraSpec, Noise

CAMERA = binned(load_rig("simulated"), 8).camera
SHAPE = (CAMERA.rows, CAMERA.columns)
MS = 1_000_000
RNG = np.random.default_rng(0)

LATER_NS = 10**9
"""When the frames come to hand, where their age does not matter."""


def image() -> np.ndarray:
    return np.clip(RNG.normal(100, 2, SHAPE), 0, 255).astype(np.uint8)


def frame(number: int, pixels: np.ndarray | None = None, **changes: Any) -> Frame:
    values = {"time_ns": 17 * MS * number, "exposure_ns": 8 * MS, "dropped": 0, "number": number} | changes
    return Frame(image() if pixels is None else pixels, **values)


def fresh(camera: CameraSpec = CAMERA) -> FrameCheck:
    check = FrameCheck(camera)
    assert check.look_at(check.timed(frame(0)), 10 * MS).events == ()
    return check


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"image": image()[:-1]}, str(SHAPE)),
        ({"image": image().astype(np.uint16)}, str(SHAPE)),
        ({"image": image().astype(float)}, str(SHAPE)),
        ({"image": image()[..., None]}, str(SHAPE)),
        ({"time_ns": 2 * LATER_NS}, "past the present"),
        ({"time_ns": float("nan")}, "time_ns is nan, not a whole number"),
        ({"time_ns": -5}, "before the clock's beginning"),
        ({"number": float("nan")}, "number is nan, not a whole number"),
        ({"number": 2**63}, "number is beyond 64 bits"),
        ({"number": -1}, "number is -1, below 0"),
        ({"dropped": 2**31}, "dropped is beyond 32 bits"),
        ({"exposure_ns": 10**5000}, "exposure_ns is beyond 64 bits"),
        ({"exposure_ns": 1000 * 10**9}, "no two may overlap"),
        ({"dropped": -5}, "-5 frames were dropped"),
        ({"exposure_ns": 0}, "exposure is 0"),
        ({"image": None}, "NoneType"),
        ({"time_ns": None}, "time_ns is None, not a number"),
        ({"number": "7"}, "number is '7', not a number"),
        ({"exposure_ns": "short"}, "exposure_ns is 'short', not a number"),
        ({"dropped": None}, "dropped is None, not a number"),
    ],
)
def test_frames_that_no_camera_may_give_break_the_contract(change, words):
    check = fresh()
    verdict = check.look_at(check.timed(replace(frame(1), **change)), LATER_NS)
    assert verdict.wrong
    assert verdict.events == (Event.FRAME_WRONG,)
    assert words in verdict.refusal.words


def test_more_than_8_bits_come_as_uint16():
    check = FrameCheck(CAMERA.model_copy(update={"bits": 12}))
    assert check.look_at(frame(0, image().astype(np.uint16)), LATER_NS).refusal is None
    assert check.look_at(frame(1), LATER_NS).wrong


def test_an_identical_image_is_a_repeat_whatever_its_number():
    check, pixels = fresh(), image()
    assert check.look_at(frame(1, pixels), 27 * MS).refusal is None
    assert check.look_at(frame(2, pixels.copy()), 44 * MS).events == (Event.FRAME_REPEATED,)
    assert check.look_at(frame(3), 61 * MS).refusal is None


def test_a_part_left_from_the_frame_before_is_a_tear():
    check, old, new = fresh(), image(), image()
    check.look_at(frame(1, old), 27 * MS)
    new[SHAPE[0] // 2 :] = old[SHAPE[0] // 2 :]
    verdict = check.look_at(frame(2, new), 44 * MS)
    assert verdict.events == (Event.FRAME_TORN,)
    assert "50 %" in verdict.refusal.words
    assert check.look_at(frame(3), 61 * MS).refusal is None


def carrier(shift_px: float = 0.0) -> np.ndarray:
    """What a camera sees of the target, displaced."""
    v, u = np.indices(SHAPE)
    light = 100 + 40 * np.cos(np.pi / 8 * (u + shift_px)) + 40 * np.cos(np.pi / 8 * v)
    return np.clip(light + RNG.normal(0, 2, SHAPE), 0, 255).astype(np.uint8)


def torn_once() -> FrameCheck:
    check, old, new, half = fresh(), carrier(), carrier(), SHAPE[0] // 2
    check.look_at(frame(1, old), 27 * MS)
    new[half:] = old[half:]
    assert check.look_at(frame(2, new), 44 * MS).events == (Event.FRAME_TORN,)
    return check


@pytest.mark.parametrize("shift_px", [-2.0, 0.5, 7.0])
def test_a_missing_half_that_comes_with_the_next_frame_is_a_tear_too(shift_px):
    check, later = torn_once(), carrier(shift_px)
    later[SHAPE[0] // 2 :] = carrier()[SHAPE[0] // 2 :]
    verdict = check.look_at(frame(3, later), 61 * MS)
    assert verdict.events == (Event.FRAME_TORN,)
    assert "two frames meet" in verdict.refusal.words
    assert check.look_at(frame(4, carrier(shift_px)), 78 * MS).refusal is None


def test_whole_frames_after_a_tear_are_used():
    check = torn_once()
    for number in range(3, 203):
        shift_px = 0.05 * number
        assert check.look_at(frame(number, carrier(shift_px)), LATER_NS * number).refusal is None


def test_an_edge_where_a_frame_was_torn_stops_a_few_frames_only():
    check, refused = torn_once(), 0
    for number in range(3, 20):
        pixels = carrier()
        pixels[SHAPE[0] // 2 :, : SHAPE[1] // 4] = 20  # a contact
        refused += check.look_at(frame(number, pixels), LATER_NS * number).refusal is not None
    assert refused == SEAM_FRAMES


@pytest.mark.parametrize(
    ("camera", "pixels"),
    [(CAMERA.model_copy(update={"noise": Noise()}), image()), (CAMERA, np.zeros(SHAPE, np.uint8))],
    ids=["a camera without noise", "no light"],
)
def test_equal_images_that_prove_nothing_are_used(camera, pixels):
    check = fresh(camera)
    for number in (1, 2, 3):
        assert check.look_at(frame(number, pixels), LATER_NS).refusal is None


@pytest.mark.parametrize("number_and_time", [(4, 200 * MS), (5, 200 * MS), (6, 80 * MS)])
def test_number_and_time_must_rise(number_and_time):
    check = fresh()
    check.look_at(frame(5), LATER_NS)
    number, time_ns = number_and_time
    verdict = check.look_at(frame(number, time_ns=time_ns), LATER_NS)
    assert verdict.events == (Event.FRAME_DISORDERED,)
    assert not verdict.wrong


@pytest.mark.parametrize("count", [lambda _: 7, lambda k: 9 - k % 2, lambda k: 1000 - k])
def test_a_count_that_never_rises_is_a_fault_and_none_to_be_followed(count):
    check = fresh()
    events = [check.look_at(replace(frame(k), number=count(k)), LATER_NS).events for k in range(1, 20)]
    assert events[-10:] == [(Event.FRAME_WRONG,)] * 10


@pytest.mark.parametrize(
    ("given", "age_ms", "events"),
    [
        (frame(1), 10, ()),
        (frame(4, dropped=3), 10, (Event.FRAMES_DROPPED,)),
        (frame(1), 60, (Event.FRAME_LATE,)),
    ],
)
def test_good_frames_pass_dropped_and_late_ones_are_named(given, age_ms, events):
    check = fresh()
    verdict = check.look_at(given, given.time_ns + age_ms * MS)
    assert (verdict.events, verdict.refusal) == (events, None)
    for number in range(5, 20):
        assert check.look_at(frame(number), 17 * MS * number + 10 * MS).events == ()


def test_a_reopened_camera_may_count_from_the_start():
    check = fresh()
    check.look_at(frame(100), 100 * LATER_NS)
    check.restart()
    assert check.look_at(frame(0), LATER_NS).refusal is None
