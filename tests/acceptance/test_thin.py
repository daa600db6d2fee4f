"""A saw's teeth under one mirror: a press that opens all seams from one frame to the next."""

import numpy as np
import pytest

from benchmarks.honesty import PRESS_AT, bench_by_name, deviation, pressed
from zeromethod import Session
from zeromethod.devices.opening import open_devices
from zeromethod.loop.state import State
from zeromethod.simulation.loads import load


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "depth_mm", "sigma_mm"), [(49.0, 6.0, 0.3, 40.0), (44.0, 2.0, 0.21, 21.0)]
)
def test_a_sudden_wide_pad_is_nulled_and_read_within_its_sigma(x_mm, y_mm, depth_mm, sigma_mm):
    rig = bench_by_name("thin").replace({"camera.rows": 320, "camera.centre_px": (255.5, 159.5)})
    dent = load(x_mm, y_mm, depth_mm, sigma_mm / np.sqrt(2), rig.rubber)
    with open_devices(rig) as devices:
        camera = devices.camera
        camera.scenario = pressed(rig, [dent])
        with Session(rig, devices=devices) as session:
            steps = [step for step in session.run(frames=PRESS_AT + 25) if step.state is State.LOCKED]
            found = [deviation(step, camera.truth(step.time_ns)) for step in steps]
    assert len(steps) > 5
    # each tooth is seen whole periods off before its seams are joined; a wrong period is 20 % of the depth
    assert max(ratio for *_, ratio in found) < 3.0
    # nothing in the view is at rest: that leaves a percent open, and says so
    assert max(sigma for _, sigma, _ in found) < 0.03 * depth_mm
