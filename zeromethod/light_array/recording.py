"""A run of arrays as one HDF5 file: levels sent, readings, depth modes; and its replay, bit for bit."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.light_array.devices import Counts, LightArrays, Readings
from zeromethod.light_array.loop import LightLoop, LightStep
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import LightArrayRig, checked
from zeromethod.recording.file import check_new
from zeromethod.recording.schema import LIGHT_ARRAYS

FORMAT_VERSION = 1
_READINGS = np.dtype([("number", "<u8"), ("shown", "<u8"), ("time_ns", "<i8"), ("counts", "<u2", COUNT)])
_LEVELS = np.dtype([("number", "<u8"), ("levels", "<u2", COUNT)])
_AT_ONCE = 500
"""Rows that are written in one go."""


class RecordedArrays(AbstractContextManager["RecordedArrays"]):
    """Arrays whose every exchange goes into a new file, too. Raises InputError where it cannot be made."""

    def __init__(self, arrays: LightArrays, path: Path, rig: LightArrayRig) -> None:
        check_new(path)
        self._arrays, self.live = arrays, arrays.live
        count = rig.reading.modes
        depth = [
            ("number", "<u8"),
            ("time_ns", "<i8"),
            ("state", "S16"),
            ("peak", "<f8", 4),
            ("modes", "<f8", count),
        ]
        self._file = h5py.File(path, "x", libver="latest")
        self._file.attrs.update(
            format=LIGHT_ARRAYS, format_version=FORMAT_VERSION, version=version("zeromethod"), complete=False,
            started_utc=datetime.now(UTC).isoformat(), rig=rig.model_dump_json(exclude_unset=True),
        )  # fmt: skip
        self._rows: dict[str, list[Any]] = {}
        for name, kind in (("readings", _READINGS), ("levels", _LEVELS), ("depth", np.dtype(depth))):
            self._file.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(_AT_ONCE,))
            self._rows[name] = []
        self._last = 0

    @property
    def refused(self) -> int:
        """Frames that came broken."""
        return self._arrays.refused

    def __getattr__(self, name: str) -> Any:
        """What the arrays have beyond the protocol: truth and phases of simulated ones."""
        return getattr(self._arrays, name)

    def send(self, number: int, levels: Counts) -> None:
        """Record levels, once, and send them."""
        if number > self._last:
            self._last = number
            self._add("levels", (number, levels))
        self._arrays.send(number, levels)

    def receive(self, timeout_s: float) -> Readings | None:
        """Return the next readings, recorded."""
        got = self._arrays.receive(timeout_s)
        if got is not None:
            self._add("readings", (got.number, got.shown, got.time_ns, got.counts))
        return got

    def add(self, step: LightStep) -> None:
        """Record a reading of depth."""
        if step.modes is not None and step.peak is not None:
            peak = step.peak
            row = (peak.depth_mm, peak.sigma_mm, peak.x_mm, peak.y_mm)
            self._add("depth", (step.number, step.time_ns, step.state.value.encode(), row, step.modes))

    def reopen(self) -> bool:
        """Try once to open what was lost."""
        return self._arrays.reopen()

    def close(self) -> None:
        """Write what waits, and close the file and the arrays."""
        if self._file:
            for name in self._rows:
                self._write(name)
            self._file.attrs["complete"] = True
            self._file.close()
        self._arrays.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _add(self, name: str, row: Any) -> None:
        self._rows[name].append(row)
        if len(self._rows[name]) >= _AT_ONCE:
            self._write(name)
            self._file.flush()

    def _write(self, name: str) -> None:
        rows, self._rows[name] = self._rows[name], []
        data = self._file[name]
        data.resize((len(data) + len(rows),))
        data[len(data) - len(rows) :] = np.array(rows, data.dtype)


class PlayedArrays:
    """The arrays of a recording: they give its readings. differing: levels that are not those recorded."""

    live, refused = False, 0

    def __init__(self, readings: Any, levels: Any) -> None:
        self._readings = readings
        self._levels: dict[int, Counts] = dict(zip(levels["number"].tolist(), levels["levels"], strict=True))
        self._at = self.differing = self.sent = 0

    @property
    def over(self) -> bool:
        """Whether every reading was given."""
        return self._at >= len(self._readings)

    def send(self, number: int, levels: Counts) -> None:
        """Compare levels with those recorded."""
        if number in self._levels:
            self.sent += 1
            self.differing += not np.array_equal(self._levels.pop(number), levels)

    def receive(self, timeout_s: float) -> Readings | None:  # noqa: ARG002 - as the protocol says
        """Return the next readings."""
        if self.over:
            return None
        row = self._readings[self._at]
        self._at += 1
        return Readings(int(row["number"]), int(row["shown"]), int(row["time_ns"]), row["counts"])

    def reopen(self) -> bool:
        """Nothing is ever lost."""
        return True

    def close(self) -> None:
        """Nothing is open."""


def is_light_recording(path: Path) -> bool:
    """Whether a file is a recording of arrays."""
    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("format") == LIGHT_ARRAYS)
    except (OSError, ValueError):
        return False


def recorded_depth(path: Path) -> tuple[LightArrayRig, dict[str, Any]]:
    """Rig and tables ("readings", "levels", "depth") of a recording. Raises InputError if it is damaged."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs["format_version"] != FORMAT_VERSION:
                raise InputError(f"{path}: written by another version of zeromethod")
            rig = str(file.attrs["rig"])
            tables = {name: file[name][:] for name in ("readings", "levels", "depth")}
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged: {' '.join(str(error).split())}") from None
    return checked(json.loads(rig), path), tables


def replay(path: Path) -> dict[str, Any]:
    """Run the loop again on a recording's readings: how many levels and readings of depth differ."""
    rig, tables = recorded_depth(path)
    played = PlayedArrays(tables["readings"], tables["levels"])
    loop = LightLoop(rig, played)
    depth = tables["depth"]
    found: dict[int, Float] = {}
    frames = 0
    for step in loop.run():
        frames += step.sensed
        if step.modes is not None:
            found[step.number] = step.modes
        if played.over:
            loop.stop()
    pairs = [(row["modes"], found.get(int(row["number"]))) for row in depth]
    differing = sum(modes is None or not np.array_equal(before, modes) for before, modes in pairs)
    most = max((float(np.abs(a - b).max()) for a, b in pairs if b is not None), default=0.0)
    return {
        "frames": frames,
        "levels": played.sent,
        "levels_differing": played.differing,
        "readings_of_depth": len(depth),
        "readings_differing": differing,
        "most_mode_units": most,
        "equal": played.differing == 0 and differing == 0 and played.sent > 0,
    }
