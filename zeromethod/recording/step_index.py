"""Which arrays of a recording belong to which step."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from zeromethod.arrays import Ints
from zeromethod.recording.columns import TABLES
from zeromethod.recording.damage import damaged_items
from zeromethod.recording.schema import number_name
from zeromethod.recording.source import RecordingFile


class StepIndex:
    """Items of a file's groups by the number of their step; of `pictures` by that of their row."""

    def __init__(self, source: RecordingFile) -> None:
        self._source = source
        self.measure()

    def measure(self) -> None:
        """See how long the datasets are now."""
        self._rows: dict[str, dict[int, int]] = {}
        self._lengths = {name: self._length(name) for name in self._groups}

    @cached_property
    def _groups(self) -> list[str]:
        """Names of the tables, and of the groups whose items belong to steps, pictures to rows of a table."""
        names = self._source.names
        groups = {name.rpartition("/")[0] for name in names}
        return sorted(group for group in groups if group and (group in TABLES or number_name(group) in names))

    def _length(self, group: str) -> int:
        """Items that all datasets of a group have."""
        return min(self._source.length(name) for name in self._source.group(group))

    def holds(self, group: str) -> bool:
        """Whether a group was kept, of any step."""
        return self._lengths.get(group, 0) > 0

    def at(self, group: str, step: int) -> int | None:
        """Index in a group of the items that belong to a step."""
        if group not in self._lengths:
            return None
        if group not in self._rows:
            self._rows[group] = {int(number): i for i, number in enumerate(self.numbers(group))}
        return self._rows[group].get(int(step))

    def numbers(self, group: str) -> Ints:
        """Numbers of a group's items; -1 where they are not known."""
        if group not in self._lengths:
            return np.zeros(0, np.int64)
        name = number_name(group).rpartition("/")[2]
        return self._source.numbers(group, name, self._lengths[group])

    def arrays(self, group: str, step: int, *names: str) -> list[Any] | None:
        """Arrays of a step; None where one of them is missing or damaged."""
        if (index := self.at(group, step)) is None:
            return None
        found = self._source.items(group, index, names)
        return [found[name] for name in names] if len(found) == len(names) else None

    def is_damaged(self, group: str, number: int) -> bool:
        """Whether a group has damaged arrays of a step."""
        index = self.at(group, number)
        return index is not None and self._source.is_damaged(group, index)

    def damaged(self, advance: Callable[[], None]) -> dict[str, int]:
        """Number of damaged items by group; reads the whole file."""
        return damaged_items(self._source, self._lengths, advance)
