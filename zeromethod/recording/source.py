"""Reading a recording's file, with a checksum for everything that may be damaged."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zeromethod.arrays import Image, Ints, Mask
from zeromethod.errors import InputError, check_type
from zeromethod.recording.checksums import CHECKSUMS, checksum_of, checksums_of
from zeromethod.recording.opening import Refusal, RefusedRecording, open_along

_FAULTS = (OSError, RuntimeError, KeyError, ValueError, TypeError, IndexError, MemoryError)
"""Exceptions that reading a damaged file may raise."""


class DamagedWarning(UserWarning):
    """Arrays of a recording are damaged and left out."""


class RecordingFile:
    """The file, open for reading. Parts that cannot be read raise RefusedRecording, one line."""

    def __init__(self, path: str | Path) -> None:
        """Open it. Raises InputError, RefusedRecording."""
        check_type("recording", path, str | Path, "a file that a session recorded (.h5)")
        self.path = Path(path)
        self._warned: set[str] = set()
        self._silent = False
        self.left_out: dict[str, set[int]] = {}
        self._open()

    def _open(self) -> None:
        self._state = self._look()
        self._file = open_along(self.path)
        self._tables: dict[str, Image] = {}
        self._sound_rows: dict[str, Mask] = {}
        try:
            self._parts = self._visited()
            self.names = frozenset(self._parts)
        except BaseException:
            self._file.close()
            raise

    def _look(self) -> tuple[int, int, int] | None:
        """Changes with every write into the file."""
        try:
            found = os.stat(self.path)
        except OSError:
            return None  # the name is gone; the open file can still be read
        return found.st_ino, found.st_size, found.st_mtime_ns

    def _visited(self) -> dict[str, Any]:
        """All groups and datasets by their name, open: to open one takes longer than to read an item."""
        parts: dict[str, Any] = {}
        with self._guarded("its contents"):
            left = list(self._file)
        while left:
            name = left.pop()
            with self._guarded(name):
                parts[name] = one = self._file[name]
                if isinstance(one, h5py.Group):
                    left += [f"{name}/{inner}" for inner in one]
        return parts

    @contextmanager
    def _guarded(self, name: str) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except _FAULTS:
            raise RefusedRecording(self.path, Refusal.DAMAGED, part=name) from None

    @contextmanager
    def silence(self) -> Iterator[None]:
        """Neither warn nor count what is left out meanwhile."""
        self._silent = True
        try:
            yield
        finally:
            self._silent = False

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()

    def refresh(self) -> None:
        """See what was written since the file was opened, or since the last call."""
        self._tables.clear()
        self._sound_rows.clear()
        if self._file.swmr_mode:
            for name, one in self._parts.items():
                with self._guarded(name):
                    if isinstance(one, h5py.Dataset):
                        one.refresh()
        elif (now := self._look()) is not None and now != self._state:
            # it was opened before a writer did
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
            return int(self._parts[name].shape[0])

    def read(self, name: str, at: Any = ()) -> Any:
        """A dataset, or an item or a slice of it."""
        with self._guarded(name):
            return self._parts[name][at]

    def whole(self, name: str) -> Any:
        """A dataset of fixed size; refused where it does not fit its checksum."""
        values = self.read(name)
        with self._guarded(name):
            checksum = self._parts[name].attrs.get("checksum")
        if checksum is not None and int(checksum) != checksum_of(values):
            raise RefusedRecording(self.path, Refusal.CHANGED, part=name)
        return values

    def is_whole(self, name: str, instead: Image | None = None) -> bool:
        """Whether a dataset of fixed size fits its checksum; or `instead`, which is then what was written."""
        try:
            values = self.read(name) if instead is None else instead
            with self._guarded(name):
                return int(self._parts[name].attrs["checksum"]) == checksum_of(values)
        except InputError:
            return False

    def table(self, name: str) -> Image:
        """All of a dataset that grows, as it was at the last `refresh`."""
        if name not in self._tables:
            self._tables[name] = self.read(name)
        return self._tables[name]

    def words(self, name: str, attribute: str) -> list[str]:
        """An attribute of a dataset that is a list of words."""
        with self._guarded(name):
            return [str(word) for word in self._parts[name].attrs[attribute]]

    def sound_rows(self, group: str) -> Mask:
        """(n,) which rows of a group's table fit their checksums, of those that have one; no warning."""
        if group not in self._sound_rows:
            rows, checksums = self.table(f"{group}/table"), self.checksums(group)
            if checksums is None:
                self._sound_rows[group] = np.ones(len(rows), np.bool_)
            else:
                count = min(len(rows), len(checksums))
                self._sound_rows[group] = checksums_of(rows[:count]) == checksums["table"][:count]
        return self._sound_rows[group]

    def rows(self, group: str) -> Image:
        """Rows of a group's table, without those that are damaged, of which it warns once."""
        sound = self.sound_rows(group)
        rows = self.table(f"{group}/table")[: len(sound)]
        if sound.all():
            return rows
        self._leave_out(group, np.flatnonzero(~sound).tolist())
        self._warn(group, "table")
        return np.asarray(rows[sound])

    def damaged_rows(self, group: str) -> Image:
        """Rows of a group's table that are not what was written, as they are."""
        sound = self.sound_rows(group)
        return np.asarray(self.table(f"{group}/table")[: len(sound)][~sound])

    def items(self, group: str, index: int, names: Sequence[str]) -> dict[str, Any]:
        """Items of a group's datasets, without those that are damaged; each dataset warns of it once."""
        found: dict[str, Any] = {}
        checksums = self._row(group, index)
        for name in names:
            item = self._sound(group, name, index, checksums)
            if item is None:
                self._leave_out(group, [index])
                self._warn(group, name)
            else:
                found[name] = item
        return found

    def is_table(self, name: str) -> bool:
        """Whether the items of a dataset that grows are rows, not arrays."""
        with self._guarded(name):
            return len(self._parts[name].shape) == 1

    def is_damaged(self, group: str, index: int) -> bool:
        """Whether any item of that index in a group does not fit its checksum; without a warning."""
        checksums = self._row(group, index)
        return not all(self.is_sound(group, name, index, checksums) for name in self.summed(group))

    def is_sound(self, group: str, name: str, index: int, checksums: Any) -> bool:
        """Whether an item can be read and fits its checksum. checksums: its group's row, if any."""
        return self._sound(group, name, index, checksums) is not None

    def summed(self, group: str) -> list[str]:
        """Names within a group of its datasets other than the checksums."""
        return [name.rpartition("/")[2] for name in self.group(group) if not name.endswith(f"/{CHECKSUMS}")]

    def checksums(self, group: str) -> Image | None:
        """Checksums of a group's items, a row for each; None where it has none."""
        return self.table(f"{group}/{CHECKSUMS}") if f"{group}/{CHECKSUMS}" in self.names else None

    def _row(self, group: str, index: int) -> Any:
        checksums = self.checksums(group)
        return None if checksums is None else checksums[index]

    def _sound(self, group: str, name: str, index: int, checksums: Any) -> Any:
        """An item; None where it is damaged."""
        try:
            item = self.read(f"{group}/{name}", index)
        except InputError:
            return None
        summed = checksums is not None and name in checksums.dtype.names
        return None if summed and int(checksums[name]) != checksum_of(item) else item

    def numbers(self, group: str, name: str, length: int) -> Ints:
        """Numbers of the first `length` items of a group; -1 where that is damaged."""
        values: Ints = self.table(f"{group}/{name}")[:length]
        checksums = self.checksums(group)
        if checksums is None:
            return values
        # the checksum of one word: its size plus itself
        sound = checksums[name][:length] == values.astype(np.uint64) + np.uint64(8)
        if not sound.all():
            self._leave_out(group, np.flatnonzero(~sound).tolist())
            self._warn(group, name)
        return np.where(sound, values, -1)

    def group(self, name: str) -> list[str]:
        """Names of the datasets right in a group."""
        return sorted(one for one in self.names if one.rpartition("/")[0] == name)

    def leave_out_whole(self, group: str, name: str) -> None:
        """Count a dataset of fixed size as left out, and warn of it once."""
        self._leave_out(group, [self.group(group).index(f"{group}/{name}")])
        self._warn(group, name)

    def _leave_out(self, group: str, indices: Sequence[int]) -> None:
        if not self._silent:
            self.left_out.setdefault(group, set()).update(indices)

    def _warn(self, group: str, name: str) -> None:
        dataset = f"{group}/{name}"
        if self._silent or dataset in self._warned:
            return
        words = f"{self.path}: {dataset}: damaged: items that do not fit their checksum are left out"
        warnings.warn(words, DamagedWarning, stacklevel=5)
        # after the warning: as an error it is raised every time
        self._warned.add(dataset)
