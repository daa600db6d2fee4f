"""Every method of a run acts, answers, and is in the recording."""

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hanging import PATIENCE_S
from operating_run import Operated, operated

from zeromethod import InputError, MeasurementError, State, open_recording
from zeromethod.operating.readings import HISTORY
from zeromethod.operating.run_table import METHODS, RUN, VALUES


def until(run: Operated, done: Callable[[], bool], frames: int = 4) -> None:
    """Let frames pass until something that takes host time is done."""
    end_s = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < end_s
        for _ in run.steps(frames):
            pass


def test_every_method_acts_and_every_call_is_in_the_recording(tmp_path):
    path = tmp_path / "run.h5"
    with operated(tmp_path, record=path) as run:
        loop, controls = run.session.loop, run.controls
        adjust = loop.adjust

        def called(method: str, source: str = "page", **arguments: Any) -> dict[str, Any]:
            future = controls.call(method, arguments, source)
            until(run, future.done)
            return future.result()

        called("pause")
        assert loop.paused
        assert loop.status.state in {State.PAUSED, State.STOPPED}
        called("resume")
        assert not loop.paused
        called("gain", value=0.5)
        assert adjust.gain == 0.5
        called("target", contrast=0.7)
        assert adjust.target.contrast == 0.7
        with pytest.raises(MeasurementError, match=r"^no new zero: something presses"):
            called("zero", source="terminal")
        called("mark", note="weight on")
        files = called("snapshot", note="so far")["files"]
        assert [(tmp_path / name).exists() for name in files] == [True, True]
        with np.load(tmp_path / files[1]) as saved:
            assert str(saved["note"]) == "so far"
            assert np.isfinite(saved["depth_mm"]).any()
        run.devices.camera.exposure_settable = False
        with pytest.raises(InputError, match=r"^exposure: SimulatedCamera cannot change it"):
            called("exposure", value=5.0)
        with pytest.raises(InputError, match=r"run\.h5: is being recorded already"):
            called("record", file="more.h5")
        assert called("stop_recording") == {"file": "run.h5"}
        assert called("record", file="more.h5", note="second half") == {"file": "more.h5"}
        called("mark", note="in the second")
        for _ in run.steps(3):
            controls.call("stop", {}, "socket")
    with open_recording(path) as recording:
        rows = [
            (row["method"].decode(), json.loads(row["arguments"]), row["source"].decode())
            for row in recording.calls
        ]
        assert rows == [
            ("pause", {}, "page"),
            ("resume", {}, "page"),
            ("gain", {"value": 0.5}, "page"),
            ("target", {"contrast": 0.7}, "page"),
            ("zero", {}, "terminal"),
            ("mark", {"note": "weight on"}, "page"),
            ("snapshot", {"note": "so far"}, "page"),
            ("exposure", {"value": 5.0}, "page"),
            ("record", {"file": "more.h5", "note": ""}, "page"),
        ]
        outcomes = [row["outcome"].decode() for row in recording.calls]
        refused = [outcome.startswith("refused: ") for outcome in outcomes]
        assert refused == [row[0] in {"zero", "exposure", "record"} for row in rows]
    with open_recording(tmp_path / "more.h5") as recording:
        assert [row["method"] for row in recording.calls] == [b"record", b"mark", b"stop"]
        assert recording.complete
        assert len(recording.steps) > 3
        assert set(recording.peaks["step"]) <= set(recording.steps["number"])


def test_what_was_called_right_before_a_recording_stops_is_in_it(tmp_path):
    with operated(tmp_path, "none", record=tmp_path / "run.h5") as run:
        run.controls.call("pause")
        run.controls.call("mark", {"note": "the last one"})
        stopped = run.controls.call("stop_recording")
        until(run, stopped.done)
        again = run.controls.call("record", {"file": "more.h5"})
        until(run, lambda: run.session.recording.running, frames=1)
        run.controls.call("mark", {"note": "in the first step"})
        stopped = run.controls.call("stop_recording")
        until(run, stopped.done)
        assert again.result() == {"file": "more.h5"}
        assert stopped.result() == {"file": "more.h5"}
    with open_recording(tmp_path / "run.h5") as recording:
        assert [row["method"] for row in recording.calls] == [b"pause", b"mark"]
        assert recording.complete
    with open_recording(tmp_path / "more.h5") as recording:
        assert b"record" in [row["method"] for row in recording.calls]
        assert b"in the first step" in b"".join(row["arguments"] for row in recording.calls)


