"""What a contact through a cloth needs: a force, as a picture that lags behind a finger bends like one."""

import math
from types import SimpleNamespace

import pytest

from zeromethod import load_rig
from zeromethod.contact.contact import Contact
from zeromethod.contact.finder import ContactFinder
from zeromethod.contact.threads import _NOTHING, finder_of
from zeromethod.optics import Optics
from zeromethod.warp.grid import NodeGrid


def contact(force_n: float, sigma_n: float = 0.001, area_mm2: float = 10.0) -> Contact:
    return Contact(
        id=1, x_mm=40.0, y_mm=2.0, sigma_x_mm=0.1, sigma_y_mm=0.1, area_mm2=area_mm2, sigma_area_mm2=1.0,
        major_mm=4.0, minor_mm=3.0, angle_deg=0.0, sigma_edge_mm=0.1, scattered=math.nan, outline_mm=None,
        outline_px=None, force_n=force_n, sigma_force_n=sigma_n, probability=_NOTHING,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("one", "there"),
    [
        # the lightest planted finger, and the least area that one had
        (contact(0.1, 0.003, 6.0), True),
        # where no force is read nothing speaks against it
        (contact(math.nan, math.nan), True),
        # what fingers left behind in 125 touches: -0.005 to 0.004 N of 5 to 10 mm^2
        (contact(0.004, 0.002, 5.7), False),
        (contact(-0.005), False),
        # within noise
        (contact(0.1, 0.05), False),
    ],
)
def test_what_has_lost_its_carriers_is_a_contact_only_where_a_force_presses(monkeypatch, one, there):
    rig = load_rig("interactive")
    finder = finder_of(rig, Optics(rig), NodeGrid.of_rig(rig))
    monkeypatch.setattr(ContactFinder, "carry", lambda *given: (given[1], given[2], given[3]))
    assert finder.carry(None, None, (one,), None)[2] == ((one,) if there else ())


def test_a_finger_that_faded_and_presses_again_is_another_one_but_not_for_a_single_frame(monkeypatch):
    rig = load_rig("interactive")
    finder = finder_of(rig, Optics(rig), NodeGrid.of_rig(rig))
    monkeypatch.setattr(ContactFinder, "carry", lambda *given: (given[1], given[2], given[3]))
    strong, weak = contact(0.1), contact(0.001)
    # confirmed in the second frame; weak for one, then for as many as after which a pointer is up
    seen = [strong, strong, weak, strong, weak, weak, weak, strong, strong]
    ids = []
    for frame, one in enumerate(seen):
        named = finder._track.follow([one], frame)
        shown = finder.carry(SimpleNamespace(time_ns=frame), None, named, None)[2]
        ids.append([each.id for each in shown])
    assert ids == [[], [1], [], [1], [], [], [], [2], [2]]
