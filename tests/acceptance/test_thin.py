"""A saw's teeth under one mirror: a press that opens all seams from one frame to the next."""

from benchmarks.honesty import PRESS_AT, bench_by_name, deviation, pressed
from zeromethod import Session
from zeromethod.devices.opening import open_devices
from zeromethod.loop.state import State
from zeromethod.simulation.loads import load


def test_a_sudden_wide_pad_is_nulled_and_read_within_its_sigma():
    depth_mm = 0.3
    rig = bench_by_name("thin").replace({"camera.rows": 320, "camera.centre_px": (255.5, 159.5)})
    dent = load(49.0, 6.0, depth_mm, 10.0, rig.rubber)
    with open_devices(rig) as devices:
        camera = devices.camera
        camera.scenario = pressed(rig, [dent])
        with Session(rig, devices=devices) as session:
            steps = [step for step in session.run(frames=PRESS_AT + 40) if step.state is State.LOCKED]
            found = [deviation(step, camera.truth(step.time_ns)) for step in steps]
    assert len(steps) > 5
    # each tooth is seen whole periods off before its seams are joined; a wrong period is 20 % of the depth
    assert max(ratio for *_, ratio in found) < 3.0
    # nothing in the view is at rest: when it is learned what presses, that leaves some percent open
    assert max(sigma for _, sigma, _ in found[-5:]) < 0.07 * depth_mm
