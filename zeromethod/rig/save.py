"""Writing measured values back into a rig file, its comments and order kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Item, Key, Table

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.rig.keys import set_value
from zeromethod.rig.load import RIG_FILE, parse_rig
from zeromethod.rig.refusal import shown
from zeromethod.toml_file import parse_toml, read_text


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
    text = read_text(path, RIG_FILE)
    parse_toml(text, path)
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise InputError(f"{path}: {error}: not TOML") from None
    ends = _take_ends(document)
    for key, value in values.items():
        try:
            set_value(document, key, value)
        except (KeyError, IndexError, TypeError, ValueError, TOMLKitError):
            raise InputError(
                f"{path}: {key}: {shown(value)}: a key of a rig file and a value of TOML"
            ) from None
    for body, end in ends:
        body.extend(end)
    text = tomlkit.dumps(document)
    parse_rig(text, target)
    try:
        with atomic_write(target) as part:
            part.write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise InputError(
            f"{target}: cannot be written: {error.strerror}: a file in a folder of yours"
        ) from None


_Body = list[tuple[Key | None, Item]]


def _take_ends(table: TOMLDocument | Table) -> list[tuple[_Body, _Body]]:
    """Take blank lines and comments off the ends of tables: a key that is added belongs before them.

    What is returned: each table's body, and its end.
    """
    body: _Body = (table.value if isinstance(table, Table) else table).body
    count = len(body)
    while count and body[count - 1][0] is None:
        count -= 1
    ends = [(body, body[count:])]
    del body[count:]
    for _, item in body:
        for part in item.body if isinstance(item, AoT) else [item]:
            if isinstance(part, Table):
                ends += _take_ends(part)
    return ends
