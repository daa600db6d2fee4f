"""The loop's stability margin at a delay."""

import math

import numpy as np
import pytest

from zeromethod.control.stability_margin import stability_margin
from zeromethod.rig.model import ControlSpec


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 6])
def test_integrators_largest_gain_is_the_closed_form(frames):
    control = ControlSpec(controller="integrator", gain=0.3, leak=0.0)
    margin = stability_margin(control, frames)
    expected = 2 * math.sin(math.pi / (4 * frames - 2))
    # gains are halved down to 4e-12; a double root on the circle costs half the digits of that
    assert margin.largest_gain == pytest.approx(expected, abs=1e-5)
    assert margin.margin == pytest.approx(expected / 0.3, abs=1e-4)


@pytest.mark.parametrize("frames", [1.0, 1.5, 2.3, 3.0])
def test_margin_parts_runs_that_settle_from_runs_that_diverge(frames):
    control = ControlSpec(controller="integrator", gain=0.3, leak=0.01)
    largest = stability_margin(control, frames).largest_gain
    whole = int(frames)
    part = frames - whole

    def last(gain: float) -> float:
        c = np.zeros(2000)
        for n in range(5, len(c)):
            shown = (1 - part) * c[n - whole] + part * c[n - whole - 1]
            c[n] = 0.99 * (c[n - 1] + gain * (1 - shown))
        return float(np.ptp(c[-50:]))

    assert last(0.97 * largest) < 1e-3
    assert last(1.03 * largest) > 1.0


def test_composition_is_stable_at_gain_1_whatever_the_delay():
    for frames in (0.0, 1.0, 2.7, 5.0, 9.5):
        margin = stability_margin(ControlSpec(gain=1.0), frames)
        assert margin.margin > 1.0
        # 1 - K and 0.9 K of the mode that is seen least: below 1 up to K = 2 / 1.9 at the least
        assert margin.largest_gain >= 2 / 1.9 - 1e-6


def test_longer_delay_never_allows_more_gain_to_the_integrator():
    control = ControlSpec(controller="integrator", gain=0.3)
    gains = [stability_margin(control, frames).largest_gain for frames in np.arange(1, 5, 0.25)]
    assert (np.diff(gains) <= 1e-9).all()
