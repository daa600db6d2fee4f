"""A contact's figures from its border, and its id from frame to frame."""

import numpy as np
import pytest

from zeromethod.contact.contact import Contact, Probability
from zeromethod.contact.moments import moments
from zeromethod.contact.track import ContactTrack


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0, 135.0])
def test_moments_of_an_ellipse(angle_deg):
    turn, t = np.radians(angle_deg), np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    along, across = 1.5 * np.cos(t), 0.5 * np.sin(t)
    x, y = (
        40 + np.cos(turn) * along - np.sin(turn) * across,
        -3 + np.sin(turn) * along + np.cos(turn) * across,
    )
    found = moments(np.stack((x, y), axis=-1))
    # a polygon of n corners lacks 2 pi^2 / 3 n^2 of the area
    assert found.area_mm2 == pytest.approx(np.pi * 0.75, rel=1e-5)
    assert (found.x_mm, found.y_mm) == pytest.approx((40.0, -3.0), abs=1e-9)
    assert (found.major_mm, found.minor_mm) == pytest.approx((3.0, 1.0), rel=1e-5)
    assert min(abs(found.angle_deg - angle_deg), 180 - abs(found.angle_deg - angle_deg)) < 1e-3


def contact(x_mm: float, y_mm: float = 0.0, area_mm2: float = 1.0) -> Contact:
    nothing = Probability(0, 0, np.zeros((0, 0), np.float32))
    size = {"major_mm": 1.1, "minor_mm": 1.1, "angle_deg": 0.0, "sigma_edge_mm": 0.01, "scattered": 0.05}
    sigma = {"sigma_x_mm": 0.01, "sigma_y_mm": 0.01, "sigma_area_mm2": 0.02}
    line = np.zeros((0, 2))
    return Contact(
        id=0, x_mm=x_mm, y_mm=y_mm, area_mm2=area_mm2, **size, **sigma,
        outline_mm=line, outline_px=line, probability=nothing,
    )  # fmt: skip


def ids(track: ContactTrack, *contacts: Contact) -> list[int]:
    return [each.id for each in track.follow(contacts)]


def test_a_contact_is_named_in_its_second_frame_and_keeps_its_id():
    track = ContactTrack()
    assert ids(track, contact(40.0)) == []
    assert [ids(track, contact(40.0 + 0.3 * k)) for k in range(6)] == [[1]] * 6


def test_a_frame_without_it_does_not_end_a_contact_and_two_do():
    track = ContactTrack()
    ids(track, contact(40.0)), ids(track, contact(40.0))
    assert ids(track) == []
    assert ids(track, contact(40.0)) == [1]
    assert ids(track) == ids(track) == []
    assert ids(track, contact(40.0)) == []
    assert ids(track, contact(40.0)) == [2]


def test_what_is_seen_in_one_frame_alone_is_never_named():
    track = ContactTrack()
    found = [ids(track, contact(40.0 + 5 * (k % 3))) if k % 2 else ids(track) for k in range(12)]
    assert found == [[]] * 12


def test_contacts_that_pass_each_other_keep_their_ids():
    track = ContactTrack()
    for k in range(9):
        left, right = contact(40.0 + 0.5 * k, 1.5), contact(44.0 - 0.5 * k, -1.5)
        found = track.follow([left, right] if k % 2 == 0 or k < 2 else [right, left])
        if k >= 2:
            assert {round(each.y_mm, 1): each.id for each in found} == {1.5: 1, -1.5: 2}
