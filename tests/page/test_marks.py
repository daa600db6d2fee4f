"""What the page makes of states: nothing that does not count looks good, and all of it fits."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browsing import browser, needs_browser, tab

from zeromethod.loop.state import GOOD, READ, State
from zeromethod.operating.advice import ADVICE, FRESH, LATE_S, doubt_of
from zeromethod.operating.readings import HISTORY, history_row
from zeromethod.operating.run_table import RUN
from zeromethod.page.message import Content
from zeromethod.page.process import PageProcess

COUNTS = {*READ, State.NULLING, State.STARTING}
LATTICE = {"first": [8.0, 8.0], "spacing": 16.0, "image": [320, 256]}


def values(state: State, late_s: float = 0.0, **others: Any) -> dict[str, Any]:
    found = dict.fromkeys(one.name for one in RUN.values)
    found |= {"state": state.value, "reason": "why it is so", "advice": ADVICE[state], "time_s": 9.0}
    found |= {"peak_mm": 0.2, "peak_sigma_mm": 1e-4, "peak_time_s": 9.0 - late_s, "calibrated": True}
    found |= {"fresh": state in FRESH and late_s <= LATE_S, "doubt": doubt_of(state, late_s)}
    return found | {"recording": "", "paused": False, "contacts": []} | others


@pytest.mark.parametrize("state", State)
def test_depth_is_in_doubt_unless_frames_are_measured_and_read(state):
    assert (doubt_of(state, 0.1) == "") == (state in COUNTS)
    assert doubt_of(state, None) == doubt_of(state, 0.1)
    assert doubt_of(state, 1.5 * LATE_S)


def test_the_history_has_no_depth_where_it_does_not_count():
    at = HISTORY.index("peak_mm")
    assert history_row(values(State.LOCKED))[at] == 0.2
    assert history_row(values(State.PAUSED))[at] == 0.2
    for held in (values(State.MOVED), values(State.LOST), values(State.LOCKED, late_s=2.0)):
        assert history_row(held)[at] is None
        assert history_row(held)[HISTORY.index("time_s")] == 9.0


class Shown:
    """A page that is shown what is given to it."""

    def __init__(self, page: Any, process: PageProcess) -> None:
        self.page, self._process = page, process
        self._contents = 0

    def show(self, given: dict[str, Any], kind: int = 1) -> None:
        """Show these values with a surface of nodes of a kind, and wait until they are on the screen."""
        self._contents += 1
        later = {name: given[name] + self._contents for name in ("time_s", "peak_time_s")}
        given = given | later | {"step": self._contents}
        depth = 1e-3 * np.arange(15 * 20, dtype=np.float32).reshape(15, 20)
        maps = dict.fromkeys(("depth", "sigma", "x", "y"), depth)
        maps |= {"slope": np.zeros((15, 20, 2), np.float32), "kind": np.full((15, 20), kind, np.uint8)}

        def compose(parts: frozenset[str]) -> Content:
            meta = {"surface": {"lattice": LATTICE, "time_s": 9.0, "outlines": [], "peak_node": [9, 9]}}
            return Content(given, [], {}, {"surface": maps}, meta)

        self._process.offer(compose)
        until_s = time.monotonic() + 30
        cell = "Number(document.querySelector('#values [data-value=step]')?.textContent)"
        while self.page.evaluate(cell) != self._contents:
            assert time.monotonic() < until_s
            self.page.wait_for_timeout(20)

    def text(self, selector: str) -> str:
        found: str = self.page.eval_on_selector(selector, "one => one.hidden ? '' : one.textContent")
        return found

    @property
    def classes(self) -> set[str]:
        return set(self.page.evaluate("Array.from(document.body.classList)"))


@pytest.fixture(scope="module")
def shown() -> Iterator[Shown]:
    with (
        PageProcess(RUN, HISTORY, view=("127.0.0.1", 0)) as process,
        browser() as opened,
        tab(opened, process.url) as page,
    ):
        yield Shown(page, process)


@needs_browser
def test_no_state_looks_good_while_depth_does_not_count(shown):
    for state in State:
        shown.show(values(state))
        shown.show(values(state))  # what lasts less than 0.3 s is not shown
        level = shown.page.evaluate("document.body.dataset.level")
        assert (level == "good") == (state in GOOD), state
        assert shown.text("#depth .badge") == doubt_of(state, 0.0)
        struck = shown.page.evaluate("getComputedStyle(document.querySelector('#peak')).textDecorationLine")
        assert (struck == "line-through") == (state not in COUNTS | {State.PAUSED}), state
        assert shown.text("#state [data-value]") == state.value
        assert shown.text("#why strong") == ADVICE[state]


@needs_browser
def test_a_reading_that_is_late_is_marked_though_the_loop_is_locked(shown):
    shown.show(values(State.LOCKED))
    assert "doubted" not in shown.classes
    shown.show(values(State.LOCKED, late_s=1.2))
    assert "doubted" in shown.classes
    assert shown.page.evaluate("document.body.dataset.level") == "warn"
    assert shown.text("#solid .badge") == "held: read 1.2 s ago"


@needs_browser
def test_not_calibrated_is_said_where_depth_is_and_everything_fits(shown):
    shown.show(values(State.LOCKED))
    assert shown.text("#uncalibrated") == ""
    for state in (State.UNCALIBRATED, State.MOVED):
        shown.show(values(state, calibrated=False, reason="a reason that is much longer than usual, " * 4))
        assert "NOT CALIBRATED" in shown.text("#uncalibrated")
        assert "relative" in shown.text("#peak-name")
        assert shown.text("#depth .badge")
        boxes = "header > *, #figures > div, #uncalibrated, #why strong"
        places = """(boxes) => Array.from(document.querySelectorAll(boxes)).map((one) => {
            const b = one.getBoundingClientRect();
            return [one.id, b.left, b.right, one.scrollWidth - one.clientWidth]; })"""
        for name, left, right, over in shown.page.evaluate(places, boxes):
            assert left >= 0, name
            assert right <= 1280, name
            assert over <= 1, name


@needs_browser
def test_nodes_that_were_not_measured_are_hatched(shown):
    def grey() -> int:
        found: int = shown.page.evaluate(
            """(() => { const c = document.getElementById('depth-canvas');
            const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let n = 0;
            for (let i = 0; i < d.length; i += 4) n += d[i] === 128 && d[i + 1] === 128 && d[i + 2] === 128;
            return n; })()"""
        )
        return found

    shown.show(values(State.LOCKED))
    assert grey() < 50
    assert shown.text("#kinds-note") == ""
    shown.show(values(State.LOCKED), kind=3)
    assert grey() > 500
    assert "not measured" in shown.text("#kinds-note")
