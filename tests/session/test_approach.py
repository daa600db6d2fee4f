import csv

import numpy as np
import pytest

from benchmarks.rigs import coarser
from zeromethod import Session, State
from zeromethod.errors import InputError
from zeromethod.export.formats import export_recording
from zeromethod.operating.readings import approach_values
from zeromethod.recording import Recording
from zeromethod.rig.load import load_rig
from zeromethod.view.report_figures import events
from zeromethod.view.report_summary import summarise_recording
from zeromethod.view.table import approach_words

SCENARIO = """duration_s = 1.6
[[object]]
shape = "ball"
radius_mm = 12.0
path = [{time_s=0.0,x_mm=62.0,y_mm=1.0,depth_mm=-300.0},{time_s=0.3,x_mm=62.0,y_mm=1.0,depth_mm=-300.0},
{time_s=0.301,x_mm=62.0,y_mm=1.0,depth_mm=-40.0},{time_s=1.3,x_mm=62.0,y_mm=1.0,depth_mm=0.0},
{time_s=1.301,x_mm=62.0,y_mm=1.0,depth_mm=0.05}]
[[phase]]
name = "hold"
from_s = 1.3
to_s = 1.6
"""


def test_a_touch_is_expected_and_its_first_frame_is_measured(tmp_path):
    press, file = tmp_path / "come.toml", tmp_path / "come.h5"
    press.write_text(SCENARIO)
    rig = coarser(load_rig("contactless"), 4).model_copy(update={"scenario": str(press)})
    with Session(rig, record=file) as session:
        steps = list(session.run())
        (summed,) = session.figures["approaches"]
    touch_ns = round(1.3e9)
    expected = [step for step in steps if step.state is State.APPROACH]
    assert expected
    assert all(step.time_ns < touch_ns + 60_000_000 for step in expected)
    last = [step for step in expected if step.time_ns < touch_ns][-1]
    # ten of the watch camera's frames before it are known well enough for 10 ms
    at_ns = last.approach.time_ns + 1e9 * last.approach.contact_s
    assert abs(at_ns - touch_ns) < 10e6
    first = next(step for step in steps if step.time_ns - step.exposure_ns // 2 >= touch_ns)
    assert first.measured is not None
    assert first.peak is not None
    # hardly a node is as small as the contact, most of its depth is hidden: sigma must hold it
    assert abs(first.truth.depth_peak_error_percent) < 3 * first.truth.depth_peak_error_sigma_percent
    assert approach_values(last.approach)["approach"].startswith("touch expected in")
    with Recording(file) as recording:
        rows = recording.tables.approaches()
        states = [str(recording.state_of(row)) for row in recording.steps]
        assert summarise_recording(recording)["approaches"] == [pytest.approx(summed)]
        assert [heading for heading, _ in events(recording)] == ["What came"]
        written = export_recording(recording, tmp_path / "come.csv", form="approaches")
        with pytest.raises(InputError, match="no pointer events"):
            export_recording(recording, tmp_path / "come.csv", form="pointers")
    with (tmp_path / "come.csv").open(newline="") as lines:
        came = list(csv.DictReader(lines))
    assert written["rows"] == len(came) == len(rows)
    assert [float(one["sigma_height_mm"]) for one in came if one["sigma_height_mm"]] == [
        one for one in rows["sigma_height_mm"].tolist() if np.isfinite(one)
    ]
    ((label, words),) = approach_words({"approaches": [summed]})
    assert label == "approach"
    assert words.startswith(
        f"armed at {summed['armed_s']:.2f} s, touch expected at {summed['contact_s']:.3f} ± "
    )
    assert "approach" in states
    assert summed["armed_s"] < summed["contact_s"]
    # 30 Hz beside 60: a row per frame of the watch camera, not per step
    assert 40 <= len(rows) <= 49
    row = rows[rows["time_ns"] == last.approach.time_ns][0]
    assert row["watching"] == b"coming"
    assert row["contact_s"] == last.approach.contact_s


def test_a_watch_camera_that_vanishes_leaves_the_run_alone(tmp_path):
    faults = {"simulation.faults.watch": "lost", "simulation.faults.watch_s": [0.1, 9.0]}
    rig = coarser(load_rig("contactless"), 4).replace({"scenario": "none", **faults})
    with Session(rig) as session:
        steps = list(session.run(frames=20))
    assert steps[-1].state is State.RESTING
    assert steps[-1].approach.words.startswith("watch camera lost")
    assert any("what comes is not seen" in note for step in steps for note in step.notes)
