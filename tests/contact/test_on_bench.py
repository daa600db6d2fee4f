"""Contacts on the simulated bench against its truth, from touch to lift."""

import numpy as np
import pytest
from small_rigs import HALF_LCD

from zeromethod import Session, binned, load_rig

VIEW = HALF_LCD | {
    "camera.columns": 320,
    "camera.rows": 256,
    "camera.centre_px": [159.5, 127.5],
    "camera.pupil_mm": 1.25,
}
"""Pixels twice as large as the packaged bench's, of the middle of its view: the object has room in it."""


@pytest.fixture(scope="module", params=["hertz", "punch"])
def run(request):
    rig = binned(load_rig("simulated"), 2).replace(VIEW, scenario=request.param)
    with Session(rig) as session:
        # from before the touch until it is settled
        return [(step, session.result.true_mirror(step.time_ns)) for step in session.run(seconds=0.5)]


def test_a_contact_is_named_within_two_frames_and_never_before_it_touches(run):
    steps = [step for step, _ in run]
    touched = [bool(mirror.touches) for _, mirror in run]
    first = touched.index(True)
    assert not any(step.contacts for step in steps[:first])
    named = next(k for k, step in enumerate(steps) if step.contacts)
    # an object that has come down by a fiftieth of its way touches less than a square millimetre
    assert named <= first + 3
    assert all([contact.id for contact in step.contacts] == [1] for step in steps[named:])


def test_area_place_and_border_are_the_planted_ones(run):
    step, mirror = run[-1]
    (contact,), (touch,) = step.contacts, mirror.touches
    assert contact.area_mm2 == pytest.approx(touch.area_mm2, rel=0.05)
    assert abs(contact.area_mm2 - touch.area_mm2) < 3 * contact.sigma_area_mm2
    assert abs(contact.x_mm - touch.centroid_mm[0]) < 0.03
    assert abs(contact.y_mm - touch.centroid_mm[1]) < 0.03
    radius = np.sqrt(touch.area_mm2 / np.pi)
    off = np.hypot(*(contact.outline_mm - np.array(touch.centroid_mm)).T) - radius
    # these pixels are 0.1 x 0.07 mm of mirror
    assert np.sqrt(np.mean(off**2)) < 0.04
    assert np.sqrt(np.mean(off**2)) < 3 * contact.sigma_edge_mm
    assert contact.minor_mm == pytest.approx(2 * radius, rel=0.05)
    assert step.touching == (contact.figures,)
