"""Making the HDF5 file: all that it will have is there from the start, and then only grows."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zeromethod.arrays import Image
from zeromethod.errors import InputError
from zeromethod.recording.schema import ANCHORS, EVENTS, SCHEMA, SCHEMA_VERSION, STATES, Part
from zeromethod.recording.sums import sum_of
from zeromethod.warp.validity import Flag

CHUNK_BYTES = 16384
"""Size of a chunk of a table, about; arrays have one item in each."""

SUFFIXES = (".h5", ".hdf5")


def check_new(path: Path) -> None:
    """Refuse a path that no recording can be made at. Raises InputError, one line."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: a recording's name ends in {' or '.join(SUFFIXES)}")
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: is there already: a recording never replaces a file; another name")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{path}: the folder {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path}: the folder {folder} is not writable")


def create(
    path: Path,
    parts: Mapping[str, Part],
    about: Mapping[str, Any],
    rest: Mapping[str, tuple[Image, str, str]],
    files: Mapping[str, bytes],
    compress: bool = False,
) -> None:
    """Make the file with all its datasets, still empty. compress: arrays, without loss.

    about: attributes of its root. rest: array, units and meaning by name. files: by name, those that the rig
    names. Raises InputError where it cannot be made.
    """
    check_new(path)
    try:
        file = h5py.File(path, "x", libver="latest")
    except FileExistsError:
        raise InputError(f"{path}: is there already: made just now by another") from None
    except OSError as error:
        discard(path)
        raise InputError(f"{path}: a recording cannot be made here: {_words(error)}") from None
    try:
        with file:
            for part in parts.values():
                _create(file, part, compress)
            _describe(file, about, rest, files)
    except BaseException as error:
        discard(path)
        if isinstance(error, OSError | RuntimeError):
            raise InputError(f"{path}: a recording cannot be made here: {_words(error)}") from None
        raise


def discard(path: Path) -> None:
    """Remove a file that was made in vain, so that the next attempt can have its name."""
    with contextlib.suppress(OSError):
        path.unlink()


def _words(error: BaseException) -> str:
    """Why, in the system's words where it has any: HDF5 adds its flags."""
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else " ".join(str(error).split())


def _create(file: h5py.File, part: Part, compress: bool) -> None:
    chunk = 1 if part.shape else max(1, CHUNK_BYTES // part.bytes)
    dataset = file.create_dataset(
        part.name,
        shape=(0, *part.shape),
        maxshape=(None, *part.shape),
        chunks=(chunk, *part.shape),
        dtype=part.dtype,
        **(_filters() if compress and part.shape else {}),
    )
    dataset.attrs["units"], dataset.attrs["meaning"] = part.units, part.meaning
    if part.fields is not None:
        fields = [f"{name} ({units or 'none'}): {what}" for name, (_, units, what) in part.fields.items()]
        dataset.attrs["fields"] = fields
        if "state" in part.fields:
            dataset.attrs["states"] = [state.value for state in STATES]
            dataset.attrs["events"] = [event.value for event in EVENTS]
        if "anchor" in part.fields:
            dataset.attrs["anchors"] = list(ANCHORS)
    if part.name.endswith("/flags"):
        dataset.attrs["flags"] = _flags()


def _filters() -> Mapping[str, Any]:
    import hdf5plugin  # noqa: PLC0415 - only who compresses needs it

    return dict(hdf5plugin.Bitshuffle(cname="lz4"))


def _flags() -> list[str]:
    return [f"{flag.value}: {flag.name}" for flag in Flag]


def _describe(
    file: h5py.File,
    about: Mapping[str, Any],
    rest: Mapping[str, tuple[Image, str, str]],
    files: Mapping[str, bytes],
) -> None:
    for name, value in about.items():
        file.attrs[name] = value
    file.attrs["rig_sum"] = np.uint64(sum_of(str(about["rig"]).encode()))
    group = file.create_group("rest")
    for name, (values, units, meaning) in rest.items():
        dataset = group.create_dataset(name, data=values)
        dataset.attrs["units"], dataset.attrs["meaning"] = units, meaning
        dataset.attrs["sum"] = np.uint64(sum_of(values))
    group["flags"].attrs["flags"] = _flags()
    group = file.create_group("files")
    for name, content in files.items():
        dataset = group.create_dataset(name, data=np.frombuffer(content, np.uint8))
        dataset.attrs["units"], dataset.attrs["meaning"] = "bytes", "file that the rig names, as it was"
        dataset.attrs["sum"] = np.uint64(sum_of(content))
    dataset = file.create_dataset("complete", data=np.False_)
    dataset.attrs["units"] = ""
    dataset.attrs["meaning"] = (
        "the recording was ended in order; false while it goes on, or if it was cut off"
    )
    # last: what is cut off before is no recording yet
    file.attrs["schema"], file.attrs["schema_version"] = SCHEMA, SCHEMA_VERSION
