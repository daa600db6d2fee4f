"""Fingers through a cloth under a projector's light: the loop locks, fingers are found, placed, weighed."""

import csv
from pathlib import Path

import numpy as np
import pytest

from benchmarks.rigs import coarser
from zeromethod import Session, load_rig, open_recording
from zeromethod.devices.opening import open_devices
from zeromethod.export.formats import export_recording
from zeromethod.interactive.pointers import PointerType
from zeromethod.loop.state import NULLED, State
from zeromethod.operating.player import Player
from zeromethod.operating.readings import Readings
from zeromethod.page.replay_content import ReplayContent
from zeromethod.view.report_figures import events
from zeromethod.view.report_summary import summarise_recording

FINGERS = ((30.0, -6.0, 0.3), (52.0, 5.0, 0.5))
DOWN_S, UP_S = 0.3, 0.42


def press_file(folder: Path) -> Path:
    """Two fingers that come down at once between two frames, and lift at once."""
    text = "duration_s = 0.55\n"
    for x, y, force in FINGERS:
        points = [(DOWN_S, 0.0), (DOWN_S, force), (UP_S, force), (UP_S, 0.0)]
        path = ", ".join(f"{{time_s = {t}, x_mm = {x}, y_mm = {y}, force_n = {f}}}" for t, f in points)
        text += f'[[object]]\nshape = "ball"\nradius_mm = 30.0\npath = [{path}]\n'
    file = folder / "two.toml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("grey", [0, 255], ids=["dark", "white"])
def test_fingers_are_found_placed_and_weighed_through_the_cloth(tmp_path, grey):
    rig = coarser(load_rig("interactive"), 4).replace({"cloth.weave_mm": 0.6})
    rig = rig.replace({"scenario": str(press_file(tmp_path)), "projector.picture": "black"})
    with open_devices(rig) as devices:
        spec = rig.projector
        devices.display.projector.show(np.full((spec.rows, spec.columns), grey, np.uint8))
        with Session(rig, devices=devices) as session:
            steps = list(session.run())
    before = [step for step in steps if step.time_s < DOWN_S]
    assert all(step.state in NULLED for step in before[8:])
    assert not any(step.contacts for step in before)
    pressed = [step for step in steps if DOWN_S + 0.03 < step.time_s < UP_S - 0.02]
    assert len(pressed) > 3
    # a node is 1.4 mm wide here, four times as wide as on the packaged bench, and a finger's spot 4 mm
    for step in pressed:
        assert len(step.contacts) == len(FINGERS), step
        for contact, (x, y, _) in zip(sorted(step.contacts, key=lambda one: one.x_mm), FINGERS, strict=True):
            assert np.hypot(contact.x_mm - x, contact.y_mm - y) < 0.8
    for contact, (*_, force) in zip(
        sorted(pressed[-1].contacts, key=lambda one: one.x_mm), FINGERS, strict=True
    ):
        # nodes next to the spot, where slopes say most, are lost with it at this resolution
        assert contact.force_n == pytest.approx(force, rel=0.1)
    assert len({tuple(sorted(one.id for one in step.contacts)) for step in pressed}) == 1
    assert not steps[-1].contacts


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_fingers_area_and_the_depth_inside_are_within_their_sigma_at_full_size(tmp_path):
    rig = load_rig("interactive").replace({"scenario": str(press_file(tmp_path))})
    with Session(rig) as session:
        steps = [step for step in session.run() if DOWN_S + 0.03 < step.time_s < UP_S - 0.02]
        # beside fingers it is never nulled
        assert session.figures["not_nulled"] is None
    for step in steps:
        for contact, (*_, force) in zip(
            sorted(step.contacts, key=lambda one: one.x_mm), FINGERS, strict=True
        ):
            # Hertz: a^3 = 3 F R / (4 E*), depth a^2 / R
            a2_mm2 = (3 * force * 30.0 / (4 * 1.0 / (1 - 0.49**2))) ** (2 / 3)
            assert abs(contact.area_mm2 - np.pi * a2_mm2) < 3 * contact.sigma_area_mm2
            assert abs(contact.depth_mm - a2_mm2 / 30.0) < 3 * contact.sigma_depth_mm


def test_a_recording_replays_the_pointer_events_that_programs_got_live(tmp_path):
    rig = coarser(load_rig("interactive"), 4).replace({"cloth.weave_mm": 0.6})
    rig = rig.replace({"scenario": str(press_file(tmp_path))})
    live = {}
    with Session(rig, record=tmp_path / "run.h5") as session:
        readings = Readings(session)
        for step in session.run():
            readings.see(step)
            live[step.number] = readings.values["pointers"]
        rows = session.figures["pointers"]
    last = live[max(live)]
    kinds = [event["type"] for event in last]
    # each of the two comes and goes once: nothing is invented where they were
    assert [kinds.count(one) for one in (PointerType.DOWN, PointerType.UP)] == [len(FINGERS), len(FINGERS)]
    assert sum(row["moves"] + 2 for row in rows) == len(last)
    for row, (x, y, force) in zip(sorted(rows, key=lambda one: one["x_mm"]), FINGERS, strict=True):
        assert np.hypot(row["to_x_mm"] - x, row["to_y_mm"] - y) < 0.8  # as above
        assert row["ended"] == PointerType.UP
        assert row["pressure"] == pytest.approx(force / rig.projector.full_force_n, rel=0.15)
    with open_recording(tmp_path / "run.h5") as recording:
        assert summarise_recording(recording)["pointers"] == rows
        assert [heading for heading, _ in events(recording)] == ["Pointers"]
        export_recording(recording, tmp_path / "touches.csv", form="pointers")
        with (tmp_path / "touches.csv").open(newline="") as lines:
            written = list(csv.DictReader(lines))
        assert [one["type"] for one in written] == kinds
        assert [float(one["y_px"]) for one in written] == [event["y"] for event in last]
        content = ReplayContent(recording, Player(recording.seconds))
        for index, (step, said) in enumerate(live.items()):
            assert recording.steps["number"][index] == step
            assert content.values(index)["pointers"] == said


def test_fingers_that_are_down_at_the_end_are_cancelled_in_figures_and_recording(tmp_path):
    rig = coarser(load_rig("interactive"), 4).replace({"cloth.weave_mm": 0.6})
    rig = rig.replace({"scenario": str(press_file(tmp_path))})
    with Session(rig, record=tmp_path / "run.h5") as session:
        list(session.run(seconds=DOWN_S + 0.06))
        rows = session.figures["pointers"]
    assert [row["ended"] for row in rows] == [PointerType.CANCEL] * len(FINGERS)
    assert all(row["reason"] == "stopped: the run has ended" for row in rows)
    with open_recording(tmp_path / "run.h5") as recording:
        assert summarise_recording(recording)["pointers"] == rows


def test_one_dark_frame_lifts_no_finger(tmp_path):
    dark = round((DOWN_S + 0.07) * 60)
    rig = coarser(load_rig("interactive"), 4).replace({"cloth.weave_mm": 0.6})
    faults = {"simulation.faults.light_off_frames": (dark, dark)}
    rig = rig.replace(faults, scenario=str(press_file(tmp_path)))
    with Session(rig) as session:
        steps = list(session.run())
    assert any(step.state is State.LOST for step in steps)
    kinds = [event.type for step in steps for event in step.pointers if event.type is not PointerType.MOVE]
    assert kinds == [PointerType.DOWN] * len(FINGERS) + [PointerType.UP] * len(FINGERS)
