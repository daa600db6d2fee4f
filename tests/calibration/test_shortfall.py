"""Whether a part of a calibration that failed spoils it."""

import pytest

from zeromethod.calibration.shortfall import Lack, Part, Shortfall


def test_a_loop_that_held_every_press_can_be_relied_on_though_its_delay_was_not_measured() -> None:
    unsteady = Shortfall(Part.DELAY, Lack.FAILED, "it is not steady")
    assert unsteady.fatal
    held = unsteady.after_presses()
    assert not held.fatal
    # still a finding: the verdict is never good with one
    assert held.words == "delay: failed, though the loop held every press: it is not steady"


@pytest.mark.parametrize("part", [part for part in Part if part is not Part.DELAY])
def test_what_never_spoils_a_calibration_is_called_what_it_was(part: Part) -> None:
    failed = Shortfall(part, Lack.FAILED, "why")
    assert failed.after_presses() == failed
