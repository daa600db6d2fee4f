"""What happened in a recording, and when: states in turn, drops, faults, events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.loop.events import Event
from zeromethod.recording.recording import Recording
from zeromethod.view.live import EXPLAINED

WITHOUT_READING = (Event.NOT_LIT, Event.PICTURES_MIXED)
"""Frames that are no fault, but whose picture is not known, so that nothing is read from them."""

TOGETHER_S = 1.0
"""Equal events that are no further apart make one line."""


@dataclass(frozen=True)
class Episode:
    """A time in one state, from `start_s` until the turn that ended it, at `end_s`: s from the first turn."""

    start_s: float
    end_s: float
    state: str
    reason: str


@dataclass(frozen=True)
class Happening:
    """What happened `count` times between `start_s` and `end_s` (s from the first turn), and why."""

    start_s: float
    end_s: float
    what: str
    count: int
    why: str


def words(value: Any) -> str:
    """Text of a fixed-length field."""
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)


def seconds(times_ns: Any, start_ns: int) -> Float:
    """Times as s from `start_ns`."""
    return np.asarray(1e-9 * (np.asarray(times_ns, dtype=np.int64) - start_ns), dtype=np.float64)


def start_ns(recording: Recording) -> int:
    """Time of the first turn; 0 without any."""
    turns = recording.steps
    return int(turns["time_ns"][0]) if len(turns) else 0


def at_turns(recording: Recording, numbers: Ints) -> tuple[NDArray[np.intp], Mask]:
    """Rows of the steps with these numbers, and which of them there are (a killed writer may lose some)."""
    known = recording.steps["number"]
    if not len(known):
        return np.zeros(len(numbers), dtype=np.intp), np.zeros(len(numbers), dtype=bool)
    index = np.minimum(np.searchsorted(known, numbers), len(known) - 1)
    return index, known[index] == numbers


def states(recording: Recording) -> NDArray[np.str_]:
    """(turns,) names of the states."""
    turns = recording.steps
    codes, first, index = np.unique(turns["state"], return_index=True, return_inverse=True)
    if not len(codes):
        return np.zeros(0, dtype=str)
    return np.array([str(recording.state_of(turns[i])) for i in first])[index]


def episodes(recording: Recording) -> list[Episode]:
    """The states in turn, without gaps."""
    turns, names = recording.steps, states(recording)
    if not len(turns):
        return []
    time_s = seconds(turns["time_ns"], start_ns(recording))
    starts = np.concatenate([[0], 1 + np.flatnonzero(names[1:] != names[:-1])])
    ends = np.append(time_s[starts[1:]], time_s[-1])
    return [
        Episode(float(time_s[i]), float(end), str(names[i]), words(turns["reason"][i]))
        for i, end in zip(starts, ends, strict=True)
    ]


def shares(states_in_turn: list[Episode]) -> dict[str, float]:
    """Share of the time in each state, the largest first; of the episodes, where no time has passed."""
    spent: dict[str, float] = {}
    for one in states_in_turn:
        spent[one.state] = spent.get(one.state, 0.0) + max(one.end_s - one.start_s, 0.0)
    whole = sum(spent.values())
    if not whole:
        return {state: 1.0 / len(spent) for state in spent}
    there = sorted((state for state in spent if spent[state]), key=lambda state: -spent[state])
    return {state: spent[state] / whole for state in there}


def happenings(recording: Recording) -> list[Happening]:
    """Drops, events of the turns and the states that need a reason, by time."""
    drops = [one for one in merged(_dropped(recording)) if one.count]
    explained = [
        Happening(one.start_s, one.end_s, one.state, 1, one.reason)
        for one in episodes(recording)
        if one.state in EXPLAINED
    ]
    found = drops + merged(_events(recording)) + explained
    return sorted(found, key=lambda one: (one.start_s, one.what))


def _dropped(recording: Recording) -> list[Happening]:
    drops = recording.drops
    time_s = seconds(drops["time_ns"], start_ns(recording))
    return [
        Happening(
            float(at),
            float(at),
            f"dropped: {words(drop['lost_by'])}",
            int(drop["count"]),
            words(drop["reason"]),
        )
        for at, drop in zip(time_s, drops, strict=True)
    ]


def _events(recording: Recording) -> list[Happening]:
    """Events of the turns, but for dropped frames, which are records of their own."""
    turns = recording.steps
    found = []
    time_s = seconds(turns["time_ns"], start_ns(recording))
    for index in np.flatnonzero(turns["events"]):
        at = float(time_s[index])
        why = words(turns["reason"][index])
        found += [
            Happening(at, at, f"no new reading: {name}" if name in WITHOUT_READING else str(name), 1, why)
            for name in recording.events_of(turns[index])
            if str(name) != Event.FRAMES_DROPPED
        ]
    return found


def merged(single: list[Happening]) -> list[Happening]:
    """The same, by time, with equal ones close together made into one."""
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
