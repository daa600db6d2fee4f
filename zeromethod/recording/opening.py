"""Opening a recording's file, which may be whole, still written, left by a killed writer, or no such file."""

from __future__ import annotations

from pathlib import Path

import h5py

from zeromethod.errors import InputError

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def open_along(path: Path) -> h5py.File:
    """Open for reading, finished or not. Raises InputError, one line, for what is no whole HDF5 file."""
    if not path.is_file():
        raise InputError(f"{path}: not there: a recording (HDF5)")
    if (missing := _missing_bytes(path)) > 0:
        raise InputError(f"{path}: cut short, {missing} bytes are missing: a whole recording (HDF5)")
    try:
        # Also where it is being written, or the writer was killed: nothing else opens both.
        return h5py.File(path, "r", libver="latest", swmr=True)
    except OSError as error:
        told = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as a recording (HDF5): {told}") from None


def _missing_bytes(path: Path) -> int:
    """Bytes by which a file is shorter than its own superblock says; readers along would wait for them.

    Superblock of versions 2 and 3, which recordings have (HDF5 file format specification, II.A).
    """
    with path.open("rb") as file:
        head = file.read(36)
    if head[:8] == _SIGNATURE and len(head) < 36:
        return 36 - len(head)
    if head[:8] != _SIGNATURE or head[8] not in (2, 3) or head[9] != 8:
        return 0
    return int.from_bytes(head[28:36], "little") - path.stat().st_size
