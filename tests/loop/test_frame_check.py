from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from zeromethod.devices.protocols import Frame
from zeromethod.loop.events import Event
from zeromethod.loop.frame_check import FrameCheck
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import CameraSpec, Noise

CAMERA = binned(load_rig("simulated"), 8).camera
SHAPE = (CAMERA.rows, CAMERA.columns)
MS = 1_000_000
RNG = np.random.default_rng(0)

LATER_NS = 10**9
"""When the frames come to hand, where their age does not matter."""


def image() -> np.ndarray:
    return np.clip(RNG.normal(100, 2, SHAPE), 0, 255).astype(np.uint8)


def frame(number: int, pixels: np.ndarray | None = None, **changes: int) -> Frame:
    values = {"time_ns": 17 * MS * number, "exposure_ns": 8 * MS, "dropped": 0} | changes
    return Frame(image() if pixels is None else pixels, number=number, **values)


def fresh(camera: CameraSpec = CAMERA) -> FrameCheck:
    check = FrameCheck(camera)
    assert check.look_at(frame(0), 10 * MS).events == ()
    return check


def test_good_frames_pass_without_events() -> None:
    check = fresh()
    for number in range(1, 20):
        assert check.look_at(frame(number), 17 * MS * number + 10 * MS).events == ()


@pytest.mark.parametrize(
    "pixels",
    [image()[:-1], image().astype(np.uint16), image().astype(float), image()[..., None]],
)
def test_a_frame_of_wrong_shape_or_type_breaks_the_contract(pixels: np.ndarray) -> None:
    verdict = fresh().look_at(frame(1, pixels), LATER_NS)
    assert verdict.wrong
    assert verdict.events == (Event.FRAME_WRONG,)
    assert str(SHAPE) in verdict.refusal.words


def test_more_than_8_bits_come_as_uint16() -> None:
    check = FrameCheck(CAMERA.model_copy(update={"bits": 12}))
    assert check.look_at(frame(0, image().astype(np.uint16)), LATER_NS).refusal is None
    assert check.look_at(frame(1), LATER_NS).wrong


def test_an_exposure_must_last() -> None:
    assert fresh().look_at(frame(1, exposure_ns=0), LATER_NS).wrong


def test_an_identical_image_is_a_repeat_whatever_its_number() -> None:
    check, pixels = fresh(), image()
    assert check.look_at(frame(1, pixels), 27 * MS).refusal is None
    assert check.look_at(frame(2, pixels.copy()), 44 * MS).events == (Event.FRAME_REPEATED,)
    assert check.look_at(frame(3), 61 * MS).refusal is None


def test_a_part_left_from_the_frame_before_is_a_tear() -> None:
    check, old, new = fresh(), image(), image()
    check.look_at(frame(1, old), 27 * MS)
    new[SHAPE[0] // 2 :] = old[SHAPE[0] // 2 :]
    verdict = check.look_at(frame(2, new), 44 * MS)
    assert verdict.events == (Event.FRAME_TORN,)
    assert "50 %" in verdict.refusal.words
    assert check.look_at(frame(3), 61 * MS).refusal is None


def test_a_camera_without_noise_may_give_equal_images() -> None:
    check, pixels = fresh(CAMERA.model_copy(update={"noise": Noise()})), image()
    for number in (1, 2):
        assert check.look_at(frame(number, pixels), LATER_NS).refusal is None


def test_dark_rows_that_are_all_zero_prove_nothing() -> None:
    check, dark = fresh(), np.zeros(SHAPE, np.uint8)
    for number in (1, 2, 3):
        assert check.look_at(frame(number, dark), LATER_NS).refusal is None


@pytest.mark.parametrize("changes", [{"number": 4}, {"number": 5}, {"number": 6, "time_ns": 80 * MS}])
def test_number_and_time_must_rise(changes: dict[str, int]) -> None:
    check = fresh()
    check.look_at(frame(5), LATER_NS)
    verdict = check.look_at(
        Frame(image(), changes.get("time_ns", 200 * MS), 8 * MS, changes["number"]), LATER_NS
    )
    assert verdict.events == (Event.FRAME_DISORDERED,)
    assert not verdict.wrong


def test_dropped_frames_are_named_and_do_no_harm() -> None:
    verdict = fresh().look_at(frame(4, dropped=3), 4 * 17 * MS + 10 * MS)
    assert (verdict.events, verdict.refusal) == ((Event.FRAMES_DROPPED,), None)


def test_a_late_frame_is_named_and_used() -> None:
    check = fresh()
    verdict = check.look_at(frame(1), 17 * MS + 10 * MS + 50 * MS)
    assert (verdict.events, verdict.refusal) == ((Event.FRAME_LATE,), None)


def test_a_reopened_camera_may_count_from_the_start() -> None:
    check = fresh()
    check.look_at(frame(100), 100 * LATER_NS)
    check.restart()
    assert check.look_at(frame(0), LATER_NS).refusal is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time_ns": 2 * LATER_NS}, "past the present"),
        ({"time_ns": float("nan")}, "past the present"),
        ({"dropped": -5}, "-5 frames were dropped"),
        ({"exposure_ns": 0}, "exposure is 0"),
    ],
)
def test_numbers_that_no_camera_may_give_are_wrong(change: dict[str, Any], words: str) -> None:
    verdict = fresh().look_at(replace(frame(1, image()), **change), LATER_NS)
    assert verdict.wrong
    assert words in verdict.refusal.words
