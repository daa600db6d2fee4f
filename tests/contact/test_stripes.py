"""Stripes in a contact's image: pitch, direction and contrast as planted."""

import numpy as np
import pytest
from planted_contact import planted

from zeromethod.contact import stripes

NOISE = 0.03


def wave(pitch_mm, angle_deg, dark, bright, seed=0):
    angle = np.radians(angle_deg)

    def light(x, y):
        phase = (np.cos(angle) * x + np.sin(angle) * y) / pitch_mm % 1
        noise = NOISE * np.random.default_rng(seed).standard_normal(x.shape)
        return np.where(phase < 0.5, dark, bright) + noise

    return light


@pytest.mark.parametrize("pitch_mm", [0.2, 0.45, 1.0])
@pytest.mark.parametrize("angle_deg", [0.0, 33.0, 90.0, 151.0])
def test_pitch_direction_and_contrast_are_the_planted_ones(pitch_mm, angle_deg):
    found = stripes(planted(wave(pitch_mm, angle_deg, 0.1, 0.9)))
    # of sharp stripes sampled at 0.03 mm over 4 mm
    assert found.pitch_mm == pytest.approx(pitch_mm, rel=0.003)
    off = (found.angle_deg - angle_deg + 90) % 180 - 90
    assert abs(off) < 0.3
    # the phases' bins are a sixteenth wide: of pitches of seven pixels none is sharp
    assert found.contrast == pytest.approx(0.8, abs=0.03)


def test_brightness_of_what_lies_between_does_not_move_the_pitch():
    """The lamp's image in the rubber between bars drifts from one edge of the gaps to the other."""

    def light(x, y):
        phase = (x - 40) / 0.5
        lamp = np.exp(-((phase % 1 - 0.75 - 0.05 * (x - 40)) ** 2) / (2 * 0.06**2))
        return np.where(phase % 1 < 0.5, 0.1, 0.5 + 1.2 * lamp)

    assert stripes(planted(light)).pitch_mm == pytest.approx(0.5, rel=0.003)


def test_what_has_no_image_or_too_few_pixels_has_no_stripes():
    assert stripes(planted(wave(0.1, 0.0, 0.1, 0.9), radius_mm=0.1)) is None
