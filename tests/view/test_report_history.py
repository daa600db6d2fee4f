"""States, drops and faults with their times."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from report_page import add_row

from zeromethod import Recording, State
from zeromethod.recording.schema import EVENTS, STATES
from zeromethod.view.report_figures import thinned
from zeromethod.view.report_history import Episode, Happening, episodes, happenings, merged, shares

Edited = Callable[[Callable[[h5py.File], object]], Path]


def test_equal_events_close_in_time_make_one_line():
    single = [
        Happening(0.0, 0.0, "late frame", 1, "a"),
        Happening(0.5, 0.5, "torn frame", 1, ""),
        Happening(0.9, 0.9, "late frame", 2, "b"),
        Happening(2.0, 2.0, "late frame", 1, "a"),
    ]
    assert merged(single) == [
        Happening(0.0, 0.9, "late frame", 3, "a, and 1 more"),
        Happening(0.5, 0.5, "torn frame", 1, ""),
        Happening(2.0, 2.0, "late frame", 1, "a"),
    ]


def test_shares_are_of_time_not_of_steps():
    times = ((0.0, 1.0, State.FAULT), (1.0, 4.0, State.LOCKED), (4.0, 4.0, State.STOPPED))
    spent = [Episode(*one, "") for one in times]
    assert shares(spent) == {"locked": 0.75, "fault": 0.25}
    assert shares(spent[2:]) == {"stopped": 1.0}
    assert shares([]) == {}


def test_a_fault_and_drops_are_listed_with_time_count_and_reason(edited):
    def plant(file: h5py.File) -> None:
        table = file["steps/table"]
        steps = table[()]
        steps["state"][10:13] = STATES.index("fault")
        steps["reason"][10:13] = "the camera is lost: unplugged"
        steps["events"][10] |= 1 << EVENTS.index("camera lost")
        table[...] = steps
        for step, count, lost_by, reason in ((16, 4, b"camera", b"late"), (17, 2, b"recorder", b"slow")):
            time_ns = steps["time_ns"][step - 1]
            add_row(file, "drops", step=step, time_ns=time_ns, count=count, lost_by=lost_by, reason=reason)

    with Recording(edited(plant)) as recording:
        at = 1e-9 * (recording.steps["time_ns"] - recording.steps["time_ns"][0])
        found = {one.what: one for one in happenings(recording)}
        (fault,) = [one for one in episodes(recording) if one.state == "fault"]
    assert found["fault"] == Happening(at[10], at[13], "fault", 1, "the camera is lost: unplugged")
    assert found["camera lost"].start_s == pytest.approx(at[10])
    assert (found["dropped: camera"].count, found["dropped: camera"].why) == (4, "late")
    assert found["dropped: recorder"].start_s == pytest.approx(at[16])
    assert (fault.start_s, fault.end_s) == (at[10], at[13])


def test_episodes_follow_each_other_without_gaps(recording_path):
    with Recording(recording_path) as recording:
        found, seconds = episodes(recording), recording.seconds
    assert [one.end_s for one in found[:-1]] == [one.start_s for one in found[1:]]
    assert (found[0].start_s, found[-1].end_s) == (0.0, pytest.approx(seconds))


def test_a_long_curve_keeps_its_spikes_and_its_gaps():
    x = np.arange(100_000.0)
    y = np.sin(x / 5000)
    y[12_345], y[54_321], y[70_000:80_000] = 7.0, -7.0, np.nan
    short_x, short_y = thinned(x, y, 2000)
    assert len(short_x) == len(short_y) == 2000
    assert (np.nanmax(short_y), np.nanmin(short_y)) == (7.0, -7.0)
    assert np.isnan(short_y[(short_x > 70_200) & (short_x < 79_800)]).all()
    np.testing.assert_array_equal(thinned(x[:50], y[:50])[1], y[:50])
