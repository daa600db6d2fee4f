"""Opening a recording's file, which may be whole, still written, left by a killed writer, or no such file."""

from __future__ import annotations

import contextlib
import ctypes
import time
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
"""How often what is read along is tried again, where its checksum does not fit: it may just be written.

The library waits 1 ns, then 2, 4, ... between: a quarter of a second in all, and with its own 100 for ever.
"""


def open_along(path: Path) -> h5py.File:
    """Open for reading, finished or not. Raises InputError, one line, for what is no whole HDF5 file."""
    if not path.is_file():
        raise InputError(f"{path}: not there: a recording (HDF5)")
    until_s = time.monotonic() + BEGINNING_S
    while True:
        flags = _flags(path)
        try:
            return _open(path, flags)
        except (OSError, RuntimeError) as error:
            begins = flags == _BEGUN or _flags(path) not in (flags, 0)
            if not begins or time.monotonic() > until_s:
                told = " ".join(str(error).split())
                raise InputError(f"{path}: cannot be read as a recording (HDF5): {told}") from None
        time.sleep(0.02)


def _open(path: Path, flags: int) -> h5py.File:
    if (missing := _missing_bytes(path)) > 0:
        raise InputError(f"{path}: cut short, {missing} bytes are missing: a whole recording (HDF5)")
    if not flags:
        # it fails where somebody has begun to write since, or this process reads it along already
        with contextlib.suppress(OSError):
            return h5py.File(path, "r")
    return _open_growing(path)


def _open_growing(path: Path) -> h5py.File:
    """Open a file that is being written, or whose writer was killed."""
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    # h5py does not have this function of the library that it is linked to; without it, damage takes long
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
    """How the file says that it is open for writing, 0 for not; also where the writer was killed."""
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
