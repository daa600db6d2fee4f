"""Writing measured values back into a rig file, its comments and order kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.rig.keys import set_value
from zeromethod.rig.load import parse_rig, read_text
from zeromethod.rig.refusal import shown


def save_values(path: Path, values: Mapping[str, Any], destination: Path | None = None) -> None:
    """Set values in a rig file by dotted key: `{"display.gamma": 2.15, "pattern_layers[0].index": 1.0}`.

    Comments, order and all other values stay. Missing tables are added; None takes a key out. `destination`:
    write there and leave `path` as it is. The result is checked as `load_rig` would before anything is
    written, and the file is replaced in one step, so that it is never half written.

    Raises
    ------
    InputError
        `path` is not a rig file, a key leads nowhere, a value is not allowed, or the file cannot be written.
    """
    target = destination or path
    try:
        document = tomlkit.parse(read_text(path))
    except TOMLKitError as error:
        raise InputError(f"{path}: {error}: not TOML") from None
    for key, value in values.items():
        try:
            set_value(document, key, value)
        except (KeyError, IndexError, TypeError, ValueError, TOMLKitError):
            raise InputError(
                f"{path}: {key}: {shown(value)}: a key of a rig file and a value of TOML"
            ) from None
    text = tomlkit.dumps(document)
    parse_rig(text, target)
    try:
        with atomic_write(target) as part:
            part.write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise InputError(
            f"{target}: cannot be written: {error.strerror}: a file in a folder of yours"
        ) from None
