"""A brush on the simulated bench, seen through the loop: share, pitch, speed, stick and slip, force."""

import csv
from dataclasses import asdict, fields

import numpy as np
import pytest

from zeromethod import Recording, Session, export_recording, load_rig
from zeromethod.loop.step import Step
from zeromethod.rubbing import ContactStatus, Motion
from zeromethod.session.reading import with_reading
from zeromethod.view.report_summary import summarise_recording

VIEW = {"camera.columns": 480, "camera.rows": 384, "camera.centre_px": [239.5, 191.5]}
"""The packaged bench's pixels, fewer of them."""
SPEED_MM_S, FORCE_N, PITCH_MM = 12.0, 0.5, 0.8
HELD_S, SLIP_S, STICK_S, END_S = 0.3, 0.46, 0.66, 0.74
FILLED: set[str] = set()
"""Names of all that reading filled in of a step."""
PRESS = f"""
[[object]]
shape = "texture"
weave = "brush"
radius_mm = 3.0
pitch_mm = {PITCH_MM}
tip_mm = 0.8
height_mm = 0.002
albedo = "grey"
path = [
    {{ time_s = 0.26, x_mm = 41.0, y_mm = 0.0, force_n = 0.0 }},
    {{ time_s = {HELD_S}, x_mm = 41.0, y_mm = 0.0, force_n = {FORCE_N} }},
    {{ time_s = {SLIP_S}, x_mm = 41.0, y_mm = 0.0, force_n = {FORCE_N} }},
    {{ time_s = {STICK_S}, x_mm = {41.0 + 0.2 * SPEED_MM_S}, y_mm = 0.0, force_n = {FORCE_N} }},
]
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """(steps, session's figures, recording)."""
    folder = tmp_path_factory.mktemp("rub")
    (folder / "press.toml").write_text(PRESS)
    values = {**VIEW, "camera.exposure_s": 0.001, "control.rubbing": True}
    rig = load_rig("simulated").replace(values, scenario=str(folder / "press.toml"))
    read_step, figures = Session._read, fields(Step)

    def read(self, step):
        after = read_step(self, step)
        FILLED.update(one.name for one in figures if getattr(after, one.name) is not getattr(step, one.name))
        return after

    with pytest.MonkeyPatch.context() as patch, Session(rig, record=folder / "run.h5") as session:
        patch.setattr(Session, "_read", read)
        steps = list(session.run(seconds=END_S))
        figures = session.figures
    with Recording(folder / "run.h5") as recording:
        yield steps, figures, recording


def test_all_that_is_read_reaches_the_later_step_at_which_it_is_ready(run):
    held = next(one for one in run[0][::-1] if one.contact_status is not None)
    late = with_reading(run[0][0], held)
    assert {"surface", "contact_status", "total_force_n"} <= FILLED
    assert [name for name in FILLED if getattr(late, name) is not getattr(held, name)] == []
    assert late.number == run[0][0].number


def statuses(run, from_s, to_s):
    return [one.contact_status for one in run[0] if from_s < 1e-9 * one.time_ns < to_s]


def test_nothing_rubs_before_it_touches(run):
    assert all(one is None for one in statuses(run, 0, 0.255))


def test_share_force_and_pitch_are_the_true_ones(run):
    held = statuses(run, HELD_S + 0.1, SLIP_S)
    assert all(one.pitch_mm == pytest.approx(PITCH_MM, rel=0.02) for one in held)
    assert all(abs(one.force_n - FORCE_N) < 3 * one.sigma_force_n for one in held)
    assert all(one.force_n == pytest.approx(FORCE_N, rel=0.02) for one in held)


def test_the_area_is_within_its_sigma_and_a_border_that_slides_is_seen_to_move(run):
    contacts = [one.contacts[0] for one in run[0] if HELD_S + 0.1 < 1e-9 * one.time_ns < STICK_S]
    assert all(abs(one.area_mm2 - np.pi * 3.0**2) < 3 * one.sigma_area_mm2 for one in contacts)
    # what is the same in every frame is not in it: else a force's fit stays where the contact was
    assert all(one.sigma_edge_mm < SPEED_MM_S / 60 for one in contacts)


def test_speed_is_the_true_one_and_stick_and_slip_are_named_within_three_frames(run):
    sliding = statuses(run, SLIP_S + 0.1, STICK_S)
    assert all(one.motion is Motion.SLIP and not one.aliased for one in sliding)
    speed = np.mean([one.speed_mm_s for one in sliding])
    assert speed == pytest.approx(SPEED_MM_S, rel=0.02)
    assert all(abs(one.speed_mm_s - SPEED_MM_S) < 4 * one.sigma_speed_mm_s for one in sliding)
    assert all(abs(one.direction_deg) < 3 for one in sliding)
    named = [
        (1e-9 * one.time_ns, one.contact_status.event)
        for one in run[0]
        if one.contact_status and one.contact_status.event
    ]
    assert [event for _, event in named] == ["slip", "stick"]
    for (at, _), began in zip(named, (SLIP_S, STICK_S), strict=True):
        assert 0 < at - began < 3 / 60


def test_summary_and_recording_have_the_same_figures(run):
    steps, figures, recording = run
    known = [one for one in steps if one.contact_status is not None]
    rows = recording.tables.contact_status()
    assert rows["step"].tolist() == [one.number for one in known]
    np.testing.assert_array_equal(rows["share"], [one.contact_status.share for one in known])
    assert [Recording.text(one) for one in rows["motion"]] == [
        str(one.contact_status.motion) for one in known
    ]
    summed = figures["contact_status"]
    assert summed["frames"] == len(known)
    assert summed["pitch_mm"] == pytest.approx(PITCH_MM, rel=0.02)
    assert [name for _, name in summed["events"]] == ["slip", "stick"]


def test_a_csv_the_report_and_a_replay_have_them_too(run, tmp_path):
    steps, figures, recording = run
    known = [one for one in steps if one.contact_status is not None]
    written = export_recording(recording, tmp_path / "rub.csv", form="rubbing")
    with (tmp_path / "rub.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert written["rows"] == len(lines) == len(known)
    assert [line["motion"] for line in lines] == [str(one.contact_status.motion) for one in known]
    last = known[-1].contact_status
    assert float(lines[-1]["pitch_mm"]) == last.pitch_mm
    assert lines[-1]["spot_life_s"] == ""  # bristles stay
    assert lines[0]["reason"] == known[0].contact_status.reason
    reported = summarise_recording(recording)["contact_status"]
    assert reported["share"] == pytest.approx(figures["contact_status"]["share"], rel=1e-9)
    rows = recording.tables.contact_status()
    np.testing.assert_equal(asdict(ContactStatus.of_row(rows[-1])), asdict(last))
