"""The contact status of a run in a few figures, and as values for the page."""

import math
from dataclasses import replace

import pytest

from zeromethod.operating.readings import HISTORY, history_row, status_values
from zeromethod.rubbing import ContactStatus, Motion
from zeromethod.session.status_figures import status_figures
from zeromethod.view.table import status_rows


def status(**figures):
    return ContactStatus(contact_id=1, **figures)


def test_speed_is_that_of_frames_that_slip_and_are_not_aliased():
    found = [
        (0.0, status(share=0.2, speed_mm_s=0.01, motion=Motion.STICK)),
        (0.1, status(share=0.3, speed_mm_s=10.0, motion=Motion.SLIP, event="slip")),
        (0.2, status(share=0.4, speed_mm_s=12.0, motion=Motion.SLIP)),
        (0.3, status(share=0.5, speed_mm_s=3.0, motion=Motion.SLIP, aliased=True, reason="aliased")),
    ]
    figures = status_figures(found)
    assert figures["speed_mm_s"] == pytest.approx(11.0)
    assert figures["share"] == pytest.approx(0.35)
    assert figures["aliased"] == pytest.approx(1 / 3)
    assert figures["events"] == [(0.1, "slip")]
    assert figures["pitch_mm"] is None
    assert figures["reason"] == "aliased"


def test_a_run_without_a_texture_has_none():
    assert status_figures([]) is None
    assert status_rows(None) == []
    values = status_values(None)
    assert values["rubbing"] == ""
    assert all(value is None for name, value in values.items() if name != "rubbing")


def test_what_is_not_known_is_left_out_of_tables_and_none_among_values():
    one = status(share=0.25, sigma_share=0.01, speed_mm_s=math.nan, reason="pitch: nothing regular")
    rows = status_rows(status_figures([(0.5, one)]))
    assert rows == [("share in contact", "0.250 ± 0.010"), ("not known", "pitch: nothing regular")]
    values = status_values(one)
    assert values["rubbing_share"] == pytest.approx(0.25)
    assert values["rubbing_speed_mm_s"] is None


def test_words_for_the_operator_say_what_it_does_or_why_that_is_not_known():
    slips = status(share=0.31, speed_mm_s=20.0, motion=Motion.SLIP, aliased=True)
    assert slips.words == "slip, 20.0 mm/s, aliased, 31 % in contact"
    assert status(reason="too small to look at").words == "too small to look at"


def test_the_page_has_a_row_of_share_speed_and_whether_it_slips():
    slipping = status(share=0.3, speed_mm_s=12.0, motion=Motion.SLIP)
    values = dict.fromkeys(HISTORY) | {"doubt": "", "state": "nulling"}
    row = dict(zip(HISTORY, history_row(values | status_values(slipping)), strict=True))
    assert (row["rubbing_share"], row["rubbing_speed_mm_s"], row["rubbing_slips"]) == (0.3, 12.0, True)
    for unknown in (None, replace(slipping, motion=Motion.UNKNOWN)):
        assert status_values(unknown)["rubbing_slips"] is None
    assert status_values(replace(slipping, motion=Motion.STICK))["rubbing_slips"] is False
