"""Single bits flipped anywhere in a recording: reported, refused in one line, or without any effect."""

import warnings
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from planted_steps import a_step, read, recorder

from zeromethod import InputError, Recording
from zeromethod.recording import DamagedWarning

STEPS = 3
PER_DATASET = 2
"""Flips in the data of each dataset; the largest are hit no more often than the smallest."""
ELSEWHERE = 50
"""Flips in all that is not a dataset's data: what HDF5 keeps about it, attributes, gaps."""

ARRAYS: dict[str, Callable[[Recording, int], Any]] = {
    "frames": Recording.image,
    "residual": Recording.residual,
    "warps/measured": Recording.measured,
    "warps/commanded": Recording.commanded,
    "warps/shown": Recording.shown,
    "surface": Recording.surface,
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flips") / "whole.h5"
    with recorder(path, calibration="text = 'of a calibration'") as recording:
        for number in range(1, STEPS + 1):
            step = a_step(number, notes=(f"note {number}",), dropped=number)
            recording.add_step(step)
            recording.add_reading(read(step))
    return path


def plain(value: Any) -> Any:
    """The same, to be compared: bytes for arrays."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return value


def contents(path: Path) -> tuple[dict[Any, Any], dict[str, int]]:
    """All that a recording says, item by item, without what it leaves out; and what it calls damaged."""
    found: dict[Any, Any] = {}
    with Recording(path) as recording, warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedWarning)
        damaged = recording.damaged()
        found["about"] = (recording.rig_text, recording.calibration, recording.seed, recording.complete)
        found["rest"] = plain(recording.rest.q), plain(recording.rest.flags)
        for name in ("steps", "presentation_log", "peaks", "drops", "notes"):
            for row in getattr(recording, name):
                values = dict(zip(row.dtype.names, row.tolist(), strict=True))
                # counted from the first step that is left
                values.pop("time_s", None)
                found[name, values.get("step", values.get("number", values.get("after_step")))] = repr(values)
        for row in recording.steps:
            found["words", int(row["number"])] = recording.state_of(row), recording.events_of(row)
        for name, array in ARRAYS.items():
            for number in range(1, STEPS + 1):
                value = array(recording, number)
                if value is not None and not (name == "surface" and np.isnan(value.depth_mm).all()):
                    found[name, number] = plain(value)
        for index in range(STEPS):
            if (q := recording.picture_q(index)) is not None:
                found["pictures", index] = plain(q)
    return found, damaged


def data_places(path: Path) -> dict[str, list[tuple[int, int]]]:
    """(offset, size) of every piece of every dataset's data in the file."""
    places: dict[str, list[tuple[int, int]]] = {}

    def look(name: str, one: h5py.Group | h5py.Dataset) -> None:
        if not isinstance(one, h5py.Dataset) or not one.size:
            return
        if one.chunks is None:
            places[name] = [(one.id.get_offset(), one.id.get_storage_size())]
            return
        per_chunk, rows = one.chunks[0], len(one)
        row_bytes = one.nbytes // rows
        chunks = [one.id.get_chunk_info(index) for index in range(one.id.get_num_chunks())]
        places[name] = [
            (chunk.byte_offset, row_bytes * min(per_chunk, rows - chunk.chunk_offset[0])) for chunk in chunks
        ]

    with h5py.File(path, "r") as file:
        file.visititems(look)
    return places


UNREAD = {"elsewhere", "complete", "rest/nodes_u", "rest/nodes_v"}
"""Where a flip may go unreported: no figure comes from there, or (complete) a majority of bits decides."""


def flips(path: Path) -> list[tuple[str, int, int]]:
    """(where, byte, bit) of every flip."""
    rng = np.random.default_rng(14)
    content, places = path.read_bytes(), data_places(path)
    found, free = [], np.ones(len(content), np.bool_)
    for name, pieces in places.items():
        inside = np.concatenate([np.arange(start, start + size) for start, size in pieces])
        free[inside] = False
        found += [(name, int(byte), int(rng.integers(8))) for byte in rng.choice(inside, PER_DATASET)]
    # empty space is of no interest: where something is written
    written = np.flatnonzero(free & (np.frombuffer(content, np.uint8) != 0))
    found += [("elsewhere", int(byte), int(rng.integers(8))) for byte in rng.choice(written, ELSEWHERE)]
    return found


def test_no_flipped_bit_changes_a_figure_in_silence(whole, tmp_path):
    content = whole.read_bytes()
    expected, nothing = contents(whole)
    assert nothing == {}
    assert len(expected) > 30
    path = tmp_path / "flipped.h5"
    said, silent = [], set()
    for where, byte, bit in flips(whole):
        flipped = bytearray(content)
        flipped[byte] ^= 1 << bit
        path.write_bytes(flipped)
        try:
            found, damaged = contents(path)
        except InputError as error:
            said.append(str(error))
            continue
        changed = [key for key, value in found.items() if expected.get(key) != value]
        assert not changed, (where, byte, bit)
        assert damaged or found == expected, (where, byte, bit)
        silent |= set() if damaged else {where}
    # every array and every table is reported, and most of what HDF5 keeps about them is refused
    assert silent <= UNREAD
    assert len(said) > 25
    assert all(words.startswith(str(path)) and "\n" not in words for words in said)
