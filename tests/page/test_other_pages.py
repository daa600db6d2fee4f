"""The pages of a recording, of setting up by eye, of a calibration."""

import itertools
import json
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsing import Served, browser, needs_browser, served, tab
from commands import assert_refused
from commands import typed as entered
from recorded_run import recorded
from small_rigs import BENCH_160, small_rig_file

from zeromethod import open_recording
from zeromethod.cli.replay import replay_command
from zeromethod.operating.guide_tables import CALIBRATE, FOCUS
from zeromethod.operating.player import Player
from zeromethod.operating.replay_table import REPLAY
from zeromethod.page.replay_content import ReplayContent, nodes_of
from zeromethod.recording.schema import STATES

PATIENCE_S = 90.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("replay") / "press.h5", 0.5)


def state(one: Served) -> dict[str, Any]:
    with urllib.request.urlopen(f"{one.base}/api/state?token={one.token}", timeout=30) as answer:
        found: dict[str, Any] = json.loads(answer.read())
        return found


def call(one: Served, method: str, **arguments: Any) -> dict[str, Any]:
    request = urllib.request.Request(
        f"{one.base}/api/{method}?token={one.token}", json.dumps(arguments).encode(), method="POST"
    )
    with urllib.request.urlopen(request, timeout=30) as answer:
        found: dict[str, Any] = json.loads(answer.read())
        return found


def until(one: Served, **wanted: Any) -> dict[str, Any]:
    end_s = time.monotonic() + PATIENCE_S
    while True:
        values = state(one)
        if all(values.get(name) == value for name, value in wanted.items()):
            return values
        assert time.monotonic() < end_s, (wanted, values)
        time.sleep(0.1)


def test_what_is_shown_of_a_recording_is_what_is_in_it(recording):
    with open_recording(recording) as opened:
        content = ReplayContent(opened, Player(opened.seconds))
        assert content.index_at(0.0) == 0
        assert content.index_at(99.0) == len(opened.steps) - 1
        names = {one.name for one in REPLAY.values}
        for index in range(0, len(opened.steps), 5):
            found = content.compose(index, frozenset({"camera", "surface", "residual", "lcd"}))
            assert set(found.values) == names
            json.dumps(found.values, allow_nan=False)
            row = opened.steps[index]
            step = int(row["number"])
            assert found.values["step"] == step
            if (image := opened.image(step)) is not None:
                assert np.array_equal(found.arrays["camera"]["image"], image)
            if (surface := opened.surface(step)) is not None:
                depth = found.arrays["surface"]["depth"]
                assert np.array_equal(
                    depth[surface.valid], surface.depth_mm[surface.valid].astype(np.float32)
                )
                assert found.values["peak_mm"] in opened.peaks["depth_mm"]


def test_what_is_said_of_a_recording_are_its_states_as_they_changed(recording):
    with open_recording(recording) as opened:
        said = ReplayContent(opened, Player(opened.seconds)).said()
        states = [one.words.partition(":")[0] for one in said if one.kind == "state"]
        rows = [STATES[int(row["state"])].value for row in opened.steps]
    assert states[-1] == rows[-1]
    shown = [state for state in rows if state not in {"starting", "holding"}]  # a frame or two of them
    assert states == [state for state, _ in itertools.groupby(shown)]
    assert [one.time_s for one in said] == sorted(one.time_s or 0.0 for one in said)


def test_places_of_the_mirror_are_found_again_in_the_lattice(recording):
    with open_recording(recording) as opened:
        surface = opened.surface(int(opened.steps_with("surface")[-1]))
        assert surface is not None
        nodes = np.array([[12.0, 9.0], [20.25, 14.5], [9.5, 20.0]])
        whole, part = nodes.astype(int), nodes % 1

        def between(values: np.ndarray) -> np.ndarray:
            i, j = whole.T
            s, t = part.T
            upper = (1 - s) * values[j, i] + s * values[j, i + 1]
            lower = (1 - s) * values[j + 1, i] + s * values[j + 1, i + 1]
            return (1 - t) * upper + t * lower

        places = np.stack([between(surface.x_mm), between(surface.y_mm)], axis=-1)
        assert nodes_of(surface, places) == pytest.approx(nodes, abs=0.05)


