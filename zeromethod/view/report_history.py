"""What happened in a recording, and when: its states one after the other, drops, faults, events."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from zeromethod.arrays import Float
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.recording.recording import Recording
from zeromethod.view.live import EXPLAINED

WITHOUT_READING = (Event.NOT_LIT, Event.PICTURES_MIXED)
"""Frames that are no fault, but whose picture is not known, so that nothing is read from them."""

TOGETHER_S = 1.0
"""Equal events that are no further apart make one line."""


@dataclass(frozen=True)
class Episode:
    """A time in one state, from `start_s` until the step that ended it, at `end_s`: s from the first step."""

    start_s: float
    end_s: float
    state: State
    reason: str


@dataclass(frozen=True)
class Happening:
    """What happened `count` times between `start_s` and `end_s` (s from the first step), and why."""

    start_s: float
    end_s: float
    what: str
    count: int
    why: str


def seconds(recording: Recording, rows: Any) -> Float:
    """Times of rows of a table, s from the first step."""
    steps = recording.turns
    found: Float = 1e-9 * (rows["time_ns"] - (steps["time_ns"][0] if len(steps) else 0))
    return found


def episodes(recording: Recording) -> list[Episode]:
    """The states one after the other, without gaps."""
    steps = recording.steps
    rows = zip(
        seconds(recording, steps).tolist(), map(recording.state_of, steps), steps["reason"], strict=True
    )
    starts = [next(group) for _, group in groupby(rows, key=lambda row: row[1])]
    ends = [start_s for start_s, _, _ in starts[1:]] + [recording.seconds]
    return [
        Episode(start_s, end_s, state, recording.text(reason))
        for (start_s, state, reason), end_s in zip(starts, ends, strict=False)
    ]


def shares(states: Sequence[Episode]) -> dict[State, float]:
    """Share of the time in each state, the largest first; of the episodes, where no time has passed."""
    spent: dict[State, float] = {}
    for one in states:
        spent[one.state] = spent.get(one.state, 0.0) + max(one.end_s - one.start_s, 0.0)
    whole = sum(spent.values())
    if not whole:
        return {state: 1.0 / len(spent) for state in spent}
    return {
        state: spent[state] / whole for state in sorted(spent, key=lambda one: -spent[one]) if spent[state]
    }


def happenings(recording: Recording) -> list[Happening]:
    """Drops, events of the steps and the states that need a reason, by time."""
    explained = [
        Happening(one.start_s, one.end_s, one.state, 1, one.reason)
        for one in episodes(recording)
        if one.state in EXPLAINED
    ]
    found = [one for one in merged([*_dropped(recording), *_events(recording)]) if one.count]
    return sorted(found + explained, key=lambda one: (one.start_s, one.what))


def _dropped(recording: Recording) -> Iterator[Happening]:
    drops, text = recording.drops, recording.text
    for at_s, drop in zip(seconds(recording, drops).tolist(), drops, strict=True):
        what = f"dropped: {text(drop['lost_by'])}"
        yield Happening(at_s, at_s, what, int(drop["count"]), text(drop["reason"]))


def _events(recording: Recording) -> Iterator[Happening]:
    """Events of the steps, but for dropped frames, which are records of their own."""
    steps = recording.steps[recording.steps["events"] != 0]
    for at_s, step in zip(seconds(recording, steps).tolist(), steps, strict=True):
        for event in recording.events_of(step):
            if event != Event.FRAMES_DROPPED:
                what = f"no new reading: {event}" if event in WITHOUT_READING else str(event)
                yield Happening(at_s, at_s, what, 1, recording.text(step["reason"]))


def merged(single: Sequence[Happening]) -> list[Happening]:
    """The same, with equal ones close together made into one; those of one kind are given by time."""
    groups: list[list[Happening]] = []
    newest: dict[str, list[Happening]] = {}
    for one in single:
        group = newest.get(one.what)
        if group is None or one.start_s - group[-1].end_s > TOGETHER_S:
            group = newest[one.what] = []
            groups.append(group)
        group.append(one)
    return [_as_one(group) for group in groups]


def _as_one(group: list[Happening]) -> Happening:
    first, last = group[0], group[-1]
    reasons = list(dict.fromkeys(one.why for one in group if one.why)) or [""]
    more = f", and {len(reasons) - 1} more" if len(reasons) > 1 else ""
    count = sum(one.count for one in group)
    return Happening(first.start_s, last.end_s, first.what, count, reasons[0] + more)
