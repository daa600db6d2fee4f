"""Creating the HDF5 file: everything is in it from the start, and then only grows."""

from __future__ import annotations

import contextlib
import json
import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomlkit

from zeromethod.arrays import Image
from zeromethod.atomic_write import check_writable
from zeromethod.errors import InputError
from zeromethod.recording.checksums import canonical, checksum_of
from zeromethod.recording.growing import COMPLETE
from zeromethod.recording.schema import ANCHORS, EVENTS, SCHEMA, SCHEMA_VERSION, STATES, Dataset
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag

CHUNK_BYTES = 16384
"""Approximate size of a chunk of a table; arrays have one item in each."""

SUFFIXES = (".h5", ".hdf5")

LIBRARIES = ("numpy", "scipy", "numba", "h5py", "moderngl", "opencv-contrib-python-headless")
"""Libraries whose versions are recorded."""


def check_new(path: Path) -> None:
    """Raise InputError, one line, where no recording can be created at a path."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: a recording's name ends in {' or '.join(SUFFIXES)}")
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: is there already: a recording never replaces a file; give another name")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{path}: the folder {folder} does not exist")
    try:
        check_writable(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def create(
    path: Path,
    parts: Mapping[str, Dataset],
    about: Mapping[str, Any],
    rest: Mapping[str, tuple[Image, str, str]],
    files: Mapping[str, bytes],
    compress: bool = False,
) -> None:
    """Create the file with all its datasets, still empty. compress: arrays, without loss.

    about: attributes of its root. rest: array, units and meaning by name. files: by name, those that the rig
    names. Raises InputError where it cannot be created.
    """
    check_new(path)
    filters: Mapping[str, Any] = {}
    if compress:
        import hdf5plugin  # noqa: PLC0415 - needed only to compress

        filters = hdf5plugin.Bitshuffle(cname="lz4")
    try:
        with h5py.File(path, "x", libver="latest") as file:
            for part in parts.values():
                _create(file, part, filters)
            _describe(file, about, rest, files)
    except FileExistsError:
        raise InputError(f"{path}: is there already: another program has just created it") from None
    except BaseException as error:
        discard(path)
        if isinstance(error, OSError | RuntimeError):
            raise InputError(f"{path}: a recording cannot be created here: {_words(error)}") from None
        raise


def discard(path: Path) -> None:
    """Remove a file that could not be completed, so that the next attempt can have its name."""
    with contextlib.suppress(OSError):
        path.unlink()


def _words(error: BaseException) -> str:
    """The system's message where there is one: HDF5 adds its flags to it."""
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else " ".join(str(error).split())


def _create(file: h5py.File, part: Dataset, filters: Mapping[str, Any]) -> None:
    chunk = 1 if part.shape else max(1, CHUNK_BYTES // part.bytes)
    dataset = file.create_dataset(
        part.name,
        shape=(0, *part.shape),
        maxshape=(None, *part.shape),
        chunks=(chunk, *part.shape),
        dtype=part.dtype,
        **(filters if part.shape else {}),
    )
    dataset.attrs["units"], dataset.attrs["meaning"] = part.units, part.meaning
    if part.fields is not None:
        fields = [f"{name} ({units or 'none'}): {what}" for name, (_, units, what) in part.fields.items()]
        dataset.attrs["fields"] = fields
        for field, name, words in (("state", "states", STATES), ("events", "events", EVENTS)):
            if field in part.fields:
                dataset.attrs[name] = [one.value for one in words]
        if "anchor" in part.fields:
            dataset.attrs["anchors"] = list(ANCHORS)
    if part.name.endswith("/flags"):
        dataset.attrs["flags"] = _flags()


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
    file.attrs["checksum"] = np.uint64(checksum_of(canonical(file.attrs)))
    file.create_group("files")
    fixed = {f"rest/{name}": entry for name, entry in rest.items()}
    meaning = "file that the rig names, byte for byte"
    fixed |= {f"files/{name}": (np.frombuffer(c, np.uint8), "bytes", meaning) for name, c in files.items()}
    for name, (values, units, meaning) in fixed.items():
        dataset = file.create_dataset(name, data=values)
        dataset.attrs["units"], dataset.attrs["meaning"] = units, meaning
        dataset.attrs["checksum"] = np.uint64(checksum_of(values))
    file["rest/flags"].attrs["flags"] = _flags()
    dataset = file.create_dataset("complete", data=np.uint8(0))
    dataset.attrs["units"] = ""
    dataset.attrs["meaning"] = f"{COMPLETE} where the recording was ended in order, 0 where it was not"
    # last: a file that is cut off before is no recording yet
    file.attrs["schema"], file.attrs["schema_version"] = SCHEMA, SCHEMA_VERSION


def about(rig: Rig) -> dict[str, Any]:
    """Attributes of the file's root that any run has."""
    versions = {name: version(name) for name in LIBRARIES}
    versions |= {"python": platform.python_version(), "platform": platform.platform()}
    versions["hdf5"] = h5py.version.hdf5_version
    return {
        "zeromethod_version": version("zeromethod"),
        "versions": json.dumps(versions),
        "started_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "seed": rig.simulation.seed,
        "rig": rig_text(rig)[0],
    }


def rig_text(rig: Rig) -> tuple[str, dict[str, bytes]]:
    """Rig as TOML with all its values, and the files that it names, by their names in that TOML.

    A rest map is left out: the warp made from it is in the file's `rest`.
    """
    data = rig.model_dump(mode="json", exclude_none=True)
    data["camera"].pop("rest_map", None)
    files: dict[str, bytes] = {}
    if rig.prism.rest.file is not None:
        data["prism"]["rest"]["file"] = "rest.npy"
        files["rest.npy"] = rig.prism.rest.file.read_bytes()
    if rig.scenario.endswith(".toml"):
        data["scenario"] = "press.toml"
        files["press.toml"] = Path(rig.scenario).read_bytes()
    return tomlkit.dumps(data), files


def rest_arrays(rest: Rest) -> dict[str, tuple[Image, str, str]]:
    """The warp at rest with its units and meaning."""
    why = "why a node is not measurable at rest: bits named in the attribute `flags`"
    nodes = "(u, v) of every node; where rest was measured, those of the ideal camera that has its ray"
    grid = rest.grid
    return {
        "q": (rest.q, "LCD px", "warp of the untouched mirror: (column, row) on the LCD per camera node"),
        "flags": (rest.flags, "", why),
        "mask": (rest.visible, "", "rest mask: nodes that are measurable at rest"),
        "node_pixels": (np.stack(grid.mesh(), axis=-1), "camera px", nodes),
        "nodes_u": (grid.u_px, "camera px", "column of every node in the image"),
        "nodes_v": (grid.v_px, "camera px", "row of every node in the image"),
    }
