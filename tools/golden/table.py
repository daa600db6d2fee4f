"""Everything that a run says as a flat table: stable names, under each its array of every frame."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]
Table = dict[str, dict[int, Array]]

SINGLE = (bool, int, float, str, bytes)
WORDS = "SU"
"""Kinds of arrays that hold text."""


def walk(value: Any, name: str) -> Iterator[tuple[str, Array]]:
    """All arrays inside a value, each with its name: "surface.anchor.mask", "contacts[0].outline_mm".

    No field is listed anywhere: records and mappings by their own names, sequences of single values whole,
    others by place, beside their length. None and functions have no array. Raises TypeError for what is
    none of these.
    """
    value = _plain(value)
    if isinstance(value, (np.ndarray, np.generic, *SINGLE)):
        array = np.array(value)
        yield name, array.astype(array.dtype.str, copy=False)  # without what HDF5 notes at a type
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from walk(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, (tuple, list)):
        items = [_plain(item) for item in value]
        if len({type(item) for item in items}) == 1 and isinstance(items[0], SINGLE):
            yield name, np.array(items)
            return
        yield f"{name}#", np.array(len(items))
        for at, item in enumerate(items):
            yield from walk(item, f"{name}[{at}]")
    elif value is not None and not callable(value):
        raise TypeError(f"{name}: {type(value).__qualname__}: neither a record nor a value")


def _plain(value: Any) -> Any:
    """A record as a mapping, the value of a word, the name of a file; others as they are."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return value.name
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype.names:
        return {field: value[field] for field in value.dtype.names}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return value._asdict() if hasattr(value, "_asdict") else value


def add(table: Table, frame: int, value: Any, name: str = "") -> None:
    """Take everything that a value says into the table as that of a frame."""
    for path, array in walk(value, name):
        table.setdefault(path, {})[frame] = array


def save(table: Table, path: Path) -> None:
    """Write it as .npz: under "name|number" arrays of one shape one above the other, beside their frames."""
    arrays: dict[str, Array] = {}
    for name, frames in table.items():
        alike: dict[Any, list[int]] = defaultdict(list)
        for frame, array in frames.items():
            alike[array.shape, array.dtype.kind if array.dtype.kind in WORDS else array.dtype].append(frame)
        for number, chosen in enumerate(alike.values()):
            arrays[f"{name}|{number}"] = np.stack([frames[frame] for frame in chosen])
            arrays[f"{name}|{number}|frames"] = np.array(chosen)
    np.savez(path, **arrays)


def load(path: Path) -> Table:
    """A table that `save` wrote."""
    table: Table = defaultdict(dict)
    with np.load(path) as file:
        for key in (key for key in file.files if not key.endswith("|frames")):
            frames = file[f"{key}|frames"].tolist()
            table[key.rpartition("|")[0]] |= dict(zip(frames, file[key], strict=True))
    return dict(table)
