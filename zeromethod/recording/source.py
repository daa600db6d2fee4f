"""What a recording is read from: nothing that is damaged in it passes for what was measured."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zeromethod.arrays import Image, Ints
from zeromethod.errors import InputError
from zeromethod.recording.opening import open_along
from zeromethod.recording.sums import SUMS, sum_of

_FAULTS = (OSError, RuntimeError, KeyError, ValueError, TypeError, IndexError, MemoryError)
"""What reading a damaged file may end in."""


class DamagedWarning(UserWarning):
    """Arrays of a recording are not what was written; they are left out."""


class Source:
    """The file, open for reading; where it cannot be read, that is one line: an InputError."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises InputError."""
        self.path = path
        self._warned: set[str] = set()
        self._open()

    def _open(self) -> None:
        self._state = self._look()
        self._file = open_along(self.path)
        self._tables: dict[str, Image] = {}
        try:
            self.names = self._visited()
        except BaseException:
            self._file.close()
            raise

    def _look(self) -> tuple[int, int, int] | None:
        """What changes with whatever is written into the file."""
        try:
            found = os.stat(self.path)
        except OSError:
            return None  # what is open stays so, though its name be gone
        return found.st_ino, found.st_size, found.st_mtime_ns

    def _visited(self) -> frozenset[str]:
        """Names of all groups and datasets; each is opened, so that one that cannot be is named."""
        names: list[str] = []
        with self._guarded("its contents"):
            left = list(self._file)
        while left:
            name = left.pop()
            names.append(name)
            with self._guarded(name):
                one = self._file[name]
                if isinstance(one, h5py.Group):
                    left += [f"{name}/{inner}" for inner in one]
        return frozenset(names)

    @contextmanager
    def _guarded(self, name: str) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except _FAULTS:
            raise InputError(f"{self.path}: {name}: cannot be read: damaged") from None

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()

    def refresh(self) -> None:
        """Take in what was written since."""
        self._tables.clear()
        if self._file.swmr_mode:
            for name in self.names:
                with self._guarded(name):
                    one = self._file[name]
                    if isinstance(one, h5py.Dataset):
                        one.id.refresh()
        elif (now := self._look()) is not None and now != self._state:
            # it was opened before anybody wrote into it
            self._file.close()
            self._open()

    def attributes(self) -> dict[str, Any]:
        """Attributes of the root."""
        with self._guarded("its attributes"):
            names = list(self._file.attrs)
        found = {}
        for name in names:
            with self._guarded(f"attribute {name}"):
                found[name] = self._file.attrs[name]
        return found

    def length(self, name: str) -> int:
        """Items of a dataset."""
        with self._guarded(name):
            return int(self._file[name].shape[0])

    def read(self, name: str, at: Any = ()) -> Any:
        """A dataset, or an item or a slice of it."""
        with self._guarded(name):
            return self._file[name][at]

    def whole(self, name: str) -> Any:
        """A dataset that was there from the start; refused if it is not what was written then."""
        values = self.read(name)
        with self._guarded(name):
            told = self._file[name].attrs.get("sum")
        if told is not None and int(told) != sum_of(values):
            raise InputError(f"{self.path}: {name}: damaged: not what was written")
        return values

    def table(self, name: str) -> Image:
        """All of a dataset that grows, as it was at the last `refresh`."""
        if name not in self._tables:
            self._tables[name] = self.read(name)
        return self._tables[name]

    def items(self, group: str, index: int, names: Sequence[str]) -> dict[str, Any]:
        """Items of a group's datasets, without those that are damaged; each dataset warns of it once."""
        found: dict[str, Any] = {}
        told = self._told(group, index)
        for name in names:
            item = self._sound(group, name, index, told)
            if item is None:
                self._warn(group, name)
            else:
                found[name] = item
        return found

    def is_table(self, name: str) -> bool:
        """Whether the items of a dataset that grows are rows, not arrays."""
        with self._guarded(name):
            return len(self._file[name].shape) == 1

    def is_damaged(self, group: str, index: int) -> bool:
        """Whether any item of that index in a group is not what was written; without a warning."""
        told = self._told(group, index)
        return not all(self.is_sound(group, name, index, told) for name in self.summed(group))

    def is_sound(self, group: str, name: str, index: int, told: Any) -> bool:
        """Whether an item can be read and is what was written. told: the sums of its group's; None: none."""
        return self._sound(group, name, index, told) is not None

    def summed(self, group: str) -> list[str]:
        """Names within a group of the datasets that it has sums of, or would have."""
        return [name.rpartition("/")[2] for name in self.group(group) if not name.endswith(f"/{SUMS}")]

    def sums(self, group: str) -> Image | None:
        """Sums of a group's items, a row for each; None where it has none."""
        return self.table(f"{group}/{SUMS}") if f"{group}/{SUMS}" in self.names else None

    def _told(self, group: str, index: int) -> Any:
        sums = self.sums(group)
        return None if sums is None else sums[index]

    def _sound(self, group: str, name: str, index: int, told: Any) -> Any:
        """An item; None where it is damaged."""
        try:
            item = self.read(f"{group}/{name}", index)
        except InputError:
            return None
        summed = told is not None and name in told.dtype.names
        return None if summed and int(told[name]) != sum_of(item) else item

    def numbers(self, group: str, name: str, length: int) -> Ints:
        """What numbers the first items of a group, so many; -1 where that is damaged."""
        values: Ints = self.table(f"{group}/{name}")[:length]
        sums = self.sums(group)
        if sums is None:
            return values
        # an item of one word: its size, and itself
        sound = sums[name][:length] == values.astype(np.uint64) + np.uint64(8)
        if not sound.all():
            self._warn(group, name)
        return np.where(sound, values, -1)

    def group(self, name: str) -> list[str]:
        """Names of the datasets right in a group."""
        return sorted(one for one in self.names if one.rpartition("/")[0] == name)

    def _warn(self, group: str, name: str) -> None:
        dataset = f"{group}/{name}"
        if dataset in self._warned:
            return
        words = f"{self.path}: {dataset}: damaged: what is not as it was written is left out"
        warnings.warn(words, DamagedWarning, stacklevel=5)
        # where warnings are errors, every one is
        self._warned.add(dataset)
