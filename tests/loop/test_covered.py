"""An object that hides most of the mirror: a state of its own, no depth inside, back soon after."""

import numpy as np
import pytest
from small_rigs import SMALL_LCD, quarter

from zeromethod import Session
from zeromethod.loop.state import State
from zeromethod.resources import resource


@pytest.mark.parametrize("albedo", ["black", "white"])
def test_covered_is_said_within_three_frames_and_over_ten_after(albedo, tmp_path):
    text = resource("calibration", "presses", "covered.toml").read_text().replace("grey", albedo)
    for old, new in (("0.30", "0.20"), ("0.35", "0.20"), ("1.10", "0.40"), ("1.15", "0.40")):
        text = text.replace(f"time_s = {old}", f"time_s = {new}")
    press = tmp_path / "covered.toml"
    press.write_text(text)
    rig = quarter(display=SMALL_LCD, scenario=str(press))
    states, good_inside = [], 0
    with Session(rig) as session:
        for step in session.run(seconds=0.63):
            mirror = session.result.true_mirror(step.time_ns)
            states.append((bool(mirror.touches), step.state))
            if mirror.touches and step.surface is not None:
                # where the object truly touches, by a node's spacing, which is 1.6 mm here
                (touch,) = mirror.touches
                away = np.hypot(step.surface.x_mm - touch.x_mm, step.surface.y_mm - touch.y_mm)
                good_inside += np.count_nonzero(step.surface.valid & (away < 27.0 - 3.3))
    touched = [k for k, (touches, _) in enumerate(states) if touches]
    assert states[touched[0] + 2][1] is State.COVERED
    assert all(state is State.COVERED for _, state in states[touched[0] + 2 : touched[-1]])
    assert good_inside == 0
    assert State.RESTING in {state for _, state in states[touched[-1] : touched[-1] + 11]}
