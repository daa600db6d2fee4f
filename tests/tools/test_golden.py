"""What `make golden` says of two runs: each kind of difference by its name, and nothing of equal runs."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import pytest

from tools.golden.compare import differences
from tools.golden.table import Table, add, load, save


class State(StrEnum):
    NULLING = "nulling"
    LOCKED = "locked"


class Place(NamedTuple):
    x_mm: float
    outline_mm: Any


@dataclass(frozen=True)
class Step:
    state: State
    depth_mm: Any
    contacts: tuple[Place, ...] = ()
    peak: Place | None = None
    loop_ms: float = 0.0


def steps() -> list[Step]:
    """Four frames: no contact, none, one, two; no two borders have as many points."""
    depth = np.array([[np.nan, 0.1], [0.2, 0.0]])
    places = [Place(1.0, np.zeros((number, 2))) for number in range(5)]
    states = [State.NULLING, State.NULLING, State.LOCKED, State.LOCKED]
    contacts = [(), (), (places[1],), (places[2], places[3])]
    return [Step(states[n], depth + n, contacts[n], places[n]) for n in range(4)]


def table(run: list[Any]) -> Table:
    made: Table = {}
    for number, step in enumerate(run):
        add(made, number, step)
    return made


def said(run: list[Any], renames: dict[str, str] | None = None) -> list[str]:
    return list(differences(table(steps()), table(run), renames))


def test_equal_runs_differ_in_nothing_also_when_they_were_stored(tmp_path):
    save(table(steps()), tmp_path / "run.npz")
    assert list(differences(load(tmp_path / "run.npz"), table(steps()))) == []
    assert said([replace(step, loop_ms=step.depth_mm[1, 0]) for step in steps()]) == []


def test_a_changed_value_is_named_with_its_first_frame_and_by_how_much():
    run = steps()
    run[2].depth_mm[0, 1] = np.nextafter(2.1, 3.0)  # by its last bit, 2 ** -51
    assert said(run) == ["depth_mm: 1 of 4 frames from 2, at most 4.44e-16 (2e-16 of the largest)"]


def test_a_value_that_is_no_longer_known_is_named():
    run = steps()
    run[1] = replace(run[1], depth_mm=np.full((2, 2), np.nan))
    assert said(run) == ["depth_mm: 1 of 4 frames from 1, 3 of 4 finite in one only"]


def test_a_missing_frame_is_named():
    assert "state: missing in 1 frames from 3" in said(steps()[:-1])


def test_a_renamed_state_is_named():
    run = [replace(step, state="locked on" if step.state is State.LOCKED else step.state) for step in steps()]
    assert said(run) == ["state: 2 of 4 frames from 2, locked -> locked on"]


@pytest.mark.parametrize("renames", [{}, {"peak": "deepest"}])
def test_a_dropped_field_and_a_new_one_are_named_unless_it_was_renamed(renames):
    run = [{**vars(step), "deepest": step.peak, "peak": None} for step in steps()]
    gone = ["deepest.outline_mm: new, in 4 frames", "deepest.x_mm: new, in 4 frames"]
    gone += ["peak.outline_mm: gone, in 4 frames", "peak.x_mm: gone, in 4 frames"]
    assert said(run, renames) == ([] if renames else gone)


def test_contacts_are_one_name_whichever_differs():
    run = steps()
    run[3] = replace(run[3], contacts=(run[3].contacts[0], Place(1.5, np.zeros((3, 2)))))
    assert said(run) == ["contacts[].x_mm: 1 of 2 frames from 3, at most 0.5 (0.5 of the largest)"]


def test_what_is_neither_a_record_nor_a_value_is_refused():
    with pytest.raises(TypeError, match="range: neither a record nor a value"):
        add({}, 0, {"frames": range(3)}, "step")
