"""A run of arrays as one HDF5 file: levels sent, readings, depth modes; and its replay, bit for bit."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zeromethod.errors import InputError
from zeromethod.light_array.devices import Counts, LightArrays, Readings
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.recording.file import check_new
from zeromethod.recording.schema import LIGHT_ARRAYS
from zeromethod.rig.refusal import validated

FORMAT_VERSION = 1
_ROWS_PER_WRITE = 500


def _tables(rig: LightArrayRig) -> dict[str, np.dtype[Any]]:
    """Columns of the tables; the first is the number of readings, levels or step, the last what counts."""
    depth = [("number", "<u8"), ("time_ns", "<i8"), ("state", "S16"), ("peak", "<f8", 4)]
    return {
        "readings": np.dtype(
            [("number", "<u8"), ("shown", "<u8"), ("time_ns", "<i8"), ("counts", "<u2", COUNT)]
        ),
        "levels": np.dtype([("number", "<u8"), ("levels", "<u2", COUNT)]),
        "depth": np.dtype([*depth, ("modes", "<f8", rig.reading.modes)]),
    }


class Recorder:
    """A new file of tables that grow row by row. Raises InputError where it cannot be made."""

    def __init__(self, path: Path, rig: LightArrayRig) -> None:
        check_new(path)
        self._file = h5py.File(path, "x", libver="latest")
        self._file.attrs.update(
            format=LIGHT_ARRAYS, format_version=FORMAT_VERSION, version=version("zeromethod"), complete=False,
            started_utc=datetime.now(UTC).isoformat(), rig=rig.model_dump_json(exclude_unset=True),
        )  # fmt: skip
        self._waiting: dict[str, list[tuple[Any, ...]]] = {}
        for name, kind in _tables(rig).items():
            self._file.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(_ROWS_PER_WRITE,))
            self._waiting[name] = []

    def add(self, name: str, *row: Any) -> None:
        """Add a row to a table."""
        self._waiting[name].append(row)
        if len(self._waiting[name]) >= _ROWS_PER_WRITE:
            self._write(name)
            self._file.flush()

    def _write(self, name: str) -> None:
        rows, self._waiting[name] = self._waiting[name], []
        data = self._file[name]
        data.resize((len(data) + len(rows),))
        data[len(data) - len(rows) :] = np.array(rows, data.dtype)

    def close(self) -> None:
        """Write the rows that wait, and close the file."""
        for name in self._waiting:
            self._write(name)
        self._file.attrs["complete"] = True
        self._file.close()


class PlayedArrays(LightArrays):
    """Arrays that give recorded readings, a table with the columns of `Readings`, whatever is sent."""

    def __init__(self, readings: Any) -> None:
        numbers = (readings[name].tolist() for name in ("number", "shown", "time_ns"))
        self._readings = map(Readings, *numbers, readings["counts"])

    def send(self, number: int, levels: Counts) -> None:
        """Nothing: the answer is recorded."""

    def receive(self, timeout_s: float) -> Readings | None:  # noqa: ARG002 - without waiting
        """Return the next readings, None after the last."""
        return next(self._readings, None)


def is_light_recording(path: Path) -> bool:
    """Whether a file is a recording of arrays."""
    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("format") == LIGHT_ARRAYS)
    except (OSError, ValueError):
        return False


def _recorded(path: Path) -> tuple[LightArrayRig, dict[str, Any]]:
    """Rig and tables of a recording. Raises InputError if it is damaged."""
    try:
        with h5py.File(path, "r") as file:
            written_by, rig = int(file.attrs["format_version"]), str(file.attrs["rig"])
            tables = {name: file[name][:] for name in ("readings", "levels", "depth")}
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged: {' '.join(str(error).split())}") from None
    if written_by != FORMAT_VERSION:
        raise InputError(f"{path}: written by another version of zeromethod")
    return validated(LightArrayRig, json.loads(rig), path), tables


def replay(path: Path) -> dict[str, Any]:
    """Run the loop again on a recording's readings: how many levels and readings of depth differ."""
    from zeromethod.light_array.loop import LightLoop  # noqa: PLC0415 - only recordings of arrays need it

    rig, tables = _recorded(path)
    again: dict[str, dict[int, Any]] = {name: {} for name in tables}

    def record(name: str, number: int, *row: Any) -> None:
        again[name][number] = row[-1]

    # without readings, after the last ones, the loop ends by itself
    frames = sum(step.sensed for step in LightLoop(rig, PlayedArrays(tables["readings"]), record).run())
    pairs = {
        name: [(row[-1], again[name].get(int(row["number"]))) for row in tables[name]]
        for name in ("levels", "depth")
    }
    sent = [np.array_equal(before, after) for before, after in pairs["levels"] if after is not None]
    read = [after is not None and np.array_equal(before, after) for before, after in pairs["depth"]]
    apart = [float(np.abs(before - after).max()) for before, after in pairs["depth"] if after is not None]
    return {
        "frames": frames,
        "levels": len(sent),
        "levels_differing": sent.count(False),
        "readings_of_depth": len(read),
        "readings_differing": read.count(False),
        "most_mode_units": max(apart, default=0.0),
        "equal": len(sent) > 0 and all(sent) and all(read),
    }
