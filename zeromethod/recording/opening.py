"""Opening a recording's file, which may be whole, growing, left by a killed writer, or no recording."""

from __future__ import annotations

import contextlib
import ctypes
import time
from enum import Enum
from pathlib import Path

import h5py

from zeromethod.errors import InputError

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

_HEAD_BYTES = 36
"""Superblock of versions 2 and 3, up to the end of file's address (HDF5 file format specification, II.A)."""

_BEGUN, _WRITING = 0b001, 0b101
"""File consistency flags: open for writing; and for writing while others read, which comes a moment later."""

BEGINNING_S = 5.0
"""How long a writer may have a file for itself."""

ATTEMPTS = 27
"""How often a part of a growing file is read again where HDF5's checksum does not fit.

It may just be written. The library waits 1 ns, then 2, 4, ... between: a quarter of a second in all;
with its own 100 attempts it waits for ever.
"""


class Refusal(Enum):
    """Why a file is refused as a recording, each with its sentence."""

    MISSING = "not there: give the path of a recording (.h5)"
    UNREADABLE = "cannot be read as a recording (HDF5): {error}"
    CUT_SHORT = "cut short, {count} bytes are missing: copy the whole recording again"
    NO_RECORDING = "an HDF5 file, but no recording of zeromethod"
    LIGHT_ARRAYS = "a recording of LED and photodetector arrays: only `zeromethod replay` can read it"
    OTHER_FORMAT = (
        "recorded in format {found} by zeromethod {by}; this version reads format {reads}: "
        "open it with zeromethod {by}"
    )
    EMPTY = "cut off while it was being created: it holds nothing"
    DAMAGED = "{part}: cannot be read: damaged"
    CHANGED = "{part}: damaged: not what was written"
    WORDS = "{part}: {word!r} is not known: damaged, or recorded by a later zeromethod"


class RefusedRecording(InputError):
    """A file, or a part of it that nothing can do without, is no recording or is damaged; one line."""

    def __init__(self, path: Path, refusal: Refusal, **details: object) -> None:
        """details: those that the sentence of `refusal` names."""
        super().__init__(f"{path}: {refusal.value.format(**details)}")
        self.refusal = refusal


def open_along(path: Path) -> h5py.File:
    """Open for reading, finished or not. Raises RefusedRecording."""
    if not path.is_file():
        raise RefusedRecording(path, Refusal.MISSING)
    until_s = time.monotonic() + BEGINNING_S
    while True:
        flags = _flags(path)
        try:
            return _open(path, flags)
        except (OSError, RuntimeError) as error:
            begins = flags == _BEGUN or _flags(path) not in (flags, 0)
            if not begins or time.monotonic() > until_s:
                words = " ".join(str(error).split())
                raise RefusedRecording(path, Refusal.UNREADABLE, error=words) from None
        time.sleep(0.02)


def _open(path: Path, flags: int) -> h5py.File:
    if (missing := _missing_bytes(path)) > 0:
        raise RefusedRecording(path, Refusal.CUT_SHORT, count=missing)
    if not flags:
        # it fails where a writer has begun since, or this process already reads the growing file
        with contextlib.suppress(OSError):
            return h5py.File(path, "r")
    return _open_growing(path)


def _open_growing(path: Path) -> h5py.File:
    """Open a file that is being written, or whose writer was killed."""
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    # h5py lacks this function of the library that it is linked to; without it, damage takes long
    with contextlib.suppress(OSError, AttributeError):
        set_attempts = ctypes.CDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        set_attempts.argtypes, set_attempts.restype = (ctypes.c_int64, ctypes.c_uint), ctypes.c_int
        set_attempts(access.id, ATTEMPTS)
    flags = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
    return h5py.File(h5py.h5f.open(str(path).encode(), flags, access))


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)


def _flags(path: Path) -> int:
    """Flags by which the file says that it is open for writing (or its writer was killed); 0 for not."""
    try:
        head = _head(path)
    except OSError:
        return 0
    return head[11] & _WRITING if len(head) == _HEAD_BYTES and head[8] == 3 else 0


def _missing_bytes(path: Path) -> int:
    """Bytes by which a file is shorter than its own superblock says."""
    head = _head(path)
    if head[:8] == _SIGNATURE and len(head) < _HEAD_BYTES:
        return _HEAD_BYTES - len(head)
    if head[:8] != _SIGNATURE or head[8] not in (2, 3) or head[9] != 8:
        return 0
    return int.from_bytes(head[28:36], "little") - path.stat().st_size
