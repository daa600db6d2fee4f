"""TOML that a user hands in: read from an ordinary file, within bounds, or refused in one line."""

from __future__ import annotations

import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from zeromethod.errors import InputError

MOST_BYTES = 1 << 20
"""Of a file. The largest that this program writes, a calibration with its correlations, has some 50 kB."""

MOST_DEPTH = 32
"""Tables and lists inside each other. The deepest that this program reads, a press file, has 5."""

_TOO_DEEP = f"tables or lists inside each other: {MOST_DEPTH} at most"
_TOO_LARGE = "too large: whole numbers of TOML have 64 bits"

_DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]+[ \t]*\.[ \t]*){{{MOST_DEPTH}}}""")
"""A dotted key of more parts: the parser's time for it grows with the square of their number."""


def read_text(path: Path, allowed: str) -> str:
    """Text of a file, line ends as they are, without a byte order mark. allowed: ends the refusal.

    Raises InputError, one line, for what cannot be read, is no ordinary file, or is too large.
    """
    try:
        # a pipe or a device may have no end, and gives nothing a second time
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"{path}: not an ordinary file: {allowed}")
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}: {allowed}") from None
    if len(data) > MOST_BYTES:
        raise InputError(f"{path}: more than {MOST_BYTES >> 20} MiB: {allowed}")
    try:
        return data.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start}: not UTF-8: {allowed}") from None


def parse_toml(text: str, where: object, allowed: str = "not TOML") -> dict[str, Any]:
    """Tables of a text. where, allowed: begin and end the refusal. Raises InputError, one line."""
    if deep := _DEEP_KEY.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        raise InputError(f"{where}: line {line}: {_TOO_DEEP}")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where}: {error}: {allowed}") from None
    except RecursionError:
        raise InputError(f"{where}: {_TOO_DEEP}") from None
    except ValueError:  # more digits than Python converts
        raise InputError(f"{where}: a number is {_TOO_LARGE}") from None
    _check(data, where)
    return data


def _check(data: dict[str, Any], where: object) -> None:
    """Refuse what lies too deep, and whole numbers that are too large."""
    waiting: list[tuple[str, Any, int]] = [("", data, 1)]
    while waiting:
        name, value, depth = waiting.pop()
        if isinstance(value, dict | list):
            if depth > MOST_DEPTH:
                raise InputError(f"{where}: {name[:60]}: {_TOO_DEEP}")
            parts = value.items() if isinstance(value, dict) else ((name, one) for one in value)
            waiting += [(str(key), one, depth + 1) for key, one in parts]
        elif isinstance(value, int) and not -(1 << 63) <= value < 1 << 63:
            raise InputError(f"{where}: {name}: {_TOO_LARGE}")
