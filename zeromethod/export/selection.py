"""What an export needs: the steps selected, parts of the recording, libraries (extra `export`)."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Ints
from zeromethod.errors import InputError
from zeromethod.export.source import MapSource
from zeromethod.recording.recording import Recording


@dataclass(frozen=True, slots=True)
class SelectedSteps:
    """Turns in the order of time.

    steps: (n,) numbers. time_ns: mid-exposure on the run's clock. time_s: since the recording's first step.
    unix_ns: Unix time, from when the recording was begun. states: the loop's state after each.
    """

    steps: Ints
    time_ns: Ints
    time_s: Float
    unix_ns: Ints
    states: tuple[str, ...]

    @property
    def interval_s(self) -> float:
        """Median time from one to the next; 0 for a single one."""
        return float(np.median(np.diff(self.time_s))) if len(self.steps) > 1 else 0.0


@dataclass(frozen=True, slots=True)
class Selection:
    """What the user wants of a recording: seconds since its first step, both ends included; every n-th."""

    from_s: float | None = None
    to_s: float | None = None
    every: int = 1
    at_s: float | None = None

    def __post_init__(self) -> None:
        """Refuse impossible times."""
        for option, value in (("--from", self.from_s), ("--to", self.to_s), ("--at", self.at_s)):
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{option}: {value:g}: seconds since the recording's first step, 0 or more")
        if self.from_s is not None and self.to_s is not None and self.from_s > self.to_s:
            raise InputError(f"--from: {self.from_s:g}: must not be after --to ({self.to_s:g})")

    def several(self, recording: Recording, groups: Sequence[str] = ()) -> SelectedSteps:
        """Turns that one of the groups has arrays of; every step without groups. Raises InputError: none."""
        kept = np.concatenate([recording.steps_with(group) for group in groups]) if groups else None
        return self.among(recording, kept, " or ".join(groups) or "step")

    def among(self, recording: Recording, numbers: Ints | None, what: str) -> SelectedSteps:
        """Turns of these numbers (None: all), of which each has a `what`. Raises InputError: none."""
        return _selected(recording, self._within(recording, numbers, what)[:: self.every])

    def one(self, source: MapSource) -> SelectedSteps:
        """The step with a surface next to `at_s`; without, the one with the peak of largest |depth|.

        Raises InputError where there is no surface.
        """
        recording, numbers = source.recording, source.recording.steps_with(source.group)
        if self.at_s is not None:
            if self.at_s > recording.seconds:
                raise InputError(f"--at: {self.at_s:g}: the recording ends at {recording.seconds:.3f} s")
            found = Selection()._within(recording, numbers, source.group)
            times = _selected(recording, found).time_s
            return _selected(recording, found[[int(np.argmin(np.abs(times - self.at_s)))]])
        found = self._within(recording, numbers, source.group)
        deepest = source.deepest(found)
        return _selected(recording, found[-1:] if deepest is None else found[found["number"] == deepest])

    def _within(self, recording: Recording, numbers: Ints | None, what: str) -> NDArray[np.void]:
        steps = recording.turns
        if not len(steps):
            lost = recording.tables.left_out().get("steps", 0)
            why = f"all {lost} rows of its steps are damaged" if lost else "nothing was recorded yet"
            raise InputError(f"{recording.path}: {why}")
        if numbers is not None:
            steps = steps[np.isin(steps["number"], numbers)]
        time_s = 1e-9 * (steps["time_ns"] - recording.turns["time_ns"][0])
        low = -math.inf if self.from_s is None else self.from_s
        high = math.inf if self.to_s is None else self.to_s
        found: NDArray[np.void] = steps[(time_s >= low) & (time_s <= high)]
        if not len(found):
            raise InputError(
                f"{recording.path}: no {what} recorded from {max(low, 0.0):g} to "
                f"{min(high, recording.seconds):.3f} s; the recording is {recording.seconds:.3f} s long"
            )
        return found


def require(recording: Recording, parts: Sequence[str], purpose: str) -> None:
    """Refuse a recording that was made without these parts."""
    missing = [part for part in parts if part not in recording.kept]
    if missing:
        kept = ", ".join(sorted(recording.kept)) or "the tables alone"
        raise InputError(
            f"{recording.path}: {purpose} needs {', '.join(parts)}: {', '.join(missing)} not kept "
            f"by the run's --keep (kept: {kept})"
        )


def needed(module: str) -> Any:
    """Import a module of the extra. Raises InputError that says how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise InputError(f"export: needs the library {library}: pip install 'zeromethod[export]'") from error


def _selected(recording: Recording, rows: NDArray[np.void]) -> SelectedSteps:
    since_ns = rows["time_ns"] - recording.turns["time_ns"][0]
    started = datetime.fromisoformat(recording.started_utc)
    unix_ns = round(started.timestamp() * 1e6) * 1000 + since_ns
    states = tuple(recording.state_of(row).value for row in rows)
    return SelectedSteps(rows["number"], rows["time_ns"], 1e-9 * since_ns, unix_ns, states)
