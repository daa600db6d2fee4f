"""Every planted fault is named, survived where it can be, and never read as a wrong depth."""

import pytest

from benchmarks import fault_tour as faults

FAULTS = [
    "one frame dropped",
    "five frames dropped",
    "frame repeated",
    "frame late",
    "frame torn",
    "three frames torn",
    "stall of 1.5 s",
    "stall of 5 s",
    "camera lost, back after 1 s",
    "camera lost for good",
    "display lost",
    "light off for one frame",
    "light off for ten frames",
]


def test_every_fault_of_the_tour_is_tested():
    assert [fault.name for fault in faults.FAULTS if fault.keys] == FAULTS


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_behind_which_the_press_jumps(name):
    fault = next(fault for fault in faults.FAULTS if fault.name == name)
    # enough to lock again after ten dark frames, after a single one
    outcome = faults.tour(fault, moving=fault.recovers, frames_after=24 if "ten" in name else 16)
    assert outcome.named, outcome.events
    assert outcome.recovered, outcome.end
    assert outcome.good_readings > 5
    assert abs(outcome.worst_good_percent) < faults.WITHIN_PERCENT
