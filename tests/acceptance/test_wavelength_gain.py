"""The peak of the narrowest dent that the nodes resolve comes back whole from the loop."""

import pytest

from benchmarks import wavelength_gain as gain
from zeromethod.rig.load import load_rig


def test_the_loop_has_gain_one_for_the_narrowest():
    read = gain.gain_at(gain.Bench(load_rig("simulated")), 4, frames=4)
    assert read.locked_frames == 4
    assert read.loop == pytest.approx(1.0, abs=gain.WITHIN)
