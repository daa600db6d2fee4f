"""When a press counts as pressed, still and lifted."""

import numpy as np
import pytest

from zeromethod import Warp, open_devices
from zeromethod.commissioning.calibration.presses import (
    Awaited,
    PressesEndedError,
    PressWatch,
    record_presses,
)

from .planted import Hand, nominal

SHAPE = (20, 24)
NOISE_PX = 0.02


def warp(rng: np.random.Generator, dent_px: float = 0.0, lost: bool = False) -> Warp:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    bump = np.exp(-((u - 12) ** 2 + (v - 10) ** 2) / 18)
    q = np.stack([8 * u + dent_px * (u - 12) / 3 * bump, 8 * v], axis=-1)
    flags = np.zeros(SHAPE, np.uint16)
    if lost:
        flags[10, 12] = 8
    return Warp(q + NOISE_PX * rng.standard_normal(q.shape), np.full(q.shape, NOISE_PX), flags, 0)


def test_rest_is_the_mean_of_the_first_frames():
    rng = np.random.default_rng(1)
    watch = PressWatch(16)
    changes = [watch.take(warp(rng)) for _ in range(16)]
    assert changes == [False] * 15 + [True]
    assert watch.phase is Awaited.COMING
    np.testing.assert_allclose(watch.rest.sigma, NOISE_PX / 4)
    # five of the mean's sigmas
    np.testing.assert_allclose(watch.rest.q, warp(rng).q, atol=5 * NOISE_PX * 1.1)


def rested(rng: np.random.Generator) -> PressWatch:
    """A watch that has its mean of the mirror at rest."""
    watch = PressWatch(8)
    for _ in range(8):
        watch.take(warp(rng))
    return watch


def test_noise_alone_is_no_press():
    rng = np.random.default_rng(2)
    watch = rested(rng)
    for _ in range(192):
        watch.take(warp(rng))
    assert watch.phase is Awaited.COMING


def test_press_is_taken_only_once_it_stands():
    rng = np.random.default_rng(3)
    watch = rested(rng)
    for dent in np.linspace(2.0, 12.0, 30):
        watch.take(warp(rng, dent))
    assert watch.phase is Awaited.SETTLING
    for _ in range(8):
        watch.take(warp(rng, 12.0))
    assert watch.phase is Awaited.LIFTING
    (taken,) = watch.pressed
    away = taken.q - warp(rng, 12.0).q
    # frames of the last of the way down are not in it: half a step of that would be 0.2 px
    assert np.abs(away.mean(axis=(0, 1))).max() < 0.02


def test_step_that_is_not_nulled_begins_the_row_again():
    rng = np.random.default_rng(4)
    watch = PressWatch(8)
    for number in range(15):
        watch.take(None if number == 7 else warp(rng))
    assert watch.phase is Awaited.REST
    watch.take(warp(rng))
    assert watch.phase is Awaited.COMING


def test_press_that_goes_before_it_was_taken_is_waited_for_again():
    rng = np.random.default_rng(5)
    watch = rested(rng)
    watch.take(warp(rng, 9.0))
    assert watch.phase is Awaited.SETTLING
    watch.take(warp(rng))
    assert watch.phase is Awaited.COMING
    assert not watch.pressed


def test_press_that_never_comes_is_named_and_rest_is_kept():
    rig = nominal()
    with (
        open_devices(rig) as devices,
        pytest.raises(PressesEndedError, match=r"no press 1 of 1 within 0.2 s") as ended,
    ):
        record_presses(rig, devices, (0.2,), frames=4, patience_s=0.2)
    assert ended.value.warps.pressed == ()
    assert not ended.value.interrupted


def test_ctrl_c_keeps_the_presses_before_it():
    rig = nominal()

    class Impatient(Hand):
        def say(self, words: str) -> None:
            super().say(words)
            if "press 1 of 2: taken" in words:
                raise KeyboardInterrupt

    with open_devices(rig) as devices:
        hand = Impatient(devices, (0.15,), ((40.0, 0.0),))
        with pytest.raises(PressesEndedError) as ended:
            record_presses(rig, devices, (0.15, 0.1), frames=6, patience_s=3.0, prompts=hand)
    assert ended.value.interrupted
    assert len(ended.value.warps.pressed) == 1
