"""Every planted fault is named, survived where it can be, and never read as a wrong depth."""

import pytest

from benchmarks import fault_tour as faults

STATES = {
    "frame repeated": "holding",
    "frame torn": "holding",
    "stall of 1.5 s": "holding",
    "camera lost, back after 1 s": "fault",
    "display lost": "fault",
    "light off for one frame": "lost",
}
"""What a fault makes of the state meanwhile, whatever else it brings."""


@pytest.mark.parametrize(
    "fault", [one for one in faults.FAULTS if one.keys], ids=[one.name for one in faults.FAULTS if one.keys]
)
def test_a_fault_behind_which_the_press_jumps(fault):
    # enough to lock again after ten dark frames, after a single one
    frames = 24 if "ten" in fault.name else 16
    outcome = faults.tour(fault, moving=fault.recovers, frames_after=frames)
    assert outcome.named, outcome.events
    assert STATES.get(fault.name, outcome.states[0]) in outcome.states
    assert outcome.recovered, outcome.end
    assert outcome.good_readings > 5
    assert abs(outcome.worst_good_percent) < faults.WITHIN_PERCENT
