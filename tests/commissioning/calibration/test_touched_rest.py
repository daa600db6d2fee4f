"""A mirror that is touched while the fringes are shown is not called a second reflection, nor the reverse."""

from __future__ import annotations

import numpy as np
import pytest
from decoding.planted import PANEL, Bench

from zeromethod.commissioning.calibration.rest import rest_notes
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import measure_rest
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import choose_periods

SEQUENCE = FringeSequence(choose_periods(PANEL[0]), equal_shifts(6))
NOISE = NoiseModel.of_camera(2.0, 150.0, 4.0)


def notes(frames: np.ndarray, *, saw: bool = False) -> str:
    return "\n".join(rest_notes(measure_rest(frames, SEQUENCE, size_px=PANEL, noise=NOISE), saw=saw))


@pytest.mark.parametrize("first", [6, 12, 20])
@pytest.mark.parametrize("width_px", [8, 25, 60])
@pytest.mark.parametrize("slope_px", [1.6, 10.0, 64.0])
def test_a_dent_that_comes_between_the_fringes_is_called_one_that_moved(first, width_px, slope_px):
    before, after = Bench(), Bench()
    v, u = np.mgrid[:128, :160]
    across = (u - 80) / width_px
    after.lcd = before.lcd.copy()
    after.lcd[..., 0] += slope_px * across * np.exp(-0.5 * (across**2 + ((v - 64) / width_px) ** 2))
    pair = np.asarray(before.frames(SEQUENCE)), np.asarray(after.frames(SEQUENCE))
    late = np.arange(SEQUENCE.frames) >= first
    said = notes(np.where(late[:, None, None], pair[1], pair[0]))
    # named first; of a small dent a few pixels may still look like a reflection
    assert "while the fringes were shown" in said.splitlines()[0]


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("offset", [(37.0, -23.0), (8.0, 3.0), (-150.0, 211.0)])
def test_a_face_that_reflects_is_called_a_second_reflection(share, offset):
    bench = Bench(ghost=share * np.ones((128, 160)), ghost_offset=offset)
    said = notes(np.asarray(bench.frames(SEQUENCE)))
    assert "a second reflection of about" in said.splitlines()[0]
    assert "while the fringes were shown" not in said


def test_pixels_of_a_saw_that_see_two_teeth_at_a_tip_need_no_shield():
    tips = np.zeros((128, 160))
    tips[:, [30, 31, 32, 90, 91, 92]] = 0.1
    frames = np.asarray(Bench(ghost=tips, ghost_offset=(37.0, -23.0)).frames(SEQUENCE))
    assert "two teeth" in notes(frames, saw=True)
    assert "second reflection" not in notes(frames, saw=True)
    assert "second reflection" in notes(frames)
    # a face that reflects does so over more than a tip
    wide = np.asarray(Bench(ghost=0.1 * np.ones((128, 160)), ghost_offset=(37.0, -23.0)).frames(SEQUENCE))
    assert "two teeth" not in notes(wide, saw=True)
    assert "second reflection" in notes(wide, saw=True)
