"""Dotted keys of rig files ("display.pitch_mm", "pattern_layers[0].index", "camera.focal_px[1]")."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

_NAME = r"[A-Za-z0-9_-]+(?:\[\d+\])*"
_KEY = re.compile(rf"{_NAME}(?:\.{_NAME})*")
_STEP = re.compile(r"([A-Za-z0-9_-]+)|\[(\d+)\]")


def steps_of(key: str) -> list[str | int]:
    """Names and indices of a dotted key; raises KeyError where it is none."""
    if _KEY.fullmatch(key) is None:
        raise KeyError(key)
    return [int(index) if index else name for name, index in _STEP.findall(key)]


def value_at(data: Any, key: str) -> Any:
    """Value at a dotted key of nested tables and lists; None where there is none."""
    try:
        for step in steps_of(key):
            data = data[step]
    except (KeyError, IndexError, TypeError):
        return None
    return data


def set_value(data: Any, key: str, value: Any) -> None:
    """Set the value at a dotted key in place; tables that are missing are added, None takes the key out.

    data: nested dicts and lists, or a TOML document. Raises KeyError, IndexError, TypeError, or ValueError
    (TOML) where the key leads nowhere or the value cannot be written.
    """
    *places, last = steps_of(key)
    for step in places:
        if isinstance(step, str) and step not in data:
            data[step] = {}
        data = data[step]
    if value is not None:
        data[last] = plain(value)
    elif last in data:
        del data[last]


def plain(value: Any) -> Any:
    """Value as TOML has it: numpy's, tuples, paths and tables become numbers, lists, text and dicts."""
    if isinstance(value, BaseModel):
        return plain(value.model_dump(exclude_unset=True))
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value
