"""Contacts of many narrow parts are one; pictures, however fine or stretched, are none."""

import numpy as np
import pytest

from zeromethod.contact.parts import closed_over, narrow_parts

PERIOD, NOISE = 16, 0.03
V, U = np.mgrid[:160, :200].astype(float)
EVERYWHERE = np.ones(V.shape, bool)
DISC = np.hypot(U - 100, V - 80) < 45


def noisy(light):
    return (light + NOISE * np.random.default_rng(3).standard_normal(light.shape)).astype(np.float32)


def picture(u=U, v=V):
    return 1 + 0.45 * (np.cos(2 * np.pi * u / PERIOD) + np.cos(2 * np.pi * v / PERIOD))


def bars(pitch_px, share, object_light):
    touching = DISC & ((U + 0.4 * V) / pitch_px % 1 < share)
    return noisy(np.where(touching, object_light, picture()))


@pytest.mark.parametrize("object_light", [0.02, 0.07, 0.26])
@pytest.mark.parametrize(("pitch_px", "share"), [(9, 0.4), (9, 0.7), (12, 0.5)])
def test_parts_narrower_than_a_period_are_found_with_their_light(object_light, pitch_px, share):
    found = narrow_parts(bars(pitch_px, share, object_light), NOISE, EVERYWHERE, PERIOD)
    assert found.light == pytest.approx(object_light, abs=0.02)
    # means over a period's square, so half of one is open
    assert found.where[np.hypot(U - 100, V - 80) < 45 - PERIOD].all()
    assert not found.where[np.hypot(U - 100, V - 80) > 45 + PERIOD].any()


STRETCHED = {
    "in the null": picture(),
    "stretched": picture(U / 6, V),
    "stretched both ways": picture(U / 4, V / 4),
    "too fine": 1 + 0.02 * (picture(3 * U, 3 * V) - 1),
    "radial": picture(16 * np.arctan2(V - 80, U - 100), np.hypot(U - 100, V - 80)),
    "half gone": 0.5 * picture(U / 3, V),
}


@pytest.mark.parametrize("name", STRETCHED)
def test_a_picture_is_no_contact_of_parts(name):
    assert narrow_parts(noisy(STRETCHED[name]), NOISE, EVERYWHERE, PERIOD) is None


def test_gaps_of_less_than_a_period_are_closed_and_wider_ones_stay():
    mask = np.zeros((40, 120), bool)
    mask[5:35, :40] = mask[5:35, 52:80] = mask[5:35, 100:] = True
    closed = closed_over(mask, PERIOD)
    assert closed[20, 40:52].all()
    assert not closed[20, 82:98].any()
