"""What touches as an image, on the simulated bench: bars and ridges as planted, and none after lift."""

import numpy as np
import pytest

from zeromethod import Session, load_rig
from zeromethod.contact import stripes
from zeromethod.resources import resource

VIEW = {"camera.columns": 480, "camera.rows": 384, "camera.centre_px": [239.5, 191.5]}
"""The packaged bench's pixels, fewer of them."""
TOUCH_S, HELD_S, LIFT_S = 0.2, 0.25, 0.65
PITCH_MM = {"bars": 0.5, "finger": 0.45}


@pytest.fixture(scope="module", params=["bars", "finger"])
def run(request, tmp_path_factory):
    """(name, steps that were read while it is held, steps from lift on, those before), each with the lamp."""
    text = resource("calibration", "presses", f"{request.param}.toml").read_text().partition("[[phase]]")[0]
    for old, new in (("0.30", TOUCH_S), ("0.35", HELD_S), ("1.10", LIFT_S), ("1.15", LIFT_S)):
        text = text.replace(f"time_s = {old}", f"time_s = {new}")
    path = tmp_path_factory.mktemp("press") / "press.toml"
    path.write_text(text)
    rig = load_rig("simulated").replace({**VIEW, "camera.pupil_mm": 1.25}, scenario=str(path))
    with Session(rig) as session:
        steps = [(step, session.loop._screen.lamp is not None) for step in session.run(seconds=0.9)]
    # an exposure begins 4 ms before its middle
    before = [one for one in steps if one[0].time_ns * 1e-9 < TOUCH_S - 0.005]
    held = [
        one for one in steps if one[0].surface and HELD_S + 0.005 < one[0].time_ns * 1e-9 < LIFT_S - 0.005
    ]
    return request.param, before, held, [one for one in steps if one[0].time_ns * 1e-9 > LIFT_S + 0.005]


def test_ridges_of_one_object_are_one_contact_in_every_frame_while_the_lamp_is_lit(run):
    _, before, held, _ = run
    assert not any(step.contacts or lit for step, lit in before)
    counts = [[contact.id for contact in step.contacts] for step, _ in held]
    assert counts[2:] == [[1]] * (len(held) - 2)
    assert len(held) > 5
    assert all(lit for _, lit in held[4:])


def test_the_pitch_in_the_image_is_the_planted_one(run):
    name, _, held, _ = run
    found = [stripes(step.contacts[0]) for step, _ in held[-3:]]
    angle = {"bars": 30.0, "finger": 20.0}[name]
    for one in found:
        assert one.pitch_mm == pytest.approx(PITCH_MM[name], rel=0.02)
        assert one.angle_deg == pytest.approx(angle, abs=1.0)
    # a finger's ridges, in exposures that show two pictures: 0.3 to 0.53, as the lamp's border is redrawn
    contrasts = [stripes(step.contacts[0]).contrast for step, lit in held if lit]
    if name == "bars":
        assert all(one.contrast > 0.5 for one in found)
    else:
        assert np.median(contrasts) > 0.4


def test_the_object_is_as_bright_as_it_scatters_and_the_image_as_fine_as_the_camera(run):
    name, _, held, _ = run
    contact = held[-1][0].contacts[0]
    # the mean over all of the panel is the picture's within what its code rounds, and the lamp adds to it
    white = np.cos(np.radians(50)) / 1.41**2
    assert contact.scattered == pytest.approx({"bars": 0.2, "finger": 0.8}[name] * white, rel=0.15)
    assert contact.image.mm_per_px == pytest.approx(0.033, abs=0.002)


def test_contact_and_lamp_are_gone_within_a_few_frames_of_lifting(run):
    _, before, _, lifted = run
    gone = next(k for k, (step, lit) in enumerate(lifted) if not step.contacts and not lit)
    assert gone <= 5
    assert not any(step.contacts or lit for step, lit in lifted[gone:])
    # nodes that flickered beside the contact count again after eight good frames
    assert lifted[-1][0].valid_share > 0.995 * before[-1][0].valid_share