@needs_browser
def test_a_recording_is_scrubbed_and_a_stretch_of_it_played_over_and_over(recording, tmp_path):
    words = ("--view", "127.0.0.1:0", "--speed", "0.5")
    with served("replay", recording, *words, cwd=tmp_path, wanted=2) as one:
        with browser() as opened, tab(opened, one.urls["view"]) as page:
            _scrub_and_play(recording, one, page)
        # only now: a page whose server is gone logs that it cannot reach it
        call(one, "close")
        assert one.process.wait(30) == 0


def _scrub_and_play(recording, one, page):
    def waited(condition: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not page.evaluate(condition):
            assert time.monotonic() < end_s, condition
            page.wait_for_timeout(50)

    waited("zeromethod.values.duration_s > 0.4 && zeromethod.contents > 3")
    controls = set(page.eval_on_selector_all("[data-method]", "all => all.map((one) => one.dataset.method)"))
    assert controls == {method.name for method in REPLAY.methods}
    call(one, "pause")
    waited("!zeromethod.values.playing")
    page.evaluate(
        "() => { const s = document.getElementById('scrub'); s.value = 0.4;"
        " s.dispatchEvent(new Event('input')); s.dispatchEvent(new Event('change')); }"
    )
    waited("Math.abs(zeromethod.values.time_s - 0.4) < 0.02")
    with open_recording(recording) as whole:
        times_s = 1e-9 * (whole.steps["time_ns"] - whole.steps["time_ns"][0])
        row = whole.steps[int(np.searchsorted(times_s, 0.4 + 1e-9, side="right")) - 1]
    assert page.evaluate("zeromethod.values.step") == int(row["number"])
    page.select_option("#speed", "5")
    waited("zeromethod.values.speed === 5")
    call(one, "stretch", from_s=0.1, to_s=0.3)
    page.keyboard.press("p")
    waited("zeromethod.values.playing")
    page.keyboard.press("p")
    waited("!zeromethod.values.playing")
    page.keyboard.press("p")
    seen = []
    for _ in range(60):
        page.wait_for_timeout(30)
        seen.append(page.evaluate("zeromethod.values.time_s"))
    assert min(seen[10:]) > 0.05
    assert max(seen[10:]) < 0.32
    assert len(set(seen)) > 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--mode", "from-frames"), "--mode: not with --view or --control"),
        (("--summary", "x.json"), "--summary: not with --view"),
    ],
)
def test_what_a_page_cannot_show_is_refused(recording, options, words):
    assert_refused(entered(replay_command, recording, *options, "--view", "127.0.0.1:0"), words)


def test_setting_up_by_eye_shows_advice_figures_and_the_picture(tmp_path):
    rig = small_rig_file(tmp_path / "small.toml", BENCH_160)
    words = ("--focus", "--rig", rig, "--seconds", "600", "--view", "127.0.0.1:0")
    with served("devices", *words, cwd=tmp_path, wanted=2) as one:
        values = until(one, step_name="Set up by eye")
        assert set(values) == {value.name for value in FOCUS.values}
        assert values["focus_score"] > 0.1
        assert values["instruction"] == values["lines"][0]
        assert call(one, "stop") == {"result": {}}
        assert one.process.wait(60) == 0


def test_a_calibration_says_its_step_and_what_to_do_and_can_be_ended(tmp_path):
    rig = small_rig_file(tmp_path / "small.toml", BENCH_160)
    words = ("--rig", rig, "--press-depths", "0.2,0.15", "--view", "127.0.0.1:0")
    with served("calibrate", *words, cwd=tmp_path, wanted=2) as one:
        values = until(one, step_name="rest map")
        assert set(values) == {value.name for value in CALIBRATE.values}
        assert any("do not touch the mirror" in line for line in values["lines"])
        assert 0 <= values["progress"] <= 1
        assert call(one, "stop") == {"result": {}}
        assert one.process.wait(120) == 130