def test_a_zero_is_done_once_it_is_taken(tmp_path):
    with operated(tmp_path, "none") as run:
        asked = run.controls.call("zero")
        until(run, asked.done, frames=1)
        assert asked.result() == {}
        assert run.session.loop.zero is not None


@pytest.mark.parametrize(
    ("method", "arguments", "words"),
    [
        ("gain", {"value": 0.0}, "gain: value: 0.0: allowed: 0.01 to 1"),
        ("gain", {"value": "much"}, "gain: value: 'much': a number is wanted"),
        ("gain", {"value": True}, "gain: value: True: a number is wanted"),
        ("gain", {"value": float("nan")}, "gain: value: nan: a finite number is wanted"),
        ("gain", {}, "gain: value: missing: the share; 1 is the usual one"),
        ("gain", {"much": 1}, "gain: much: no such argument; allowed: value"),
        ("mark", {"note": "\ud800"}, "mark: note: '\\ud800': half a character, which cannot be written"),
        ("mark", {"note": "x" * 300}, "mark: note: 300 characters: at most 200"),
        ("dance", {}, "'dance': no such method; allowed: pause, resume, "),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line_at_once(tmp_path, method, arguments, words):
    with operated(tmp_path) as run, pytest.raises(InputError) as refused:
        run.controls.call(method, arguments).result(0)
    assert str(refused.value).startswith(words)


@pytest.mark.parametrize("name", ["../x.h5", "x.txt", "/tmp/x.h5", ".h5", "a/b.h5"])
def test_a_recording_goes_into_the_folder_of_the_run_and_nowhere_else(tmp_path, name):
    with operated(tmp_path) as run:
        future = run.controls.call("record", {"file": name})
        until(run, future.done, 1)
        with pytest.raises(InputError, match="without a folder"):
            future.result()


def test_a_call_after_the_run_is_refused(tmp_path):
    with operated(tmp_path) as run:
        waiting = run.controls.call("pause")
        run.controls.close()
        for future in (waiting, run.controls.call("pause")):
            with pytest.raises(MeasurementError, match="pause: the run is over"):
                future.result(0)


def test_values_are_those_of_the_table_and_equal_the_loops(tmp_path):
    with operated(tmp_path) as run:
        names = {one.name for one in VALUES}
        assert set(run.readings.values) == names
        for step in run.steps(30):
            values = run.readings.values
            assert set(values) == names
            assert values["state"] == step.state
            assert values["step"] == step.number
            if step.peak is not None:
                assert values["peak_mm"] == step.peak.depth_mm
                assert values["peak_sigma_mm"] == step.peak.sigma_mm
            if np.isfinite(step.residual_rms_px):
                assert values["residual_px"] == step.residual_rms_px
        json.dumps(values, allow_nan=False)
        # the simulated camera's own rate
        assert values["loop_rate_hz"] == pytest.approx(60, rel=0.05)
        rows = run.readings.take_rows()
        assert len(rows) == values["step"] - 0
        assert len(rows[0]) == len(HISTORY)


def test_keys_are_those_of_methods_and_no_two_share_one_but_pairs():
    pairs = {("pause", "resume"), ("record", "stop_recording")}
    by_key: dict[str, list[str]] = {}
    for method in METHODS:
        by_key.setdefault(method.key, []).append(method.name)
    assert all(len(names) == 1 or tuple(names) in pairs for key, names in by_key.items() if key)
    assert json.loads(json.dumps(RUN.described()))["mode"] == "run"
