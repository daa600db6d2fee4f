"""The page in a real browser: it shows what the loop has, and every control acts and is recorded."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browsing import Served, browser, calm_rig_file, needs_browser, served, tab

from zeromethod import open_recording
from zeromethod.operating.run_table import METHODS, RUN

pytestmark = needs_browser
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def run(folder: Path) -> Iterator[Served]:
    rig = calm_rig_file(folder)
    words = ("--scenario", "hold", "--seconds", "900", "--view", "127.0.0.1:0", "--record", "run.h5")
    with served("run", "--rig", rig, *words, "--keep", "none", cwd=folder, wanted=2) as one:
        yield one


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as opened:
        yield opened


@pytest.fixture
def page(chromium: Any, run: Served) -> Iterator[Any]:
    with tab(chromium, run.urls["view"]) as opened:
        until(opened, "zeromethod.values.state === 'locked'")
        yield opened


def until(page: Any, condition: str) -> None:
    """Wait for a condition; asked again and again: the page lets no text be run as a script."""
    end_s = time.monotonic() + PATIENCE_S
    while not page.evaluate(condition):
        assert time.monotonic() < end_s, condition
        page.wait_for_timeout(50)


def recorded(path: Path) -> list[tuple[str, dict[str, Any], str]]:
    with open_recording(path) as recording:
        return [
            (row["method"].decode(), json.loads(row["arguments"]), row["outcome"].decode())
            for row in recording.calls
        ]


def test_what_it_shows_is_what_the_loop_has(page, folder):
    until(page, "zeromethod.contents > 5")
    # until it is learned what presses, the peak is open by a tenth
    until(page, "zeromethod.values.peak_sigma_mm !== null && zeromethod.values.peak_sigma_mm < 0.001")
    until(page, "document.getElementById('peak').textContent !== '–'")
    shown = page.evaluate("zeromethod.values")
    assert shown["peak_mm"] == pytest.approx(0.2, rel=0.005)
    until(page, "document.querySelector('#state [data-value]').textContent === zeromethod.values.state")
    with open_recording(folder / "run.h5") as recording:
        until(
            page, f"zeromethod.values.step > {shown['step'] + 40}"
        )  # what is shown has been written by then
        recording.refresh()
        peaks = {float(row["depth_mm"]) for row in recording.peaks}
        steps = {int(row["number"]): float(row["residual_rms_px"]) for row in recording.steps}
    assert shown["peak_mm"] in peaks
    assert shown["residual_px"] == steps[shown["step"]]
    text = page.inner_text("#peak")
    assert float(text) == pytest.approx(1e3 * page.evaluate("zeromethod.values.peak_mm"), abs=0.5)


def test_pictures_maps_and_plots_are_drawn(page):
    until(page, "zeromethod.contents > 10")
    until(page, "document.getElementById('depth-note').textContent !== ''")
    colours = """(id) => { const c = document.getElementById(id);
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        return new Set(new Uint32Array(d.buffer)).size; }"""
    for canvas in ("camera-canvas", "depth-canvas", "depth-bar"):
        assert page.evaluate(colours, canvas) > 20, canvas
    until(page, "document.getElementById('solid-note').textContent.includes('mm')")
    assert page.locator(".uplot").count() == 6
    until(page, f"({colours})('lcd-canvas') > 5")
    page.click("[data-tab='residual-tab']")
    until(page, f"({colours})('residual-canvas') > 5")


def test_its_controls_and_values_are_those_of_the_table(page):
    controls = set(page.eval_on_selector_all("[data-method]", "all => all.map((one) => one.dataset.method)"))
    assert controls == {one.name for one in METHODS}
    shown = set(page.eval_on_selector_all("[data-value]", "all => all.map((one) => one.dataset.value)"))
    assert shown == {one.name for one in RUN.values}
    assert set(page.evaluate("Object.keys(zeromethod.values)")) == shown
    assert page.evaluate("zeromethod.table") == json.loads(json.dumps(RUN.described()))


def test_a_point_that_is_clicked_gets_its_figures_over_time(page):
    box = page.locator("#depth-canvas").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    until(page, "document.getElementById('point').textContent.includes('slope x')")
    words = page.inner_text("#point")
    assert "measured" in words
    assert 150 < float(words.split("depth")[1].split()[0]) < 201


def test_every_control_acts_and_is_in_the_recording(page, folder):
    def fill(method: str, **values: Any) -> None:
        page.click(f"[data-method='{method}']")
        for name, value in values.items():
            page.fill(f"#ask input[name='{name}']", str(value))
        page.click("#ask button[value='yes']")

    page.keyboard.press("p")
    until(page, "zeromethod.values.paused && zeromethod.values.state === 'paused'")
    page.click("[data-method='resume']")
    until(page, "!zeromethod.values.paused")
    fill("gain", value=0.8)
    until(page, "zeromethod.values.gain === 0.8")
    fill("target", contrast=0.75)
    until(page, "zeromethod.values.contrast === 0.75")
    page.click("[data-method='zero']")
    until(page, "document.getElementById('said').textContent.startsWith('no new zero: ')")
    fill("mark", note="weight on")
    until(page, "document.getElementById('events').textContent.includes('weight on')")
    page.click("[data-method='snapshot']")
    until(page, "document.getElementById('said').textContent.includes('.npz')")
    fill("exposure", value=5)
    until(page, "document.querySelector('#ask .error')?.textContent.includes('cannot change it')")
    page.click("#ask button[value='no']")
    page.click("[data-method='stop_recording']")
    until(page, "zeromethod.values.recording === ''")
    fill("record", file="second.h5", note="after lunch")
    until(page, "zeromethod.values.recording === 'second.h5'")
    page.click("[data-method='stop_recording']")
    until(page, "zeromethod.values.recording === ''")
    calls = recorded(folder / "run.h5")
    method, _, outcome = calls.pop(4)  # of a mirror that is pressed there is no zero
    assert method == "zero"
    assert outcome.startswith("refused: no new zero: something presses")
    assert calls == [
        ("pause", {}, "done"),
        ("resume", {}, "done"),
        ("gain", {"value": 0.8}, "done"),
        ("target", {"contrast": 0.75}, "done"),
        ("mark", {"note": "weight on"}, "done"),
        ("snapshot", {"note": ""}, "done"),
        ("exposure", {"value": 5}, "refused: exposure: CalmCamera cannot change it during a run: end it "
         "and give --exposure"),
    ]  # fmt: skip
    # the first file may have been closed only when the second was there: then that stands before it
    assert ("record", {"file": "second.h5", "note": "after lunch"}, "done") in recorded(folder / "second.h5")
    assert list(folder.glob("snapshot-*.png"))


def test_keys_are_listed_under_a_question_mark_and_the_looks_change(page):
    page.keyboard.press("?")
    words = page.inner_text("#help")
    assert all(one.doc in words for one in METHODS if one.key)
    page.keyboard.press("Escape")
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.keyboard.press("d")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != before
    page.keyboard.press("d")


def test_all_is_in_view_at_1280_by_800_and_nothing_jumps(page):
    places = """Array.from(document.querySelectorAll('.panel, #controls, #figures > div'))
        .filter((one) => one.offsetParent).map((one) => { const b = one.getBoundingClientRect();
        return [one.id, ...[b.left, b.top, b.right, b.bottom].map(Math.round)]; })"""
    before = page.evaluate(places)
    assert all(left >= 0 and top >= 0 and right <= 1280 and low <= 800 for _, left, top, right, low in before)
    number = page.evaluate("zeromethod.contents")
    until(page, f"zeromethod.contents > {number} + 10")
    assert page.evaluate(places) == before


def test_a_second_viewer_may_only_look_and_a_reload_comes_back(page, chromium, run):
    with tab(chromium, run.urls["view only"]) as other:
        until(other, "zeromethod.values.state && zeromethod.contents > 2")
        assert other.eval_on_selector_all("[data-method]", "all => all.every((one) => one.disabled)")
        other.keyboard.press("p")
        until(page, "zeromethod.contents > 10")
        assert not page.evaluate("zeromethod.values.paused")
    step = page.evaluate("zeromethod.values.step")
    page.reload()
    until(page, f"zeromethod.values.step > {step}")
    assert page.evaluate("document.getElementById('events').children.length") > 0


def test_a_page_whose_run_is_over_says_so_and_shows_nothing_as_live(chromium, run):
    opened = chromium.new_page()
    opened.goto(run.urls["view"])
    until(opened, "zeromethod.values.state === 'locked'")
    opened.keyboard.press("q")
    opened.click("#ask button[value='yes']")
    # on a busy machine it may say first that nothing comes
    until(opened, "document.getElementById('banner').innerText.includes('the run is over')")
    assert opened.evaluate("document.body.classList.contains('stale')")
    opened.close()
    assert run.process.wait(60) == 0
