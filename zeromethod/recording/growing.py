"""The growing HDF5 file."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from zeromethod.recording.checksums import CHECKSUMS, ChecksumRows, checksums_of
from zeromethod.recording.size_limit import size_limit

AHEAD_BYTES = 64 << 20
"""Room claimed ahead on the disk. Nothing is begun that may not fit: a write that fails in the middle could
leave the file unreadable."""

TABLES_BYTES = 16 << 20
"""Room that arrays leave for the tables, which go on for minutes when the disk is full."""

LEAST_BYTES = 1 << 20
"""Room that tables leave for the file's own structure."""

SHARE = 8
"""Neither is more than the disk's free room over this; but tables always get twice the least."""


COMPLETE = 255
"""What the dataset `complete` holds after an end in order: no flipped bit makes it of 0."""


class DiskFull(Exception):
    """There is no room; the message says how much would have been needed."""


class Overwritten(Exception):
    """Another program has cut the open file short, or written into it."""


class GrowingFile:
    """Datasets that grow item by item while others read them (SWMR).

    Flushed items stay readable whatever becomes of this process.
    """

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        """Open a file with datasets of these names. Raises OSError."""
        self._path = path
        # Without a lock: the file is ours alone, and a reader that has it open must not keep us out.
        self._file = h5py.File(path, "r+", libver="latest", locking=False)
        self._sets = [self._file[name] for name in names]
        self._lengths = [len(dataset) for dataset in self._sets]
        self._gathered: list[list[bytes]] = [[] for _ in names]
        self._shapes = [dataset.shape[1:] for dataset in self._sets]
        self._handle = os.open(path, os.O_RDWR)
        self._claimed = os.fstat(self._handle).st_size
        self._used = self._size = self._claimed
        # what no other recording has at this place
        self._mark = str(self._file.attrs["started_utc"]).encode()
        self._mark_at = os.pread(self._handle, self._size, 0).find(self._mark)
        self._for_tables = min(TABLES_BYTES, max(2 * LEAST_BYTES, self._free() // SHARE))
        self._flushed = [0, 0]
        self._filtered = [dataset.id.get_create_plist().get_nfilters() > 0 for dataset in self._sets]
        if any(self._filtered):
            import hdf5plugin  # noqa: F401, PLC0415 - knows the filters
        kinds = zip(names, (one.dtype.names for one in self._sets), strict=True)
        checksums = {one: kind for one, kind in kinds if one.endswith(f"/{CHECKSUMS}")}
        # rows of tables are summed all at once when they are written
        tables = [name for name, fields in checksums.items() if fields == ("table",)]
        where = {name: index for index, name in enumerate(names)}
        self._sums = {where[name.replace(CHECKSUMS, "table")]: where[name] for name in tables}
        self._rows = ChecksumRows(names, {one: kind for one, kind in checksums.items() if one not in tables})
        of_tables = {*self._sums, *self._sums.values()}
        self._order = sorted(
            range(len(names)), key=lambda index: (index in of_tables, names[index].startswith("steps/"))
        )
        self._file.swmr_mode = True

    def claim(self, wanted: int, arrays: bool) -> None:
        """Make sure that so many bytes fit. arrays: and that the tables have room after them.

        Raises DiskFull, and Overwritten before anything is written into what is no longer ours.
        """
        self.check_own()
        least = wanted + (self._for_tables if arrays else LEAST_BYTES)
        need = self._used + least
        if need > self._claimed:
            ahead = min(AHEAD_BYTES, self._free() // SHARE) if arrays else 0
            try:
                self._extend(need + ahead)
            except OSError:
                try:
                    self._extend(need)
                except OSError as error:
                    raise DiskFull(_why(error, least)) from None
        self._used += wanted

    def _free(self) -> int:
        """Bytes that are free on the disk, for us."""
        disk = os.fstatvfs(self._handle)
        return disk.f_bavail * disk.f_frsize

    def _extend(self, end: int) -> None:
        os.posix_fallocate(self._handle, self._claimed, end - self._claimed)
        self._claimed, self._size = end, os.fstat(self._handle).st_size

    def check_own(self) -> None:
        """Raise Overwritten where the open file is no longer as it was written here."""
        size = os.fstat(self._handle).st_size
        found = os.pread(self._handle, len(self._mark), self._mark_at) if self._mark_at >= 0 else self._mark
        if size < self._size or found != self._mark:
            what = "another program has cut it short or written over it; nothing more is recorded"
            raise Overwritten(f"{self._path}: {what}")

    def elsewhere(self, ended: bool = False) -> str:
        """What became of the file's name, and where the open file is now; "" while it has its name."""
        own = os.fstat(self._handle)
        try:
            there = os.stat(self._path)
        except (FileNotFoundError, NotADirectoryError):
            gone = "gone"
        except OSError:
            return ""  # it cannot be seen, which does not say that it is not there
        else:
            if os.path.samestat(own, there):
                return ""
            gone = "another file now"
        open_file = f"/proc/{os.getpid()}/fd/{self._handle}"
        place = os.readlink(open_file)
        if not place.endswith(" (deleted)"):
            kept = f"what is recorded is in {place}"
        elif ended:
            kept = "what was recorded was deleted"
        else:
            kept = f"what is recorded is in {open_file} until the run ends: copy it"
        return f"{self._path} is {gone}; {kept}"

    def append(self, index: int, item: memoryview) -> None:
        """Add an item to the dataset of that index; `item` may be used again afterwards.

        Raises OSError, or RuntimeError by the HDF5 library.
        """
        if (complete := self._rows.add(index, item)) is not None:
            checksums, row = complete
            self._gathered[checksums].append(row)
        shape = self._shapes[index]
        if not shape:
            self._gathered[index].append(bytes(item))
            return
        dataset, length = self._sets[index], self._lengths[index]
        dataset.id.set_extent((length + 1, *shape))
        if self._filtered[index]:
            dataset[length] = np.frombuffer(item, dataset.dtype).reshape(shape)
        else:
            dataset.id.write_direct_chunk((length,) + (0,) * len(shape), item)
        self._lengths[index] = length + 1

    def flush(self) -> None:
        """Let readers see all that was added; raises as `append`.

        Arrays first, then their numbers, then tables, that of the steps last, each with its checksums after
        it: whatever ends this process in the middle, what a row names is there.
        """
        for dataset, shape in zip(self._sets, self._shapes, strict=True):
            if shape:
                dataset.id.flush()
        for index in self._order:
            items = self._gathered[index]
            if items:
                dataset, length = self._sets[index], self._lengths[index]
                values = np.frombuffer(b"".join(items), dataset.dtype)
                if index in self._sums:
                    # they come after their table
                    self._gathered[self._sums[index]].append(checksums_of(values).tobytes())
                dataset.id.set_extent((length + len(values),))
                dataset[length:] = values
                dataset.id.flush()
                self._lengths[index] = length + len(values)
                items.clear()
        self._used = int(self._file.id.get_filesize())
        self._write_back()

    def _write_back(self) -> None:
        """Start writing flushed bytes to the disk, and drop written ones from memory.

        Otherwise the system would gather them, take memory from other programs, and then write for seconds.
        """
        before, last = self._flushed
        os.posix_fadvise(self._handle, before, self._used - before, os.POSIX_FADV_DONTNEED)
        self._flushed = [last, self._used]

    def close(self, complete: bool) -> None:
        """Flush, note whether the run ended in order, and give back unused room."""
        self.flush()
        if complete:
            self._file["complete"][...] = COMPLETE
        self._file.flush()
        end = int(self._file.id.get_filesize())
        self._file.close()
        os.ftruncate(self._handle, end)
        os.close(self._handle)


def _why(error: OSError, least: int) -> str:
    """Why there is no room, in words."""
    if error.errno == errno.ENOSPC:
        return f"less than {-(-least // 1_000_000)} MB free"
    if error.errno == errno.EFBIG:
        return size_limit()
    return error.strerror or str(error)
